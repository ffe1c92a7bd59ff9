"""What the public reads over HTTP: the edition, and nothing of what came since."""

from __future__ import annotations

import csv
import math
import re
import uuid
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import pytest
from sqlalchemy import text
from sqlalchemy.exc import ProgrammingError

from access_support import Keyed, asking_for_keys
from app.access.rules import ROUTES, Rule
from app.changes.webhooks.telling import note_changes
from app.core.caller import NOBODY, Caller, as_caller, guard
from app.core.db import make_engine
from app.exports.run import EXPORT
from app.jobs.context import JobContext
from app.jobs.requests.run import perform
from app.jobs.task import Work
from release_support import LONG, MIDDLE, Public, public

__all__ = ["public"]

STREET = range(LONG)
ITEMS = "/collections/segments/items"
READ = {
    "path": "x",
    "tileMatrix": "14",
    "z": "14",
    "fontstack": "Noto Sans Regular",
    "range": "0-255",
    "slug": "not-found",
    "file": "versant.json",
}


@dataclass
class Shown:
    """A service whose public reads editions, with one in which the street is told, and a drive that came since."""

    public: Public
    guarded: Keyed

    def get(self, path: str, caller: str | None = None, **options: Any) -> Any:
        """The answer, which has to be one."""
        answer = self.guarded.ask(caller, "GET", path, **options)
        assert answer.status_code == 200, answer.text
        return answer

    def segment(self, row: int) -> int:
        return int(self.public.ids[row])


@pytest.fixture
def shown(public: Public, request: pytest.FixtureRequest) -> Iterator[Shown]:
    changed = {"public_map": "releases", "webhook_private": True, **getattr(request, "param", {})}
    with asking_for_keys(request.getfixturevalue("settings"), **changed) as guarded:
        for owner in range(5):
            public.drive(owner, STREET)
        public.release()
        public.drive(5, STREET, 5.0)
        yield Shown(public, guarded)


def tile_at(zoom: int) -> tuple[int, int]:
    """The tile around the street's middle."""
    lat = math.radians(49.0)
    y = (1 - math.asinh(math.tan(lat)) / math.pi) / 2
    return int((8.52 + 180) / 360 * 2**zoom), int(y * 2**zoom)


def driven(shown: Shown, caller: str | None = None) -> dict[int, dict[str, Any]]:
    features = shown.get(f"{ITEMS}?limit=1000&driven=true", caller).json()["features"]
    return {feature["id"]: feature["properties"] for feature in features}


def test_nobody_reads_the_edition_and_an_operator_the_map_as_it_is(shown: Shown) -> None:
    public, live = driven(shown), driven(shown, "operate")
    middle = {shown.segment(row) for row in MIDDLE}
    assert middle <= set(public) < set(live)
    told, now = public[shown.segment(20)], live[shown.segment(20)]
    assert (told["drives"], told["driven_share"], told["updated_at"]) == (5, None, "2026-11-09T00:00:00.000Z")
    assert now["drives"] == 6 and now["driven_share"] == 1.0
    assert now["slope_percent"] > told["slope_percent"] + 0.1


def test_what_is_not_told_looks_as_if_nobody_had_driven_it(shown: Shown) -> None:
    end = shown.segment(0)
    assert shown.get(f"{ITEMS}/{end}", "operate").json()["properties"]["drives"] == 6
    properties = shown.get(f"{ITEMS}/{end}").json()["properties"]
    assert (properties["drives"], properties["slope_percent"], properties["updated_at"]) == (0, None, None)
    counted = [shown.get(f"{ITEMS}?driven=true&limit=1", caller).json() for caller in (None, "operate")]
    assert counted[0]["numberMatched"] < counted[1]["numberMatched"]


@pytest.mark.parametrize("shown", [{"owners_map": "releases"}, {"owners_map": "live"}], indirect=True)
def test_what_owners_see_is_said_by_a_setting(shown: Shown) -> None:
    sees_editions = shown.guarded.web.settings.owners_map == "releases"
    as_nobody = driven(shown) == driven(shown, "anna")
    assert as_nobody is sees_editions
    assert driven(shown, "operate") != driven(shown)
    kept = shown.get(ITEMS, "anna").headers["cache-control"]
    assert "private" in kept and "private" not in shown.get(ITEMS).headers.get("cache-control", "")


def test_tiles_are_those_of_the_edition(shown: Shown) -> None:
    path = "/tiles/14/{}/{}.mvt".format(*tile_at(14))
    public, live = shown.get(path), shown.get(path, "operate")
    assert public.headers["etag"] != live.headers["etag"] and public.content != live.content
    shown.public.drive(6, STREET, 6.0)
    assert shown.get(path).headers["etag"] == public.headers["etag"]
    assert shown.get(path, "operate").headers["etag"] != live.headers["etag"]
    for owner in range(5):
        shown.public.drive(owner, STREET, 4.0)
    assert shown.get(path).content == public.content
    shown.public.release()
    again = shown.get(path)
    assert again.headers["etag"] != public.headers["etag"] and again.content != public.content


def test_low_zooms_and_ways_follow_the_edition(shown: Shown) -> None:
    path = "/tiles/10/{}/{}.mvt".format(*tile_at(10))
    assert shown.get(path).content
    ways = shown.get("/collections/ways/items?limit=1000").json()["features"]
    street = [w["properties"] for w in ways if w["properties"]["osm_way_id"] == 7]
    assert street[0]["drives"] == 5 and 0.5 < street[0]["measured_share"] < 1


def test_changes_are_those_of_editions(shown: Shown) -> None:
    first = shown.get("/v1/changes").json()["version"]
    shown.public.drive(6, STREET, 6.0)
    later = shown.get(f"/v1/changes?since={first}").json()
    assert (later["version"], later["changes"]) == (first, [])
    for owner in range(5):
        shown.public.drive(owner, STREET, 4.0)
    assert shown.get(f"/v1/changes?since={first}").json()["changes"] == []
    shown.public.release()
    told = {change["id"] for change in shown.get(f"/v1/changes?since={first}").json()["changes"]}
    assert {shown.segment(row) for row in MIDDLE} <= told
    assert shown.guarded.ask("operate", "GET", f"/v1/changes?since={first}").status_code == 410


def test_every_route_of_the_map_answers_the_public(shown: Shown) -> None:
    """Whatever a route reads, nobody's role may read it; and what it may not read is no leak but an error."""
    x, y = tile_at(14)
    parts = READ | {"x": str(x), "y": str(y), "tileCol": str(x), "tileRow": str(y)}
    ids = {"segment_id": str(shown.segment(20)), "item_id": str(shown.segment(20)), "collection": "segments"}
    failed = []
    for (method, path), rule in ROUTES.items():
        if method != "GET" or rule not in {Rule.MAP, Rule.OPEN}:
            continue
        address = re.sub(r"\{(\w+)(?::path)?\}", lambda part: (parts | ids).get(part[1], "1"), path)
        query = {"/height": "?shape=[]", "/v1/elevation": "?locations=49.0,8.52"}.get(path, "")
        with shown.guarded.web.client.stream("GET", address + query) as answer:
            if answer.status_code >= 500 or (rule is Rule.MAP and answer.status_code in {401, 403}):
                failed.append((path, answer.status_code))
    assert failed == []


@pytest.mark.parametrize(
    "table",
    ["segment_slopes", "network_slopes", "drives", "drive_passes", "ways", "drawn_pieces", "cells"],
)
def test_the_publics_role_may_not_read_what_is_live(public: Public, table: str) -> None:
    engine = guard(make_engine(str(public.settings.database_url)))
    public_one = replace(NOBODY, sees="edition")
    with (
        as_caller(public_one),
        engine.connect() as connection,
        pytest.raises(ProgrammingError, match="permission"),
    ):
        connection.execute(text(f"SELECT count(*) FROM public.{table}"))
    engine.dispose()


@pytest.mark.parametrize("caller", [NOBODY, Caller("own", 2), Caller("operate", 1)])
def test_no_role_of_the_api_reads_what_is_told(public: Public, caller: Caller) -> None:
    engine = guard(make_engine(str(public.settings.database_url)))
    with (
        as_caller(caller),
        engine.connect() as connection,
        pytest.raises(ProgrammingError, match="permission"),
    ):
        connection.execute(text("SELECT count(*) FROM told.drive_passes"))
    engine.dispose()


@pytest.mark.parametrize("shown", [{"owners_map": "releases"}], indirect=True)
def test_files_and_messages_for_owners_are_of_the_edition(shown: Shown) -> None:
    """What workers make for them is made beside the gate."""
    context, files = JobContext(shown.guarded.web.settings, shown.public.sessions), {}
    for caller in ("anna", "operate"):
        made = shown.guarded.ask(caller, "POST", "/v1/exports", json={"format": "csv", "driven": True})
        assert made.status_code == 202, made.text
        number = made.json()["id"]
        perform(EXPORT, context, uuid.UUID(number), Work(bool, nullcontext))
        files[caller] = shown.get(f"/v1/exports/{number}/file", caller).text
    told, live = (list(csv.DictReader(files[caller].splitlines())) for caller in ("anna", "operate"))
    assert len(told) == len(driven(shown)) < len(live)

    hooks = {}
    for caller in ("anna", "operate"):
        asked = {"url": "https://127.0.0.1:9/x", "events": ["segments.changed"]}
        made = shown.guarded.ask(caller, "POST", "/v1/webhooks", json=asked)
        assert made.status_code == 201, made.text
        hooks[caller] = made.json()["id"]
    shown.public.drive(6, STREET, 6.0)
    written = partial(note_changes, shown.public.sessions, 0.0, owners_see_editions=True)
    assert written() == 1
    for owner in range(5):
        shown.public.drive(owner, STREET, 4.0)
    shown.public.release()
    assert written() == 1
    with shown.public.sessions() as session:
        told_to = set(
            session.execute(text("SELECT CAST(webhook_id AS text) FROM webhook_deliveries")).scalars()
        )
    assert told_to == set(hooks.values())
