"""Whatever happens in whatever order, who follows the changes has the map, and is told of what changed and no more.

Drives come and go, roads are imported, by the service's own functions. Beside them others write, and end when they
like: rows of their own, so that nobody waits in a test of one thread, but seen by whoever looks.
"""

from __future__ import annotations

import itertools
import uuid
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import numpy as np
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.changes import store
from app.changes.store import Since, page_since
from app.core.blobs import BlobStore
from app.core.db import Bounds, Sessions
from app.map.segment import Column, Segment
from fusion.roads.table import RoadTable
from processing_support import remove_drive
from region_support import bring, moved
from web_fixtures import add_drive, grid_roads

OTHERS = 3
WEST_HALF: Bounds = (8.39, 48.9, 8.4071, 49.1)
BLOBS = BlobStore("memory://histories")

COLUMNS = [
    next(one for one in get_args(hint) if isinstance(one, Column)).sql
    for hint in get_type_hints(Segment, include_extras=True).values()
    if get_origin(hint) is Annotated
]
_FROM = "FROM segments AS s LEFT JOIN segment_slopes AS a ON a.segment_id = s.id"
SHOWN = text(f"SELECT {', '.join(COLUMNS)}, ST_AsBinary(s.geom) {_FROM}")
IN_BOX = text(
    f"SELECT s.id {_FROM} WHERE ST_Intersects(s.geom, ST_MakeEnvelope(:west, :south, :east, :north, 4326))"
)
SINCE = text(f"SELECT s.id FROM segments AS s WHERE {store.changed_since_sql('s')}")

World = dict[int, tuple[Any, ...]]

_numbers = itertools.count(1)


def world(sessions: Sessions) -> World:
    """All that is shown of every segment."""
    with sessions() as session:
        return {row[0]: tuple(row) for row in session.execute(SHOWN)}


def inside(sessions: Sessions, box: Bounds | None) -> set[int]:
    if box is None:
        return set(world(sessions))
    with sessions() as session:
        corners = dict(zip(("west", "south", "east", "north"), box, strict=True))
        return set(session.execute(IN_BOX, corners).scalars())


@dataclass
class Follower:
    """Keeps a copy of the map, or of a part of it, by what it is told."""

    sessions: Sessions
    box: Bounds | None = None
    copy: World = field(default_factory=dict)
    version: str = ""
    told: set[int] = field(default_factory=set)

    def begin(self) -> Follower:
        with self.sessions() as session:
            self.version = store.version_text(session, store.horizon(session))
        here = inside(self.sessions, self.box)
        self.copy = {k: row for k, row in world(self.sessions).items() if k in here}
        return self

    def follow(self, limit: int = 1000) -> None:
        more = True
        while more:
            with self.sessions() as session:
                now = store.state(session)
                page = page_since(session, now, store.parse_since(now, self.version), limit, self.box)
            known, here = world(self.sessions), inside(self.sessions, self.box)
            for change in page.changes:
                self.told.add(change.id)
                assert change.gone <= (change.id not in known)
                self.copy.pop(change.id, None)
                if change.id in here:
                    self.copy[change.id] = known[change.id]
            self.version, more = store.text_of(page.until), page.more


class Reader:
    """Follows by ``updated_since``: the items that changed, from one horizon to the next."""

    def __init__(self, sessions: Sessions) -> None:
        self.sessions, self.told = sessions, set[int]()
        with sessions() as session:
            self.since = store.horizon(session)

    def follow(self) -> None:
        with self.sessions() as session:
            until = store.horizon(session)
            values = {"since_xid": self.since, "since_time": None, "until_xid": until}
            self.told |= set(session.execute(SINCE, values).scalars())
            self.since = max(self.since, until)


_ADD_OWN = text(
    """
    INSERT INTO segments (osm_way_id, from_node, to_node, geom, geom_3857, length_m, highway, oneway, bridge, tunnel,
                          layer, road_version_id)
    SELECT :way, :n, :n + 1, g, ST_Transform(g, 3857), 100, 'track', 0, false, false, 0, max(v.id)
    FROM road_versions AS v,
         ST_SetSRID(ST_MakeLine(ST_MakePoint(8.41, 49.05), ST_MakePoint(8.411, 49.05)), 4326) AS g
    GROUP BY g RETURNING id
    """
)
OWN: dict[str, str] = {
    "renames": "UPDATE segments SET name = :new WHERE id = :id",
    "moves": "UPDATE segments SET geom = ST_Translate(geom, CASE WHEN ST_XMin(geom) > 8.405 THEN -0.008 ELSE 0.008 END,"
    " 0) WHERE id = :id",
    "measures": "INSERT INTO segment_slopes (segment_id, slope_percent, slope_sigma_percent, drives, observations)"
    " SELECT id, random(), 1, 1, 1 FROM segments WHERE id = :id"
    " ON CONFLICT (segment_id) DO UPDATE SET slope_percent = excluded.slope_percent",
    "forgets": "DELETE FROM segment_slopes WHERE segment_id = :id",
    "drops": "DELETE FROM segments WHERE id = :id",
    "says nothing": "UPDATE segments SET layer = layer + 1 WHERE id = :id",
}


@dataclass
class Other:
    """Somebody who writes beside the service, rows of its own, in a transaction that ends some time."""

    session: Session
    way: int
    rows: list[int] = field(default_factory=list)
    wrote: set[int] = field(default_factory=set)
    """In this transaction; what changes and changes back within one is told as well."""

    def do(self, what: str, which: int) -> None:
        if what == "adds":
            row = {"way": self.way, "n": next(_numbers) * 2}
            self.rows.append(self.session.execute(_ADD_OWN, row).scalar_one())
            self.wrote.add(self.rows[-1])
        elif self.rows:
            one = self.rows[which % len(self.rows)]
            values: dict[str, object] = {"id": one, "new": uuid.uuid4().hex}
            done = self.session.execute(
                text(OWN[what]), {k: values[k] for k in values if f":{k}" in OWN[what]}
            )
            if done.rowcount and what != "says nothing":  # type: ignore[attr-defined]
                self.wrote.add(one)

    def end(self, how: str) -> set[int]:
        """What was changed thereby."""
        ends: dict[str, Callable[[], None]] = {
            "commit": self.session.commit,
            "rollback": self.session.rollback,
        }
        ends[how]()
        wrote, self.wrote = self.wrote, set()
        return wrote if how == "commit" else set()


def imported_table(variant: int) -> RoadTable:
    """The grid, with roads gone, renamed and moved, by a little or far, as the number's bits say."""
    table = grid_roads()
    if variant & 1:
        table = moved(table, [20, 21], 1.0)
    if variant & 2:
        table = moved(table, [30], 30.0, 20.0)
    if variant & 4:
        names = np.array(table.name, object)
        names[40:44] = "Neue Straße"
        table = replace(table, name=names)
    return table.subset(np.arange(8 * (variant >> 3), len(table)))


STEPS = st.one_of(
    st.tuples(st.just("drive"), st.integers(0, 100), st.integers(1, 6)),
    st.tuples(st.just("remove"), st.integers(0, 5), st.just(0)),
    st.tuples(st.just("import"), st.integers(0, 15), st.just(0)),
    *(
        st.tuples(st.sampled_from(["adds", *OWN]), st.integers(0, OTHERS - 1), st.integers(0, 3))
        for _ in range(4)
    ),
    *(
        st.tuples(st.sampled_from(["commit", "commit", "rollback"]), st.integers(0, OTHERS - 1), st.just(0))
        for _ in range(2)
    ),
    st.tuples(st.just("follow"), st.integers(1, 20), st.just(0)),
)


class History:
    """The service, others beside it, and those who follow; what has changed is found by comparing all with all."""

    def __init__(self, sessions: Sessions, stack: ExitStack) -> None:
        self.sessions, self.stack = sessions, stack
        self.drives: list[uuid.UUID] = []
        self.others = [
            Other(stack.enter_context(sessions()), 10_000 + k + OTHERS * next(_numbers))
            for k in range(OTHERS)
        ]
        for other in self.others:
            for _ in range(3):
                other.do("adds", 0)
            other.end("commit")
        self.open: set[int] = set()
        self.before = world(sessions)
        self.changed: set[int] = set()
        self.all, self.part = Follower(sessions).begin(), Follower(sessions, WEST_HALF).begin()
        self.reader = Reader(sessions)

    def do(self, step: str, first: int, second: int) -> None:
        if step == "follow":
            self.follow(first)
        elif step in {"commit", "rollback"}:
            self.changed |= self.others[first].end(step)
            self.open.discard(first)
        elif step in {"drive", "remove", "import"}:
            self._serve(step, first, second)
        else:
            self.others[first].do(step, second)
            self.open.add(first)
        self._compare()

    def follow(self, limit: int) -> None:
        for follower in (self.all, self.part):
            follower.follow(limit)
        self.reader.follow()
        assert self.all.told <= self.changed, "told of what did not change"
        if not self.open:
            self.check()

    def check(self) -> None:
        """Nobody is in the middle of anything: all has been told."""
        assert self.all.told == self.changed
        assert self.all.copy == self.before
        here = inside(self.sessions, WEST_HALF)
        assert self.part.copy == {k: row for k, row in self.before.items() if k in here}
        assert self.part.told <= self.changed
        assert self.reader.told <= self.changed
        assert self.reader.told >= self.changed & set(self.before)

    def _serve(self, step: str, first: int, second: int) -> None:
        if step == "drive":
            some = [(first + k) % 60 for k in range(second)]
            self.drives.append(add_drive(self.sessions, some, 1.0 + first / 7))
        elif step == "import":
            bring(self.sessions, imported_table(first), "grid")
        elif self.drives:
            remove_drive(self.sessions, BLOBS, self.drives.pop(first % len(self.drives)))

    def _compare(self) -> None:
        after = world(self.sessions)
        both = {**self.before, **after}
        self.changed |= {k for k in both if self.before.get(k) != after.get(k)}
        self.before = after


@settings(
    max_examples=6,
    deadline=None,
    phases=(Phase.explicit, Phase.reuse, Phase.generate),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(history=st.lists(STEPS, min_size=6, max_size=16))
def test_who_follows_has_the_map_and_is_told_of_what_changed_and_no_more(
    mapped: Sessions, history: list[tuple[str, int, int]]
) -> None:
    with ExitStack() as stack:
        run = History(mapped, stack)
        for step in history:
            run.do(*step)
        for k in range(OTHERS):
            run.do("commit", k, 0)
        run.follow(1000)
        run.check()
        for drive in run.drives:
            remove_drive(mapped, BLOBS, drive)


def test_a_follower_who_would_miss_something_is_found_out(mapped: Sessions) -> None:
    """The comparison can fail: of who takes the highest number it has seen for a horizon."""
    with ExitStack() as stack:
        run = History(mapped, stack)
        run.do("renames", 0, 0)
        run.do("renames", 1, 0)
        run.do("commit", 1, 0)
        with mapped() as session:
            now = store.state(session)
            newest = session.execute(text("SELECT max(xid) FROM segment_changes")).scalar_one()
        run.all.version = store.text_of(Since(now.epoch, newest + 1))
        run.do("commit", 0, 0)
        run.all.follow()
        assert run.all.told != run.changed
        assert run.all.copy != run.before
