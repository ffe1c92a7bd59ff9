"""How the network is written: one writer after the other, all or nothing, and no more than changed."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Collection
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import TimeoutError as FutureTimeout
from dataclasses import replace

import numpy as np
import pytest
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.embedded.cluster import EmbeddedPostgres
from app.network import cells, marks, swap
from app.network.settle import settle_network
from fusion.roads.table import RoadTable
from fusion.simulate.scene.town import Town
from fusion.types import Ints
from network_support import (
    Rows,
    append,
    assert_at_once,
    assert_same,
    assert_settled,
    count_of,
    delete,
    drive_over,
    new_drive,
    passes_of,
    rows_of,
    walks,
)
from road_support import replace_roads

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
    settle_network(sessions)
    settled = rows_of(sessions)
    assert_at_once(at_once, settled)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda drive: delete(sessions, drive), made))
    assert rows_of(sessions) == {}
    for one in said:
        drive_over(sessions, *streets, one)
    assert_same(settled, rows_of(sessions))
    settle_network(sessions)
    assert_settled(settled, rows_of(sessions))


def test_a_swap_that_breaks_off_leaves_what_stood_and_the_marks(
    sessions: Sessions, streets: Driven, town: Town, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, two = walks(town, 2)
    drive_over(sessions, *streets, one)

    def state() -> tuple[Rows, Rows, list[tuple[object, ...]]]:
        with sessions() as session:
            versions = [
                tuple(row) for row in session.execute(text("SELECT id, version FROM cells ORDER BY id"))
            ]
        return rows_of(sessions), rows_of(sessions, "network_slopes"), versions

    before = state()
    with monkeypatch.context() as patch:
        patch.setattr(swap, "raise_versions", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            drive_over(sessions, *streets, two)
    assert state() == before
    assert count_of(sessions, "network_marks") > 0
    swap.solve_all_marked(sessions)
    after = state()
    assert all(now != then for now, then in zip(after, before, strict=True))
    assert count_of(sessions, "network_marks") == 0


def test_a_solution_that_is_out_of_date_is_found_again(
    sessions: Sessions, streets: Driven, town: Town, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While one solver computes, a drive comes and another solver writes in one of the cells."""
    one, two, three = walks(town, 3)
    drive_over(sessions, *streets, one)
    genuine, tries = swap.solve_around, []

    def slowly(session: Session, touched: Collection[int]) -> object:
        found = genuine(session, touched)
        tries.append(len(touched))
        if len(tries) == 1:
            append(sessions, new_drive(sessions), streets[1], passes_of(streets[0], three))
            with sessions.begin() as other:
                cells.raise_versions(other, cells.cells_over(other, touched)[:1])
        return found

    monkeypatch.setattr(swap, "solve_around", slowly)
    drive_over(sessions, *streets, two)
    assert len(tries) == 2
    assert tries[1] > tries[0]  # with what came
    at_once = rows_of(sessions)
    settle_network(sessions)
    assert_same(at_once, rows_of(sessions))


def test_what_no_solver_survives_does_not_keep_the_others_from_their_work(
    sessions: Sessions, streets_apart: Driven, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of two streets is more than any solver can bear."""
    table, ids = streets_apart
    heavy = set(ids[:8].tolist())
    genuine = swap.solve_around

    def solve(session: Session, touched: Collection[int]) -> object:
        if heavy & set(touched):
            raise MemoryError
        return genuine(session, touched)

    monkeypatch.setattr(swap, "solve_around", solve)
    for rows in (range(8), range(8, 16)):
        append(sessions, new_drive(sessions), ids, passes_of(table, dict.fromkeys(rows, (2.0, 0.5))))
    for _ in range(marks.PATIENCE + 1):
        with pytest.raises(MemoryError):
            swap.solve_marked(sessions)
    assert swap.solve_marked(sessions) == 1
    assert rows_of(sessions).keys() == set(ids[8:].tolist())
    assert swap.solve_marked(sessions) == 0  # for half a minute
    monkeypatch.undo()
    swap.solve_all_marked(sessions)
    assert len(rows_of(sessions)) == 16


def test_only_what_changed_is_written(sessions: Sessions, streets: Driven, town: Town) -> None:
    for one in walks(town, 3):
        drive_over(sessions, *streets, one)
    settle_network(sessions)
    query = text("SELECT 'a', segment_id, xmin::text FROM segment_slopes UNION ALL "
                 "SELECT 'n', segment_id, xmin::text FROM network_slopes ORDER BY 1, 2")  # fmt: skip
    with sessions() as session:
        before = session.execute(query).all()
    settle_network(sessions)
    with sessions() as session:
        assert session.execute(query).all() == before
    version = cells.data_version(session)
    with sessions.begin() as session:
        marks.append_marks(session, rows_of(sessions).keys())
    swap.solve_all_marked(sessions)
    with sessions() as session:
        assert cells.data_version(session) == version


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
    settle_network(sessions)
    at = node_heights(sessions, streets)
    assert sum(len(heights) > 1 for heights in at.values()) <= 0.02 * len(at)


def test_a_version_rises_where_something_changed_and_only_there(
    sessions: Sessions, streets_apart: Driven
) -> None:
    """Tiles over one of them do not see what happens on the other, those over both do."""
    table, ids = streets_apart
    tiles = {
        "here": (14, 8579, 5626), "there": (14, 8624, 5626), "here from afar": (10, 536, 351), "both": (6, 33, 21)
    }  # fmt: skip

    def tags() -> dict[str, str]:
        with sessions() as session:
            return {name: cells.tile_tag(session, *tile) for name, tile in tiles.items()}

    def changed(before: dict[str, str]) -> set[str]:
        return {name for name, tag in tags().items() if tag != before[name]}

    seen = tags()
    drive = drive_over(sessions, table, ids, dict.fromkeys(range(8), (2.0, 0.5)))
    assert changed(seen) == {"here", "here from afar", "both"}
    seen = tags()
    drive_over(sessions, table, ids, dict.fromkeys(range(8, 16), (2.0, 0.5)))
    assert changed(seen) == {"there", "both"}
    seen = tags()
    delete(sessions, drive)
    assert changed(seen) == {"here", "here from afar", "both"}
    seen = tags()
    with sessions.begin() as session:
        other = replace(
            table, name=np.array(["Weg" if i < 8 else name for i, name in enumerate(table.name)], object)
        )
        replace_roads(session, other, "x", "1" * 64)
    assert changed(seen) == {"here", "here from afar", "both"}


@pytest.mark.parametrize("held", ["SELECT FROM cells FOR UPDATE", "SELECT pg_advisory_xact_lock(1448300116)"])
def test_what_others_hold_is_left_for_later_and_no_error_to_the_server(
    sessions: Sessions, cluster: EmbeddedPostgres, streets: Driven, town: Town, held: str
) -> None:
    """Cells that another solver writes, a network that an import owns: found again, without a wait cut off."""
    one, two = walks(town, 2)
    drive_over(sessions, *streets, one)
    append(sessions, new_drive(sessions), streets[1], passes_of(streets[0], two))
    begun = cluster.log_path.stat().st_size
    with ThreadPoolExecutor(1) as pool:
        with sessions.begin() as other:
            other.execute(text(held))
            solved = pool.submit(swap.solve_all_marked, sessions)
            with pytest.raises(FutureTimeout):
                solved.result(0.5)
            assert count_of(sessions, "network_marks") > 0
        solved.result(60)
    assert count_of(sessions, "network_marks") == 0
    with cluster.log_path.open("rb") as log:
        log.seek(begun)
        assert b"lock timeout" not in log.read()
