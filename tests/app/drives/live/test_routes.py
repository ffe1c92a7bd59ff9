"""Points through the real service: who may send them, what is answered, and what is told of them."""

from __future__ import annotations

import io
import json
import re
import time
import zipfile

import httpx
import pytest
from sqlalchemy import text

from app.core.settings import Settings
from app.drives.live.senders import SENDERS
from live_senders import SAMPLES, Sent, osmand, overland, owntracks, way
from live_support import Live, close, expected
from problem_support import check
from server_support import wait_until
from web_fixtures import served

GOOD = osmand(way(1), "pixel")[0]


def ask(client: httpx.Client, path: str, **headers: str) -> httpx.Response:
    return client.get(path, params=GOOD.params, headers=headers)


@pytest.mark.parametrize("sender", SENDERS)
def test_each_program_is_answered_as_it_wants(live: Live, sender: str) -> None:
    answers = live.send(sender, SAMPLES[sender](way(25), "pixel"))
    assert {(one.status_code, one.text) for one in answers} == {(200, SENDERS[sender].answer)}
    assert answers[0].headers["Content-Type"].startswith(SENDERS[sender].media_type)
    assert live.waiting() == 25


def test_keys_are_taken_as_a_header_too(live: Live) -> None:
    client, secret = live.web.client, live.secret()
    upload = live.keyed.secrets["anna upload"]
    for headers in ({"Authorization": f"Bearer {secret}"}, {"Authorization": f"Bearer {upload}"}):
        assert ask(client, "/v1/live/osmand", **headers).status_code == 200
    basic = client.get("/v1/live/osmand", params=GOOD.params, auth=("anna", secret))
    assert basic.status_code == 200


def test_an_address_lets_its_device_do_nothing_else(live: Live) -> None:
    client, secret = live.web.client, live.secret()
    headers = {"Authorization": f"Bearer {secret}"}
    for method, path in (
        ("GET", "/v1/live"),
        ("GET", "/v1/drives"),
        ("POST", "/v1/drives"),
        ("GET", "/v1/keys"),
        ("POST", "/v1/live/addresses"),
    ):
        assert client.request(method, path, headers=headers).status_code == 403, path
    assert client.post("/v1/session", json={"key": secret}).status_code in {401, 403}


def test_a_mightier_key_does_not_belong_into_an_address(live: Live) -> None:
    for caller in ("anna upload", "anna", "operate"):
        answer = ask(live.web.client, f"/v1/live/osmand/{live.keyed.secrets[caller]}")
        check(answer, 403, "forbidden")
    assert live.waiting() == 0


def test_nobody_sends_without_a_key_that_is_good(live: Live) -> None:
    client, secret = live.web.client, live.secret()
    assert ask(client, "/v1/live/osmand").status_code == 401
    assert ask(client, f"/v1/live/osmand/{live.keyed.secrets['wrong']}").status_code == 401
    assert ask(client, f"/v1/live/osmand/{secret}").status_code == 200
    key_id = live.keyed.ids["phone"]
    assert live.keyed.a.own.delete(f"/v1/keys/{key_id}").status_code == 204
    assert ask(client, f"/v1/live/osmand/{secret}").status_code == 401
    assert client.get(f"/v1/live/last/{secret}").status_code == 401
    assert live.waiting() == 1  # what came before stays its owner's


def test_a_phone_that_comes_once_a_minute_is_not_asked_for_each_time(
    live: Live, monkeypatch: pytest.MonkeyPatch
) -> None:
    secret, callers, looked = live.secret(), live.web.app.state.callers, list[str]()
    wait_until(lambda: bool(callers._hears))
    genuine = callers._ask

    def noted(kind: str, shown: str) -> object:
        looked.append(shown)
        return genuine(kind, shown)

    monkeypatch.setattr(callers, "_ask", noted)
    path, now_s = f"/v1/live/osmand/{secret}", time.monotonic()
    for later_s in (0.0, 61.0, 800.0):
        monkeypatch.setattr("app.access.callers.time.monotonic", lambda at=now_s + later_s: at)
        assert ask(live.web.client, path).status_code == 200
    assert looked == [secret]
    live.keyed.a.own.delete(f"/v1/keys/{live.keyed.ids['phone']}")
    assert ask(live.web.client, path).status_code == 401  # void at once all the same


def test_a_page_of_another_site_sends_no_points(live: Live) -> None:
    path = f"/v1/live/osmand/{live.secret()}"
    for site, status in (("cross-site", 403), ("same-site", 403), ("none", 200)):
        assert ask(live.web.client, path, **{"Sec-Fetch-Site": site}).status_code == status


def test_a_bad_point_does_not_keep_the_good_ones(live: Live) -> None:
    (message,) = overland(way(5), "x")
    document = json.loads(message.content)
    document["locations"][2]["properties"]["timestamp"] = "yesterday"
    (answer,) = live.send("overland", [Sent(content=json.dumps(document).encode())])
    assert answer.status_code == 200
    assert live.waiting() == 4
    (stream,) = live.keyed.a.own.get("/v1/live").json()["streams"]
    assert (stream["unusable"], stream["unusable_why"]) == (1, "point 3: time: yesterday")


def test_a_message_of_bad_points_alone_is_refused_but_where_the_program_insists(live: Live) -> None:
    bad = Sent({**GOOD.params, "lat": 99})
    (refused,) = live.send("osmand", [bad])
    problem = check(refused, 422, "invalid-request")
    assert "point 1: latitude: 99" in problem["detail"]
    lost = Sent(content=b'{"_type": "location", "lat": 99, "lon": 8, "tst": 1764231300}')
    (taken,) = live.send("owntracks", [lost])
    assert (taken.status_code, taken.text) == (200, "[]")
    (stream,) = live.keyed.a.own.get("/v1/live").json()["streams"]
    assert (stream["sender"], stream["unusable"], stream["last"]) == ("owntracks", 1, None)


@pytest.mark.parametrize(
    ("sender", "content", "status", "slug"),
    [
        ("overland", b'{"locations": [{"type": "Feat', 422, "invalid-request"),
        ("overland", b"{" + b" " * (2 * 2**20), 413, "too-large"),
        ("nothing", b"{}", 404, "not-found"),
    ],
)
def test_what_cannot_be_read_is_a_problem(
    live: Live, sender: str, content: bytes, status: int, slug: str
) -> None:
    (answer,) = live.send(sender, [Sent(content=content)])
    check(answer, status, slug)


def test_a_cut_body_adds_nothing_and_the_whole_one_all(live: Live) -> None:
    (whole,) = overland(way(20), "x")
    (cut,) = live.send("overland", [Sent(content=whole.content[:-40])])
    assert (cut.status_code, live.waiting()) == (422, 0)
    live.send("overland", [whole])
    assert live.waiting() == 20


def test_the_last_point_is_told_to_its_owner_and_to_its_own_address(live: Live) -> None:
    points = way(3)
    live.send("owntracks", owntracks(points, "pixel")[::-1])
    live.send("owntracks", owntracks(way(1, first=50), "fairphone"), name="other")
    mine = live.keyed.a.own.get("/v1/live").json()["streams"]
    assert [(one["label"], one["device"]) for one in mine] == [("other", "fairphone"), ("phone", "pixel")]
    (own,) = live.web.client.get(f"/v1/live/last/{live.secret()}").json()["streams"]
    assert own["last"]["lat"] == points[-1].lat_deg
    assert (own["under_way"], own["sender"], own["drive"]) == (True, "owntracks", None)
    assert own["seen_ago_s"] < 60
    assert live.keyed.b.own.get("/v1/live").json() == {"streams": []}


def test_an_address_is_made_with_what_is_typed(live: Live) -> None:
    for sender in SENDERS.values():
        request = {"sender": sender.name, "label": "my phone"}
        answer = live.keyed.a.own.post("/v1/live/addresses", json=request)
        assert answer.status_code == 201
        assert answer.headers["Cache-Control"] == "no-store"
        made = answer.json()
        assert re.fullmatch(rf"{live.web.base}/v1/live/{sender.name}/vsk_[\w-]+", made["address"])
        assert made["address"] in made["typed"]
        assert made["key"]["scope"] == "live"
        assert (made["link"] is None) == (sender.link is None)
    assert ask(live.web.client, made["address"]).status_code == 200  # torque: without a place, and taken
    check(live.keyed.a.own.post("/v1/live/addresses", json={"sender": "x", "label": "y"}), 404, "not-found")
    listed = live.web.client.get("/v1/live/senders").json()["senders"]
    assert [one["name"] for one in listed] == list(SENDERS)


def test_no_key_of_an_address_gets_into_a_log(live: Live, caplog: pytest.LogCaptureFixture) -> None:
    secret = live.secret()

    def told() -> list[str]:
        records = [one for one in caplog.records if not one.name.startswith("http")]  # which the client tells
        return [record.getMessage() + str(record.__dict__) for record in records]

    with caplog.at_level("INFO"):
        for method, path in (("GET", "osmand"), ("PUT", "osmand"), ("GET", "nothing"), ("GET", "last")):
            live.web.client.request(method, f"/v1/live/{path}/{secret}", params=GOOD.params)
            live.web.client.request(method, f"/v1/live/{path}/{secret}/")
        wait_until(lambda: len(told()) >= 8)
    said = told()
    assert not [one for one in said if secret in one or secret[4:] in one]


def test_a_used_up_quota_keeps_points_with_their_sender(live: Live) -> None:
    live.send("osmand", osmand(way(1), "x"))
    with live.web.sessions.begin() as session:
        session.execute(text("UPDATE owners SET quota_drives = 0"))
    live.web.app.state.quota_looks.__init__()
    (answer,) = live.send("osmand", osmand(way(1, first=5), "x"))
    check(answer, 429, "quota")
    assert "Retry-After" in answer.headers
    assert live.waiting() == 1


def test_points_under_way_are_in_their_owners_archive_and_in_no_others(live: Live) -> None:
    live.send("osmand", osmand(way(3), "my/phone"))
    archive = zipfile.ZipFile(io.BytesIO(live.keyed.a.own.get("/v1/owner/archive").content))
    (name,) = [one for one in archive.namelist() if one.startswith("under-way/")]
    assert name.endswith("-osmand-my-phone-2025-11-27T08-15Z.csv")
    assert archive.read(name) == expected(way(3))
    assert json.loads(archive.read("devices.json"))["streams"][0]["device"] == "my/phone"
    others = zipfile.ZipFile(io.BytesIO(live.keyed.b.own.get("/v1/owner/archive").content))
    assert json.loads(others.read("devices.json")) == {"streams": []}


def test_an_owner_that_is_removed_leaves_no_point(live: Live) -> None:
    live.send("osmand", osmand(way(30), "x"))
    answer = live.keyed.a.own.delete("/v1/owner", params={"name": "anna"})
    assert answer.status_code == 202, answer.text
    assert live.waiting() == 0
    assert ask(live.web.client, f"/v1/live/osmand/{live.secret()}").status_code == 401
    close(live.web)


def test_a_service_that_asks_for_no_keys_takes_points_and_still_voids_addresses(
    settings: Settings,
) -> None:
    with served(settings) as web:
        assert ask(web.client, "/v1/live/osmand").status_code == 200
        assert web.client.get("/v1/live").json()["streams"][0]["key"] is None
        made = web.client.post("/v1/live/addresses", json={"sender": "osmand", "label": "x"}).json()
        assert ask(web.client, made["address"]).status_code == 200
        assert web.client.delete(f"/v1/keys/{made['key']['id']}").status_code == 204
        assert ask(web.client, made["address"]).status_code == 401
