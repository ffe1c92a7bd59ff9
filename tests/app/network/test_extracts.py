"""Roads that are kept in memory from one solution to the next."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import event

from app.core.databases import drop_database
from app.core.db import Sessions, fetch_binary, make_engine, session_factory
from app.embedded.cluster import EmbeddedPostgres
from app.network import extracts, solve
from app.network.extracts import Roads, roads_in
from app.roads.store import current_road_version
from fusion.roads.table import RoadTable, boxes_along, rows_of
from fusion.simulate.scene.town import Town
from fusion.types import Floats
from road_support import replace_roads

Chain = Callable[..., RoadTable]


def imported(sessions: Sessions, table: RoadTable) -> None:
    with sessions.begin() as session:
        replace_roads(session, table, "x", "0" * 64)


def found(sessions: Sessions, boxes: Floats) -> Roads:
    with sessions() as session:
        return roads_in(session, boxes)


def assert_whole(roads: Roads, table: RoadTable) -> None:
    for name in RoadTable.columns():
        assert np.array_equal(getattr(roads.table, name), getattr(table, name)), name


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_they_are_those_of_the_whole(
    sessions: Sessions, town: Town, monkeypatch: pytest.MonkeyPatch, data: st.DataObject
) -> None:
    """Whatever is kept already, and however little may be."""
    with sessions() as session:
        fresh = current_road_version(session) is None
    if fresh:
        imported(sessions, town.roads)
    west, south, east, north = town.roads.bounds_deg()
    lon = data.draw(st.lists(st.floats(west - 0.01, east + 0.01), min_size=1, max_size=8))
    lat = data.draw(st.lists(st.floats(south - 0.01, north + 0.01), min_size=len(lon), max_size=len(lon)))
    boxes = boxes_along(np.array(lon), np.array(lat), data.draw(st.floats(0, 500)))
    monkeypatch.setattr(extracts, "MOST_CACHED", data.draw(st.sampled_from([0, 50, 100_000])))
    monkeypatch.setattr(extracts, "CELLS_AT_ONCE", data.draw(st.sampled_from([1, 3, 64])))
    near = found(sessions, boxes)
    with sessions() as session:
        whole, all_ids = extracts.all_roads(session)
    assert_whole(near, town.roads.along(boxes))
    assert np.array_equal(near.ids, all_ids[rows_of(whole, near.table)])


def test_roads_reach_into_cells_from_afar(sessions: Sessions, chain: Chain) -> None:
    """Lines of 50 km, one of them around the last latitude that has cells of its own."""
    table = chain(3, lon0_deg=[8.0, 8.0, 8.0], lat0_deg=[48.0, 48.3, 84.9],
                  lon1_deg=[8.5, 8.5, 9.0], lat1_deg=[48.3, 48.3, 85.3])  # fmt: skip
    imported(sessions, table)
    for boxes in ([[8.25, 48.15, 8.26, 48.16]], [[8.1, 48.3, 8.10001, 48.3]], [[8.9, 85.2, 8.95, 89.0]]):
        assert_whole(found(sessions, np.array(boxes)), table.along(np.array(boxes)))
    assert not len(found(sessions, np.empty((0, 4))).ids)


def test_roads_are_read_once(sessions: Sessions, town: Town) -> None:
    imported(sessions, town.roads)
    boxes = np.array([town.roads.bounds_deg()])
    first = found(sessions, boxes)
    statements: list[str] = []
    engine = sessions.kw["bind"]
    event.listen(engine, "before_cursor_execute", lambda *args: statements.append(args[2]))
    again = found(sessions, boxes)
    assert_whole(again, first.table)
    assert len(statements) == 1
    assert "segments" not in statements[0]


def test_an_import_is_seen_at_once(sessions: Sessions, chain: Chain) -> None:
    """By sessions that begin after it; a snapshot from before still has the former roads."""
    imported(sessions, chain(10))
    boxes = np.array([chain(10).bounds_deg()])
    found(sessions, boxes)
    with sessions() as former:
        former.connection(execution_options={"isolation_level": "REPEATABLE READ"})
        assert len(roads_in(former, boxes).ids) == 10
        imported(sessions, chain(6))
        assert_whole(found(sessions, boxes), chain(6).along(boxes))
        assert len(roads_in(former, boxes).ids) == 10
    assert len(found(sessions, boxes).ids) == 6


def test_two_databases_do_not_mix(
    sessions: Sessions,
    cluster: EmbeddedPostgres,
    template_db: str,
    new_database: Callable[[str], str],
    chain: Chain,
) -> None:
    name = new_database(template_db)
    engine = make_engine(cluster.url_of(name))
    other = session_factory(engine)
    try:
        imported(sessions, chain(10))
        imported(other, chain(3))
        boxes = np.array([chain(10).bounds_deg()])
        assert [len(found(one, boxes).ids) for one in (sessions, other, sessions)] == [10, 3, 10]
    finally:
        engine.dispose()
        drop_database(cluster.url, name)


def test_what_a_window_needs_is_found_by_the_index(sessions: Sessions, chain: Chain) -> None:
    """A map of 40,000 segments: the roads around a drive cost no look at all the others."""
    n = 40_000
    k = np.arange(n)
    table = chain(n, lon0_deg=8 + 0.001 * (k % 200), lat0_deg=48 + 0.001 * (k // 200),
                  lon1_deg=8.001 + 0.001 * (k % 200), lat1_deg=48 + 0.001 * (k // 200))  # fmt: skip
    imported(sessions, table)
    plans: list[str] = []

    def explain(connection: Any, cursor: Any, statement: str, values: Any, *_: Any) -> None:
        if "segments" in statement:
            rows = connection.connection.execute("EXPLAIN " + statement, values).fetchall()
            plans.append("\n".join(row[0] for row in rows))

    event.listen(sessions.kw["bind"], "before_cursor_execute", explain)
    box = np.array([[8.05, 48.05, 8.06, 48.06]])
    assert_whole(found(sessions, box), table.along(box))
    assert len(plans) == 1
    assert "ix_segments_geom" in plans[0]
    assert "Seq Scan on segments" not in plans[0]
    with sessions() as session:
        values = {"ids": np.arange(1, 200), "partitions": [33 << 6 | 21]}
        lines = fetch_binary(session, "EXPLAIN " + solve.KNOWN, values)
    plan = "\n".join(line for (line,) in lines)
    assert "Append" not in plan  # of all parts of the passes one is looked into
    assert "segments" not in plan
