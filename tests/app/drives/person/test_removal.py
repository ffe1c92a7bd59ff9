"""An owner is removed: nobody is let in, nothing is shown, nothing is left, and a receipt says what there was."""

from __future__ import annotations

import json
import threading
import uuid
from typing import Any

import pytest
from sqlalchemy import text
from sqlalchemy.exc import OperationalError

from access_support import Keyed, asking_for_keys
from app.core.blobs import EXPORTS, BlobStore
from app.core.settings import Settings
from app.drives import intake
from app.drives.person import removal
from app.drives.worker import run_worker
from many_drives import execute, make_drives, rows
from person_support import Anna
from problem_support import check
from processing_support import carry_out_removals
from server_support import wait_until

OWNED = (
    "drives",
    "keys",
    "sessions",
    "exports",
    "webhooks",
    "owner_zones",
    "owner_use",
    "drive_counts",
    "batches",
    "audit_log",
)


def exports_of(keyed: Keyed) -> BlobStore:
    return BlobStore(keyed.web.settings.blob_store_url, EXPORTS)


def look(keyed: Keyed) -> None:
    """What a worker does of it, again and again."""
    carry_out_removals(keyed.web.sessions, keyed.web.blobs)
    removal.look_after(keyed.web.sessions, exports_of(keyed))


def left(keyed: Keyed, owner_id: int) -> dict[str, int]:
    """The rows of each table that are the owner's."""
    found = {}
    for table in OWNED:
        query = f"SELECT count(*) FROM {table} WHERE owner_id = :id"
        found[table] = rows(keyed.web.sessions, query, id=owner_id)[0][0]
    found["owners"] = rows(keyed.web.sessions, "SELECT count(*) FROM owners WHERE id = :id", id=owner_id)[0][
        0
    ]
    return {table: count for table, count in found.items() if count}


def receipt(keyed: Keyed, removal_id: str) -> dict[str, Any]:
    """As somebody without any key reads it."""
    answer = keyed.web.client.get(f"/v1/removals/{removal_id}")
    assert answer.status_code == 200, answer.text
    document: dict[str, Any] = answer.json()
    return document


def furnish(anna: Anna) -> None:
    """One of all that an owner may have."""
    own = anna.keyed.a.own
    assert own.post("/v1/exports", json={"format": "csv"}).status_code == 202
    assert own.post(
        "/v1/webhooks", json={"url": "https://example.org/x", "events": ["drive.done"]}
    ).is_success
    assert own.post(f"/v1/drives/{anna.done}/trials?method=raw").status_code == 202
    assert own.post("/v1/drives/reprocess?which=failed").is_success
    zone = {"type": "Point", "coordinates": [8.67, 49.41]}
    feature = {"type": "Feature", "geometry": zone, "properties": {"name": "home", "radius_m": 300}}
    zones = {"type": "FeatureCollection", "features": [feature]}
    assert own.client.put("/v1/owner/zones", json=zones).status_code == 204
    assert anna.keyed.operator.post(
        "/v1/keys", json={"label": "x", "scope": "upload", "owner": "anna"}
    ).is_success


def test_nothing_is_left_of_an_owner_but_a_receipt(anna: Anna) -> None:
    keyed = anna.keyed
    furnish(anna)
    log_in = keyed.web.client.post("/v1/session", json={"key": keyed.a.own.secret})
    cookie = log_in.headers["set-cookie"].partition(";")[0]
    answer = keyed.a.own.delete("/v1/owner?name=anna")
    assert answer.status_code == 202, answer.text
    begun = answer.json()
    assert answer.headers["location"].endswith(f"/v1/removals/{begun['id']}")
    size = sum(map(len, anna.logs.values()))
    assert begun["removed"] == {
        "drives": 2,
        "bytes": size,
        "trials": 1,
        "keys": 4,
        "sessions": 1,
        "exports": 1,
        "webhooks": 1,
        "zones": 1,
    }
    assert (begun["state"], begun["drives_left"], begun["ended_on"]) == ("running", 2, None)
    # At once: no key, no browser, no drive, for nobody.
    for holder in (keyed.a.own, keyed.a.upload):
        check(holder.get(f"/v1/drives/{anna.done}"), 401)
    check(keyed.web.client.get("/v1/drives", headers={"Cookie": cookie}), 401)
    check(keyed.operator.get(f"/v1/drives/{anna.done}"), 404)
    assert keyed.operator.get("/v1/drives").json()["drives"] == []
    look(keyed)
    assert left(keyed, keyed.a.id) == {}
    ended = receipt(keyed, begun["id"])
    assert (ended["state"], ended["drives_left"]) == ("done", 0)
    assert ended["ended_on"] is not None
    assert ended["removed"] == begun["removed"]
    assert keyed.web.blobs.keys() == []
    assert keyed.operator.get("/v1/owners").json()["owners"][-1]["name"] == "operator"
    told = keyed.operator.get("/collections/segments/items").json()["features"]
    assert all(one["properties"]["slope_percent"] is None or not one["properties"]["drives"] for one in told)


def test_what_stays_of_the_audit_names_nobody(anna: Anna) -> None:
    keyed = anna.keyed
    furnish(anna)
    begun = keyed.a.own.delete("/v1/owner?name=anna").json()
    look(keyed)
    query = "SELECT a.owner_id, a.key_id, a.origin, a.detail, a.action, a.at FROM audit_log AS a ORDER BY id"
    kept = rows(keyed.web.sessions, query)
    assert {row[0] for row in kept} == {1}
    of_owner = [row for row in kept if not row[2]]
    assert receipt(keyed, begun["id"])["audit_rows_kept"] == len(of_owner) == 3
    assert {row[4] for row in of_owner} == {"zones changed", "drives asked for again", "owner removed"}
    assert {row[1] for row in of_owner} == {None}
    assert all(row[5].hour == row[5].minute == row[5].second == 0 for row in of_owner)
    assert "owner" not in json.dumps([row[3] for row in kept])
    assert "address or program" in " ".join(receipt(keyed, begun["id"])["sentences"])


def test_it_has_to_be_confirmed_and_the_operators_owner_stays(keyed: Keyed) -> None:
    for name in ("", "?name=", "?name=ben", "?name=Anna"):
        path = f"/v1/owner{name}"
        check(keyed.a.own.delete(path), 422)
    check(keyed.operator.delete(f"/v1/owners/{keyed.a.id}?name=ben"), 422)
    check(keyed.operator.delete("/v1/owner?name=operator"), 403)
    check(keyed.operator.delete("/v1/owners/1?name=operator"), 403)
    check(keyed.operator.delete("/v1/owners/999?name=anna"), 404)
    check(keyed.b.own.delete(f"/v1/owners/{keyed.a.id}?name=anna"), 403)
    check(keyed.a.upload.delete("/v1/owner?name=anna"), 403)
    assert keyed.a.own.get("/v1/owner").status_code == 200
    check(keyed.web.client.get(f"/v1/removals/{uuid.uuid4()}"), 404)


def test_a_second_request_answers_with_the_same_removal(keyed: Keyed) -> None:
    path = f"/v1/owners/{keyed.a.id}?name=anna"
    answers = [keyed.operator.delete(path)]
    owner = keyed.operator.get(f"/v1/owners/{keyed.a.id}").json()
    assert owner["removed_at"] is not None
    assert owner["name"] != "anna"  # it is free
    assert keyed.operator.post("/v1/owners", json={"name": "anna"}).status_code == 201
    answers.append(keyed.operator.delete(path))
    look(keyed)
    check(keyed.operator.get(f"/v1/owners/{keyed.a.id}"), 404)
    answers.append(keyed.operator.delete(path))
    assert {answer.status_code for answer in answers} == {202}
    assert len({answer.json()["id"] for answer in answers}) == 1
    assert answers[-1].json()["state"] == "done"
    check(keyed.operator.delete("/v1/owners/999?name=anna"), 404)


def test_two_at_the_same_moment_are_one(keyed: Keyed) -> None:
    found: list[str] = []

    def ask() -> None:
        answer = keyed.operator.delete(f"/v1/owners/{keyed.a.id}?name=anna")
        found.append(answer.json()["id"])

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 4
    assert len(set(found)) == 1


def test_others_keep_what_they_have(anna: Anna) -> None:
    keyed = anna.keyed
    content = anna.logs[anna.done]
    theirs = keyed.b.own.post("/v1/drives", files={"file": ("b.csv", content)}).json()["id"]
    keyed.a.own.delete("/v1/owner?name=anna")
    look(keyed)
    assert keyed.b.own.get(f"/v1/drives/{theirs}/log").content == content
    assert left(keyed, keyed.b.id)["drives"] == 1


def test_an_upload_that_ends_meanwhile_is_refused_and_leaves_nothing(
    anna: Anna, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was let in before. Whether it commits before or after, nothing of it stays."""
    keyed = anna.keyed
    arrived, goes_on = threading.Event(), threading.Event()
    register = intake.register_upload

    def later(*arguments: Any, **named: Any) -> Any:
        arrived.set()
        assert goes_on.wait(30)
        return register(*arguments, **named)

    monkeypatch.setattr(intake, "register_upload", later)
    answers: list[Any] = []
    log = anna.logs[anna.done] + b"\n1700000500,49.0,8.4"
    send = threading.Thread(
        target=lambda: answers.append(keyed.a.upload.post("/v1/drives", files={"file": ("c.csv", log)}))
    )
    send.start()
    assert arrived.wait(30)
    keyed.a.own.delete("/v1/owner?name=anna")
    goes_on.set()
    send.join(30)
    assert "was removed" in check(answers[0], 401)["detail"]
    look(keyed)
    assert left(keyed, keyed.a.id) == {}
    assert keyed.web.blobs.keys() == []


def test_an_upload_that_commits_just_then_is_waited_for(anna: Anna, monkeypatch: pytest.MonkeyPatch) -> None:
    keyed = anna.keyed
    inside, goes_on = threading.Event(), threading.Event()
    enqueue = intake.queue.enqueue

    def slowly(*arguments: Any) -> None:
        inside.set()
        assert goes_on.wait(30)
        enqueue(*arguments)

    monkeypatch.setattr(intake.queue, "enqueue", slowly)
    uploaded: list[Any] = []
    log = anna.logs[anna.done] + b"\n1700000500,49.0,8.4"
    send = threading.Thread(
        target=lambda: uploaded.append(keyed.a.own.post("/v1/drives", files={"file": ("c.csv", log)}))
    )
    send.start()
    assert inside.wait(30)
    removed: list[Any] = []
    ask = threading.Thread(target=lambda: removed.append(keyed.a.own.delete("/v1/owner?name=anna")))
    ask.start()
    waits = "SELECT count(*) FROM pg_stat_activity WHERE wait_event_type = 'Lock'"
    wait_until(lambda: rows(keyed.web.sessions, waits)[0][0] > 0)
    goes_on.set()
    send.join(30)
    ask.join(30)
    assert uploaded[0].status_code == 202
    assert removed[0].json()["removed"]["drives"] == 3
    check(keyed.operator.get(f"/v1/drives/{uploaded[0].json()['id']}"), 404)


def test_a_request_that_is_cut_off_is_gone_on_with(keyed: Keyed, monkeypatch: pytest.MonkeyPatch) -> None:
    """The process dies after the owner is shut out; workers do the rest, four of them at once."""
    make_drives(keyed.web.sessions, 20)
    execute(keyed.web.sessions, "UPDATE drives SET owner_id = :a", a=keyed.a.id)

    def cut_off(*_: object) -> None:
        raise OperationalError("the process is gone", None, Exception())

    with monkeypatch.context() as patched:
        patched.setattr(removal, "_cancel_drives", cut_off)
        begun = keyed.a.own.delete("/v1/owner?name=anna")
    assert begun.status_code == 202
    assert receipt(keyed, begun.json()["id"])["drives_left"] == 20
    check(keyed.a.own.get("/v1/drives"), 401)
    workers = [
        threading.Thread(target=run_worker, args=(keyed.web.settings,), kwargs={"wait": False})
        for _ in range(4)
    ]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join(120)
    look(keyed)
    assert left(keyed, keyed.a.id) == {}
    assert receipt(keyed, begun.json()["id"])["state"] == "done"


def test_what_somebody_makes_in_the_last_moment_goes_with_the_next_look(keyed: Keyed) -> None:
    keyed.a.own.delete("/v1/owner?name=anna")
    batch = "INSERT INTO batches (owner_id, selection, state, drives_of) VALUES (:a, '{}', 'enqueuing', NULL)"
    execute(keyed.web.sessions, batch, a=keyed.a.id)
    removal.look_after(keyed.web.sessions, exports_of(keyed))
    assert left(keyed, keyed.a.id).keys() >= {"owners", "batches"}
    execute(keyed.web.sessions, "UPDATE batches SET state = 'enqueued'")
    removal.look_after(keyed.web.sessions, exports_of(keyed))
    assert left(keyed, keyed.a.id) == {}
    with keyed.web.sessions() as session:  # over the drives of all: it is the service's from now on
        assert session.execute(text("SELECT owner_id FROM batches")).scalars().all() == [1]


def test_a_key_or_session_that_is_made_meanwhile_lets_nobody_in(keyed: Keyed) -> None:
    keyed.operator.delete(f"/v1/owners/{keyed.a.id}?name=anna")
    late = keyed.holder(keyed.a.id, "own")
    check(late.get("/v1/drives"), 401)
    look(keyed)
    assert left(keyed, keyed.a.id) == {}


def test_where_everybody_reads_editions(settings: Settings) -> None:
    """The roles and schemas of editions are in nobody's way here."""
    with asking_for_keys(settings, public_map="releases", owners_map="releases") as keyed:
        make_drives(keyed.web.sessions, 3)
        execute(keyed.web.sessions, "UPDATE drives SET owner_id = :a", a=keyed.a.id)
        assert keyed.a.own.get("/v1/owner/archive").status_code == 200
        assert keyed.a.own.get("/v1/owner/zones").status_code == 200
        assert keyed.web.client.get("/v1/session").json()["public_owners"] == 5
        begun = keyed.a.own.delete("/v1/owner?name=anna").json()
        assert receipt(keyed, begun["id"])["removed"]["drives"] == 3
        look(keyed)
        assert left(keyed, keyed.a.id) == {}
        assert receipt(keyed, begun["id"])["state"] == "done"
