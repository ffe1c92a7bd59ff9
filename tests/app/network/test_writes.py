"""How the network is written: one writer after the other, all or nothing, and no more than changed."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from sqlalchemy import text

from app.core.db import Sessions
from app.network import solve as network
from app.network import surroundings, versions
from app.network.rebuild import rebuild_network
from app.roads import imports as roads
from fusion.roads.table import RoadTable
from fusion.simulate.scene.town import Town
from fusion.types import Ints
from network_support import (
    Rows,
    assert_same,
    count_of,
    delete,
    drive_over,
    rows_of,
    walks,
)

Driven = tuple[RoadTable, Ints]


def test_two_workers_at_once_end_where_one_after_the_other_does(
    sessions: Sessions, streets: Driven, town: Town
) -> None:
    said = walks(town, 8)
    start = threading.Barrier(4)

    def work(lane: int) -> list[uuid.UUID]:
        start.wait()
        return [drive_over(sessions, *streets, said[k]) for k in range(lane, 8, 4)]

    with ThreadPoolExecutor(4) as pool:
        made = [drive for lane in pool.map(work, range(4)) for drive in lane]
    at_once = rows_of(sessions)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda drive: delete(sessions, drive), made))
    assert rows_of(sessions) == {}
    for one in said:
        drive_over(sessions, *streets, one)
    assert_same(at_once, rows_of(sessions))


def test_a_publication_that_breaks_off_leaves_nothing(
    sessions: Sessions, streets: Driven, town: Town, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, two = walks(town, 2)
    drive_over(sessions, *streets, one)

    def state() -> tuple[Rows, Rows, int]:
        return rows_of(sessions), rows_of(sessions, "network_slopes"), count_of(sessions, "drive_passes")

    before = state()
    with monkeypatch.context() as patch:
        patch.setattr(network, "refresh_aggregates", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            drive_over(sessions, *streets, two)
    assert state() == before
    drive_over(sessions, *streets, two)
    assert state() != before


def test_only_what_changed_is_written(sessions: Sessions, streets: Driven, town: Town) -> None:
    for one in walks(town, 3):
        drive_over(sessions, *streets, one)
    rebuild_network(sessions)
    query = text("SELECT 'a', segment_id, xmin::text FROM segment_slopes UNION ALL "
                 "SELECT 'n', segment_id, xmin::text FROM network_slopes ORDER BY 1, 2")  # fmt: skip
    with sessions() as session:
        before = session.execute(query).all()
    rebuild_network(sessions)
    with sessions() as session:
        assert session.execute(query).all() == before
    with sessions.begin() as session:
        versions.own_network(session)
        network.refresh_network(session, rows_of(sessions).keys())
    with sessions.begin() as session:
        versions.own_network(session)
        assert network.adjust_around(session, list(rows_of(sessions))) == []


def node_heights(sessions: Sessions, streets: Driven) -> dict[int, set[float]]:
    """The heights that stand at each node of the network, of all segments that end there."""
    table, ids = streets
    ends = {int(i): k for k, i in enumerate(ids)}
    found: dict[int, set[float]] = {}
    with sessions() as session:
        for segment, *heights in session.execute(
            text(
                "SELECT segment_id, height_from_m, height_to_m FROM segment_slopes WHERE height_from_m IS NOT NULL"
            )
        ):
            row = ends[segment]
            for node, height in zip((table.from_node[row], table.to_node[row]), heights, strict=True):
                found.setdefault(int(node), set()).add(height)
    return found


def test_segments_that_meet_have_one_height_there(sessions: Sessions, streets: Driven, town: Town) -> None:
    """Also where a change is too small to be written for some of them; only edges of windows hold two."""
    for number, one in enumerate(walks(town, 6)):
        drive_over(sessions, *streets, one)
        at = node_heights(sessions, streets)
        two = [max(heights) - min(heights) for heights in at.values() if len(heights) > 1]
        assert len(two) <= (0 if number == 0 else 0.1 * len(at)), (number, len(two), len(at))
    rebuild_network(sessions)
    at = node_heights(sessions, streets)
    assert sum(len(heights) > 1 for heights in at.values()) <= 0.02 * len(at)


def test_the_window_is_found_by_the_index(sessions: Sessions, chain: Callable[..., RoadTable]) -> None:
    """A map of 40,000 segments: the roads around a drive cost no look at all the others."""
    n = 40_000
    k = np.arange(n)
    table = chain(n, lon0_deg=8 + 0.001 * (k % 200), lat0_deg=48 + 0.001 * (k // 200),
                  lon1_deg=8.001 + 0.001 * (k % 200), lat1_deg=48 + 0.001 * (k // 200))  # fmt: skip
    with sessions.begin() as session:
        roads.replace_roads(session, table, "x", "0" * 64)
        values = {"west": [8.05], "south": [48.05], "east": [8.06], "north": [48.06]}
        explain = text("EXPLAIN (FORMAT TEXT) " + surroundings.SURROUNDINGS.text)
        plan = "\n".join(session.execute(explain, values).scalars())
    assert "ix_segments_geom" in plan
    assert "Seq Scan on segments" not in plan


def test_the_data_version_rises_with_every_drive(sessions: Sessions, streets: Driven, town: Town) -> None:
    def version() -> int:
        with sessions() as session:
            return versions.data_version(session)

    seen = [version()]
    drive = drive_over(sessions, *streets, walks(town, 1)[0])
    seen.append(version())
    delete(sessions, drive)
    seen.append(version())
    assert seen == sorted(set(seen))
