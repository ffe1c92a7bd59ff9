"""Whatever happened in whatever order, what is derived is what the segments that are there yield."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.map.derived import following
from derived_support import (
    add_segment,
    derived,
    execute,
    from_scratch,
    ids_of,
    measure,
    tiles_of,
    versions_of_tiles,
)
from fusion.types import Ints

CLASSES = ["primary", "tertiary", "residential", "motorway_link"]
NODES = st.integers(0, 255)
STEPS = st.one_of(
    st.tuples(
        st.just("road"),
        st.integers(1, 4),
        NODES,
        st.sampled_from([1, 2, 16, 17, 40]),
        st.sampled_from(CLASSES),
    ),
    st.tuples(st.just("measured"), NODES, st.sampled_from([-4.0, 0.0, 3.0]), st.integers(0, 3)),
    st.tuples(st.sampled_from(["forgotten", "gone", "renumbered", "moved", "reclassed"]), NODES),
    st.tuples(st.sampled_from(["followed", "died", "died late", "opened", "closed"])),
)
_CHANGES = {
    "forgotten": "DELETE FROM segment_slopes WHERE segment_id = :id",
    "gone": "DELETE FROM segments WHERE id = :id",
    "renumbered": """
        UPDATE segments SET osm_way_id = 9 - osm_way_id WHERE id = :id AND NOT EXISTS (
            SELECT FROM segments AS o JOIN segments AS s ON o.osm_way_id = 9 - s.osm_way_id
                AND (o.from_node, o.to_node) = (s.from_node, s.to_node) WHERE s.id = :id)
        """,
    "moved": """
        UPDATE segments SET geom = ST_Translate(geom, 0.03, 0),
            geom_3857 = ST_Transform(ST_Translate(geom, 0.03, 0), 3857) WHERE id = :id
        """,
    "reclassed": "UPDATE segments SET highway = 'secondary', oneway = -1 WHERE id = :id",
}


class Death(Exception):  # noqa: N818  (no error of the program)
    """The worker is gone."""


def die(*_: object, **__: object) -> None:
    raise Death


class World:
    """The database, and a transaction that may be open beside all that happens."""

    def __init__(self, sessions: Sessions) -> None:
        self.sessions = sessions
        self.open: Session | None = None

    def close(self) -> None:
        if self.open is not None:
            self.open.commit()
            self.open.close()
            self.open = None

    def happen(self, step: tuple[Any, ...]) -> None:
        what, *rest = step
        if what == "road":
            way, node, onward, highway = rest
            add_segment(self.sessions, way, node, (node + onward) % 256, highway, (node % 3) - 1)
        elif what in {"measured", *_CHANGES}:
            self.change(what, *rest)
        elif what == "opened":
            self.begin()
        elif what == "closed":
            self.close()
        else:
            self.follow(what)

    def change(self, what: str, number: int, slope: float = 0.0, drives: int = 1) -> None:
        ids = [k for k in ids_of(self.sessions) if self.open is None or k != self.held]
        if not ids:
            return
        segment = ids[number % len(ids)]
        if what == "measured":
            measure(self.sessions, segment, slope, drives)
        else:
            execute(self.sessions, _CHANGES[what], id=segment)

    def begin(self) -> None:
        """A change that is not committed for some time, while others that began later are."""
        ids = ids_of(self.sessions)
        if self.open is None and ids:
            self.held = ids[0]
            self.open = self.sessions()
            self.open.execute(text("UPDATE segments SET highway = 'trunk' WHERE id = :id"), {"id": self.held})

    def follow(self, how: str) -> None:
        name = {"died": "replace_pieces", "died late": "raise_drawn"}.get(how)
        with pytest.MonkeyPatch.context() as patch, suppress(Death):
            patch.setattr(following, "AT_ONCE", 3)
            if name:
                patch.setattr(following.drawn_store, name, die)
            following.follow(self.sessions, 0.0)
            if name:  # and while it follows changes
                patch.setattr(following.waiting, "ask_to_draw", die)
                following.follow(self.sessions, 0.0)


@pytest.fixture
def world(sessions: Sessions, segment_ids: Ints) -> Iterator[World]:
    one = World(sessions)
    yield one
    one.close()


@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(history=st.lists(STEPS, min_size=5, max_size=16))
def test_any_history_ends_in_what_the_segments_yield(world: World, history: list[tuple[Any, ...]]) -> None:
    sessions = world.sessions
    following.follow_all(sessions)
    tiles, versions = tiles_of(sessions), versions_of_tiles(sessions, set(tiles_of(sessions)))
    for step in history:
        world.happen(step)
    world.close()
    following.follow_all(sessions)
    found = derived(sessions)
    now = tiles_of(sessions)
    differing = {tile for tile in {*tiles, *now} if tiles.get(tile) != now.get(tile)}
    newer = versions_of_tiles(sessions, differing)
    assert all(newer[tile] > versions.get(tile, 0) for tile in differing)
    assert found == from_scratch(sessions)
