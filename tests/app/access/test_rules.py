"""Every route and every caller: what is refused, and what is not there for somebody else."""

from __future__ import annotations

import re
from typing import Any

import pytest

from access_support import Keyed, Things
from app.access.rules import ROUTES, Rule, Rules
from app.main import known_routes

REFUSED: dict[Rule, dict[str | None, int]] = {
    Rule.OPEN: {},
    Rule.MAP: {None: 401, "wrong": 401, "revoked": 401, "anna upload": 403},
    Rule.LIVE: {None: 401, "wrong": 401, "revoked": 401},
    Rule.UPLOAD: {None: 401, "wrong": 401, "revoked": 401},
    Rule.OWN: {None: 401, "wrong": 401, "revoked": 401, "anna upload": 403},
    Rule.OPERATE: {None: 401, "wrong": 401, "revoked": 401, "anna upload": 403, "anna": 403},
}
"""Where the map is not public."""
OF_AN_OWNER = ("drive_id", "trial_id", "export_id", "webhook_id", "key_id")
BODIES: dict[tuple[str, str], dict[str, Any]] = {
    ("PATCH", "/v1/webhooks/{webhook_id}"): {"json": {"active": False}},
    ("POST", "/v1/drives/{drive_id}/trials"): {"json": {"method": "raw"}},
}
"""Without them the route refuses a request before it looks for anything."""


def address(path: str, things: Things) -> str:
    """The path with what the owner has, and else something."""
    named = re.sub(r"\{(\w+)\}", lambda part: things.ids.get(part[1], "1"), path)
    return re.sub(r"\{\w+:path\}", "x", named)


def status(guarded: Keyed, caller: str | None, method: str, path: str, **request: Any) -> int:
    """The status alone: a stream may be without end."""
    headers = {} if caller is None else {"Authorization": f"Bearer {guarded.secrets[caller]}"}
    with guarded.web.client.stream(method, path, headers=headers, **request) as answer:
        return answer.status_code


def test_the_table_names_every_route_and_no_other() -> None:
    assert set(known_routes()) == set(ROUTES)


def test_a_route_that_is_not_in_the_table_is_an_operators() -> None:
    rules = Rules([("GET", "/v1/secrets/{name}"), ("GET", "/v1/secrets")])
    assert rules.of("GET", "/v1/secrets/x") is Rule.OPERATE
    assert rules.of("GET", "/v1/secrets") is Rule.OPERATE
    assert rules.of("GET", "/elsewhere") is Rule.OPEN  # which no route answers


@pytest.mark.parametrize(
    ("path", "rule"),
    [
        ("/tiles/3/4/5.mvt", Rule.MAP),
        ("/collections/segments/tiles/WebMercatorQuad/3/4/5", Rule.MAP),
        ("/collections/anything/else/there", Rule.MAP),
        ("/v1/drives/reprocess", Rule.OWN),
        ("/v1/drives/reprocess/", Rule.OPEN),
        ("/v1/drives/3f1c9a52-8f0e-4b57-9d0a-5a9f6c1f0f11", Rule.UPLOAD),
        ("/v1/drives/3f1c9a52-8f0e-4b57-9d0a-5a9f6c1f0f11/log", Rule.OWN),
        ("/v1/admin/stats", Rule.OPERATE),
    ],
)
def test_the_rule_is_that_of_the_route_that_answers(path: str, rule: Rule) -> None:
    assert Rules(known_routes()).of("GET", path) is rule


def test_every_caller_is_refused_where_the_table_says_so_and_changes_nothing(
    shared: tuple[Keyed, dict[str, Things]],
) -> None:
    guarded, things = shared
    wrong = []
    for (method, path), rule in ROUTES.items():
        for caller, expected in REFUSED[rule].items():
            found = status(guarded, caller, method, address(path, things["anna"]))
            if found != expected:
                wrong.append((method, path, caller, expected, found))
    assert wrong == []
    for kind in ("drives", "exports", "webhooks"):
        path = f"/v1/{kind}/{things['anna'].ids[kind.removesuffix('s') + '_id']}"
        assert guarded.ask("anna", "GET", path).status_code == 200


def test_what_is_another_owners_is_not_there(shared: tuple[Keyed, dict[str, Things]]) -> None:
    """By the routes' own answers, the same as for an id of nothing; and nothing of it is changed."""
    guarded, things = shared
    nothing = Things(dict.fromkeys(OF_AN_OWNER, "00000000-0000-0000-0000-000000000000"))
    wrong = []
    for (method, path), rule in ROUTES.items():
        if rule is Rule.OPEN or not any(f"{{{name}}}" in path for name in OF_AN_OWNER):
            continue
        request = BODIES.get((method, path), {})
        for caller in ("ben", "ben upload"):
            if caller == "ben upload" and rule is not Rule.UPLOAD:
                continue
            answers = [
                guarded.ask(caller, method, address(path, of), **request) for of in (things["anna"], nothing)
            ]
            documents = [re.sub(r"[0-9a-f]{8}-[0-9a-f-]{27}", "ID", answer.text) for answer in answers]
            if [answer.status_code for answer in answers] != [404, 404] or documents[0] != documents[1]:
                wrong.append((method, path, caller, [answer.status_code for answer in answers], documents))
    assert wrong == []
    for kind in ("drives", "exports", "webhooks"):
        path = f"/v1/{kind}/{things['anna'].ids[kind.removesuffix('s') + '_id']}"
        assert guarded.ask("anna", "GET", path).status_code == 200


@pytest.mark.parametrize("caller", ["anna", "operate"])
def test_whoever_may_reads(shared: tuple[Keyed, dict[str, Things]], caller: str) -> None:
    guarded, things = shared
    of = things["anna"]
    ids = dict(of.ids, segment_id=str(_a_segment(guarded)), item_id=str(_a_segment(guarded)))
    wrong = []
    for (method, path), rule in ROUTES.items():
        if method != "GET" or rule is Rule.OPEN or (rule is Rule.OPERATE and caller != "operate"):
            continue
        if any(part in path for part in MADE_LATER):
            continue
        found = status(guarded, caller, method, address(path, Things(ids)))
        if found in {401, 403} or found >= 500:
            wrong.append((path, found))
    assert wrong == []


MADE_LATER = ("/file", "/beside/", "/v1/changes/events")
"""Of an export when it is made; a stream without end."""


def _a_segment(guarded: Keyed) -> int:
    answer = guarded.ask("anna", "GET", "/collections/segments/items?limit=1")
    return int(answer.json()["features"][0]["id"])


def test_lists_hold_what_is_the_owners(shared: tuple[Keyed, dict[str, Things]]) -> None:
    guarded, things = shared
    for owner, of in things.items():
        for kind in ("drives", "exports", "webhooks"):
            listed = guarded.ask(owner, "GET", f"/v1/{kind}").json()[kind]
            assert [one["id"] for one in listed] == [of.ids[kind.removesuffix("s") + "_id"]]
    for kind in ("drives", "exports", "webhooks"):
        listed = guarded.ask("operate", "GET", f"/v1/{kind}").json()[kind]
        assert len(listed) == len(things)
