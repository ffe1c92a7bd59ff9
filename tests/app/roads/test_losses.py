"""What a road import leaves of the network: passes that still speak of roads that exist, and slopes to match."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import text

from app.core.db import Sessions
from app.map import store as segments
from app.network import extracts as road_store
from app.network import swap
from app.network.settle import settle_network
from app.network.swap import solve_all_marked
from app.roads import imports as roads
from app.roads.documents import ImportCounts, Source, Wishes
from fusion.errors import RoadsError
from fusion.roads.table import RoadTable
from fusion.types import Ints
from network_support import assert_same, drive_over, new_drive, passes_of, publish, rows_of
from road_support import replace_roads

Chain = Callable[..., RoadTable]
AddDrive = Callable[..., uuid.UUID]


def imported(sessions: Sessions, table: RoadTable) -> ImportCounts:
    with sessions.begin() as session:
        counts = replace_roads(session, table, "again.osm", "a" * 64)
    solve_all_marked(sessions)
    return counts


def moved(chain: Chain, row: int) -> RoadTable:
    """The chain with one node between two rows elsewhere: the row's end and the next one's start."""
    lon1, lon0 = 8.5 + 0.001 * np.arange(1, 11), 8.5 + 0.001 * np.arange(10)
    lon1[row] += 1e-4
    return chain(lon0_deg=lon0, lon1_deg=lon1)


def passes(sessions: Sessions) -> list[tuple[uuid.UUID, int]]:
    with sessions() as session:
        rows = session.execute(text("SELECT drive_id, segment_id FROM drive_passes ORDER BY segment_id"))
        return [(row[0], row[1]) for row in rows]


def test_the_same_roads_again_change_nothing(sessions: Sessions, chain: Chain, segment_ids: Ints) -> None:
    for slope in (2.0, 2.5):
        drive_over(sessions, chain(), segment_ids, {0: (slope, 0.5), 1: (slope, 0.5), 3: (slope, 0.5)})
    before, kept = rows_of(sessions), passes(sessions)
    assert imported(sessions, chain()) == ImportCounts("roads", kept=10)
    assert (rows_of(sessions), passes(sessions)) == (before, kept)


def test_a_moved_segment_loses_its_passes_and_its_neighbours_are_solved_anew(
    sessions: Sessions, chain: Chain, segment_ids: Ints
) -> None:
    drive_over(sessions, chain(), segment_ids, {k: (1.0 + k, 0.5) for k in range(4)})
    again = moved(chain, 1)
    assert imported(sessions, again) == ImportCounts("roads", kept=9, far=1, measured_lost=1, drives_again=1)
    found = rows_of(sessions)
    assert found[int(segment_ids[1])][2] == 0  # by now a gap between 0 and 2
    assert [i for _, i in passes(sessions)] == [int(segment_ids[k]) for k in (0, 2, 3)]
    settle_network(sessions)
    assert_same(found, rows_of(sessions))


def test_ways_that_are_turned_round_or_renumbered_keep_what_was_measured(
    sessions: Sessions, chain: Chain, segment_ids: Ints, add_drive: AddDrive
) -> None:
    """At once, and when it is solved again: slopes have the other sign where the way runs the other way."""
    drive_over(sessions, chain(), segment_ids, {k: (1.0 + k, 0.5) for k in range(4)})
    add_drive(segment_ids, {6: (2.0, 1.0)})  # one of slopes alone
    settle_network(sessions)
    before, heights = rows_of(sessions), heights_of(sessions)
    k = np.arange(10)
    lon0, lon1 = 8.5 + 0.001 * k, 8.5 + 0.001 * (k + 1)
    turned = chain(
        osm_way_id=np.where(k < 8, 7, 9), from_node=101 + k, to_node=100 + k, lon0_deg=lon1, lon1_deg=lon0
    )
    with sessions.begin() as session:
        assert replace_roads(session, turned, "x", "0" * 64) == ImportCounts("roads", reversed=10)
    mirrored = {segment: (-slope, *rest) for segment, (slope, *rest) in before.items()}
    assert {segment: (slope, *rest) for segment, (slope, *rest) in rows_of(sessions).items()} == mirrored
    assert heights_of(sessions) == {segment: (b, a) for segment, (a, b) in heights.items()}
    settle_network(sessions)
    for segment, (slope, sigma, *counts) in rows_of(sessions).items():
        assert (slope, sigma) == pytest.approx(mirrored[segment][:2], abs=1e-6)
        assert counts == list(mirrored[segment][2:])
    assert len(passes(sessions)) == 4
    with sessions.begin() as session:
        counts_again = replace_roads(session, chain(way=99), "x", "0" * 64)
    assert counts_again == ImportCounts("roads", reversed=10)
    settle_network(sessions)
    assert_same(rows_of(sessions), before)


def heights_of(sessions: Sessions) -> dict[int, tuple[float, float]]:
    query = text("SELECT segment_id, height_from_m, height_to_m FROM segment_slopes")
    with sessions() as session:
        return {row[0]: (row[1], row[2]) for row in session.execute(query)}


def test_a_dropped_segment_closes_the_gap_that_it_was(
    sessions: Sessions, chain: Chain, segment_ids: Ints
) -> None:
    drive_over(sessions, chain(), segment_ids, dict.fromkeys((0, 1, 4), (2.0, 0.5)))
    assert [row[2] for _, row in sorted(rows_of(sessions).items())] == [1, 1, 0, 0, 1]
    counts = imported(sessions, chain().subset(np.array([0, 1, 3, 4, 5])))
    assert (counts.dropped, counts.measured_lost) == (5, 0)
    assert sorted(rows_of(sessions)) == [int(segment_ids[k]) for k in (0, 1, 4)]


def test_new_roads_between_driven_ones_are_gaps(sessions: Sessions, chain: Chain) -> None:
    imported(sessions, chain().subset(np.array([0, 1, 3])))
    with sessions() as session:
        table, ids = road_store.all_roads(session)
    drive_over(sessions, table, ids, dict.fromkeys(range(3), (2.0, 0.5)))
    assert len(rows_of(sessions)) == 3
    imported(sessions, chain())
    assert sorted(row[2] for row in rows_of(sessions).values()) == [0, 1, 1, 1]


def test_the_passes_before_and_after_a_lost_one_stay(
    sessions: Sessions, chain: Chain, segment_ids: Ints
) -> None:
    table = chain()
    drive = new_drive(sessions)
    publish(sessions, drive, segment_ids, passes_of(table, dict.fromkeys((3, 4, 5), (2.0, 0.5))))
    other = drive_over(sessions, table, segment_ids, {4: (3.0, 0.5)})
    counts = imported(sessions, moved(chain, 3))  # the end of 3, and the start of 4, which keeps its geometry
    assert (counts.far, counts.measured_lost, counts.drives_again) == (1, 1, 1)
    kept = passes(sessions)
    assert sorted(kept, key=str) == sorted(
        [(drive, int(segment_ids[4])), (other, int(segment_ids[4])), (drive, int(segment_ids[5]))], key=str
    )
    with sessions() as session:
        behind = segments.segment_observations(session, int(segment_ids[4]))
    assert {one.drive_id for one in behind} == {drive, other}
    found = rows_of(sessions)
    settle_network(sessions)
    assert_same(found, rows_of(sessions))


def test_a_refusal_names_the_ways_that_collide(
    sessions: Sessions, chain: Chain, segment_ids: Ints, tmp_path: Path
) -> None:
    """A second map, drawn by hand, that counts its ways from the same number on."""
    drive_over(sessions, chain(), segment_ids, {k: (1.0 + k, 0.5) for k in range(4)})
    lon = 9.5 + 0.001 * np.arange(11)
    other = chain(lon0_deg=lon[:-1], lon1_deg=lon[1:])
    ways = sorted({int(way) for way in other.osm_way_id})
    with pytest.raises(
        RoadsError, match=f"numbers of ways of roads the file has other roads: {ways[0]}\\. .*renumber one"
    ):
        roads.bring_in(sessions, other, Source("other.osm", "0" * 64, "other"), tmp_path, Wishes())
    with pytest.raises(RoadsError, match=f"has other roads: {ways[0]}\\. .*--region") as same:
        roads.bring_in(sessions, other, Source("other.osm", "0" * 64, "roads"), tmp_path, Wishes())
    assert "renumber" not in str(same.value)
    assert imported(sessions, chain()) == ImportCounts("roads", kept=10)


def test_roads_stay_though_what_they_change_cannot_be_solved(
    sessions: Sessions,
    chain: Chain,
    segment_ids: Ints,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """They were stored before; whoever imports is told, and what is marked waits for another solver."""
    drive_over(sessions, chain(), segment_ids, {k: (1.0 + k, 0.5) for k in range(4)})
    source = Source("moved.osm", "0" * 64, "roads")

    def fails(*_: object) -> None:
        raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr(swap, "solve_around", fails)
        wishes = Wishes(accept_losses=True)
        assert roads.bring_in(sessions, moved(chain, 1), source, tmp_path, wishes).far == 1
    assert "the roads are in" in caplog.text
    solve_all_marked(sessions)
    drives = {segment: row[2] for segment, row in rows_of(sessions).items()}
    assert drives == dict(zip(segment_ids[:4].tolist(), (1, 0, 1, 1), strict=True))  # a gap now
