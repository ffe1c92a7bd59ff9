"""Old passes are read condensed: what is read is bounded, and condensed passes can be subtracted whatever happens."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from sqlalchemy import text

from app.core.db import Sessions, fetch_binary
from app.network import condensed, passes, settle, solve, swap
from app.network.cells import partitions_around
from condensed_support import TINY, assert_sums_hold, ten_drives
from factor_support import street
from fusion.roads.table import RoadTable
from fusion.types import Ints
from network_support import (
    accepted_by_drive,
    append,
    count_of,
    delete,
    drive_over,
    new_drive,
    pass_over,
    passes_of,
    publish,
    rows_of,
)
from road_support import replace_roads

Chain = Callable[..., RoadTable]
Driven = tuple[RoadTable, Ints]


@pytest.mark.usefixtures("tiny")
def test_a_segment_reads_recent_passes_however_many_passes_there_were(
    sessions: Sessions, chain: Chain, segment_ids: Ints
) -> None:
    table, ids = chain(), segment_ids.tolist()
    for made in range(1, 24):
        day = 86_400.0 * made
        drive_over(sessions, table, segment_ids, dict.fromkeys(range(6), (2.0 + 0.01 * made, 0.5)), day)
        with sessions() as session:
            read = passes.passes_over(session, ids[:1])
        assert min(made, TINY) <= len(read) <= 2 * TINY
        newest = sorted(p.factor.first_time_s for p in read)
        assert newest[-1] == day
        assert np.all(np.diff(newest) == 86_400.0)
    found = rows_of(sessions)[ids[0]]
    assert found[2:] == (23, 23 * 5)
    assert assert_sums_hold(sessions).keys() == set(ids[:6])
    assert count_of(sessions, "condensed_passes") == 6


def test_a_segment_with_fewer_passes_has_no_sum(
    sessions: Sessions, chain: Chain, segment_ids: Ints, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(condensed, "RECENT_PASSES", 5)
    ten_drives(sessions, chain(), segment_ids)
    assert count_of(sessions, "condensed_passes") == 0


def plan_of(sessions: Sessions, query: str, values: dict[str, object]) -> str:
    with sessions() as session:
        return "\n".join(
            row[0] for row in fetch_binary(session, f"EXPLAIN (ANALYZE, TIMING OFF) {query}", values)
        )


def old_pass(drive: int, day: float, number: int) -> condensed.StoredPass:
    factor, _ = pass_over(street(80.0), 0, 2.0, 0.5, begin_s=86_400.0 * day)
    return condensed.StoredPass(number, uuid.UUID(int=drive), True, factor)


@pytest.mark.usefixtures("tiny")
def test_laps_of_a_drive_stay_together() -> None:
    """Recent passes are those of the newest drives as wholes; the newest drive stays even if it has more of them."""
    laps = [old_pass(7, 1.0, k) for k in range(3)]
    singles = [old_pass(k, 2.0 + k, 10 + k) for k in range(2)]
    assert condensed.passes_to_condense([*laps, *singles, old_pass(9, 0.5, 20)]) == []
    two_old = [old_pass(9, 0.5, 20), old_pass(8, 0.4, 21)]
    assert condensed.passes_to_condense([*laps, *two_old, *singles]) == [*two_old[::-1], *laps]
    many = [old_pass(7, 9.0, k) for k in range(8)]
    assert condensed.passes_to_condense([*many, *singles]) == singles
    assert condensed.passes_to_condense(many) == []


def test_drives_are_condensed_as_wholes_and_in_portions() -> None:
    old = [old_pass(k // 3, 1.0, k) for k in range(9)]
    assert [[p.id for p in some] for some in condensed.portions(old, 4)] == [[0, 1, 2, 3, 4, 5], [6, 7, 8]]
    assert list(condensed.portions([], 4)) == []


def test_the_map_is_up_to_date_before_old_passes_are_condensed(
    sessions: Sessions, chain: Chain, segment_ids: Ints, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[object] = []
    monkeypatch.setattr(swap, "condense_old_passes", lambda *_: order.append("condensed"))
    append(sessions, new_drive(sessions), segment_ids, passes_of(chain(), {0: (2.0, 0.5)}))
    swap.solve_marked(sessions, published=lambda: order.append(count_of(sessions, "network_marks")))
    assert order == [0, "condensed"]


@pytest.fixture
def crowded(sessions: Sessions, chain: Chain, segment_ids: Ints) -> uuid.UUID:
    """A drive over a street each segment of which has 3000 condensed passes, beside 7 recent ones."""
    drive = drive_over(sessions, chain(), segment_ids, dict.fromkeys(range(6), (2.0, 0.5)))
    with sessions.begin() as session:
        session.execute(
            text(
                """
            INSERT INTO drive_passes (drive_id, segment_id, entered_s, condensed_weight, sequence, partition, factor)
            SELECT drive_id, segment_id, k, CASE WHEN k > 6 THEN 1 END, k, partition, factor
            FROM drive_passes, generate_series(1, 3006) AS k
            """
            )
        )
        session.execute(text("ANALYZE drive_passes"))
    return drive


def test_what_is_condensed_is_not_even_looked_at(
    sessions: Sessions, crowded: uuid.UUID, segment_ids: Ints
) -> None:
    """Of the 16 parts of the table only that of the partition is; there an index knows the recent passes."""
    assert crowded
    ids = segment_ids[:6].tolist()
    with sessions() as session:
        partitions = passes.partitions_of(session, ids)
        assert partitions == [33 << 6 | 21]  # x and y of the tile of zoom 6
        assert len(passes.passes_over(session, ids)) == 42
    plan = plan_of(sessions, passes.OVER, {"ids": ids, "partitions": partitions})
    assert "Append" not in plan, plan  # one part
    assert "_segment_id_idx " in plan, plan
    assert "actual rows=42 " in plan, plan
    assert "Rows Removed" not in plan, plan


def test_whether_a_segment_is_driven_is_one_look(
    sessions: Sessions, crowded: uuid.UUID, segment_ids: Ints
) -> None:
    """Of 3007 passes over each of them."""
    assert crowded
    of_segment = {"id": int(segment_ids[0])}
    with sessions() as session:
        cell = session.execute(text("SELECT cell FROM segments WHERE id = :id"), of_segment).scalar_one()
        plans = [
            session.execute(text(f"EXPLAIN (ANALYZE, TIMING OFF) {query.text}"), values).scalars().all()
            for query, values in ((settle._IN_NETWORK_OF_CELL, {"cell": cell}), (settle._CELLS, {}))
        ]
        known = {"ids": segment_ids, "partitions": partitions_around(np.array([cell]))}
        rows = fetch_binary(session, f"EXPLAIN (ANALYZE, TIMING OFF) {solve.KNOWN}", known)
        plans.append([line for (line,) in rows])
        for plan in map("\n".join, plans):
            scans = [line for line in plan.splitlines() if " on drive_passes_of_" in line]
            looked = [line for line in scans if "never executed" not in line]
            assert looked
            assert all("actual rows=1 " in line or "actual rows=0 " in line for line in looked), plan


def test_a_drive_is_looked_for_where_it_was_only(sessions: Sessions, crowded: uuid.UUID) -> None:
    with sessions() as session:
        there = session.execute(text("SELECT DISTINCT partition FROM drive_passes")).scalars().all()
        values = condensed.of_drive(session, crowded)
    assert values["partitions"] == there
    plan = plan_of(
        sessions, f"SELECT id FROM drive_passes WHERE {condensed.OF_DRIVE.format('%(', ')s')}", values
    )
    assert "Append" not in plan, plan


@pytest.mark.usefixtures("tiny")
@pytest.mark.parametrize("oldest_first", [True, False])
def test_deleted_drives_are_subtracted_from_condensed_passes(
    sessions: Sessions, chain: Chain, segment_ids: Ints, oldest_first: bool
) -> None:
    made = ten_drives(sessions, chain(), segment_ids)
    assert assert_sums_hold(sessions)
    for drive in made if oldest_first else made[::-1]:
        delete(sessions, drive)
        assert_sums_hold(sessions)
        with sessions() as session:  # none of turned signs, which would tell what the drive had said
            twice = "SELECT count(*) FROM (SELECT FROM condensed_passes GROUP BY segment_id HAVING count(*) > 1) AS s"
            assert session.execute(text(twice)).scalar_one() == 0
    assert rows_of(sessions) == {}
    assert count_of(sessions, "condensed_passes") == 0
    assert count_of(sessions, "drive_passes") == 0


@pytest.mark.usefixtures("tiny")
def test_a_drive_that_says_something_else_is_subtracted_from_condensed_passes(
    sessions: Sessions, chain: Chain, segment_ids: Ints
) -> None:
    table = chain()
    made = ten_drives(sessions, table, segment_ids)
    before = rows_of(sessions)[int(segment_ids[0])]
    publish(sessions, made[0], segment_ids, passes_of(table, {0: (2.0, 0.05)}, 0.0))
    assert_sums_hold(sessions)
    after = rows_of(sessions)
    assert after[int(segment_ids[0])][1] < 0.6 * before[1]
    assert (after[int(segment_ids[0])][2], after[int(segment_ids[5])][2]) == (10, 9)


@pytest.mark.usefixtures("tiny")
def test_what_contradicts_is_condensed_with_no_weight(
    sessions: Sessions, chain: Chain, segment_ids: Ints
) -> None:
    table = chain()
    good = [drive_over(sessions, table, segment_ids, {0: (2.0, 0.3)}, 86_400.0 * k + 5000) for k in range(4)]
    odd = drive_over(sessions, table, segment_ids, {0: (9.0, 0.3)}, 10.0)
    ten_drives(sessions, table, segment_ids, 6)
    here = int(segment_ids[0])
    with sessions() as session:
        weights = {
            row[0]: row[1]
            for row in session.execute(text("SELECT drive_id, condensed_weight FROM drive_passes"))
        }
    assert weights[odd] == 0.0
    assert min(weights[k] for k in good[:2]) > 0.1
    assert not accepted_by_drive(sessions)[odd, here]
    assert rows_of(sessions)[here][2] == 10  # not the odd one
    assert_sums_hold(sessions)
    delete(sessions, odd)
    assert_sums_hold(sessions)
    assert count_of(sessions, "rejected_passes") == 0


@pytest.mark.usefixtures("tiny")
def test_a_drive_that_turns_out_to_be_a_duplicate_leaves_the_condensed_passes(
    sessions: Sessions, chain: Chain, segment_ids: Ints
) -> None:
    table = chain()
    made = ten_drives(sessions, table, segment_ids)
    here = int(segment_ids[0])
    better = new_drive(sessions)
    said = {row: (2.0 + 0.1 * row, 0.5) for row in range(6)}
    publish(sessions, better, segment_ids, passes_of(table, said, 0.0, rows=9))
    with sessions() as session:
        duplicate = session.execute(
            text("SELECT duplicate_of FROM drives WHERE id = :id"), {"id": made[0]}
        ).scalar_one()
    assert duplicate == better
    assert rows_of(sessions)[here][2] == 10
    assert_sums_hold(sessions)
    delete(sessions, better)
    assert rows_of(sessions)[here][2] == 10
    ten_drives(sessions, table, segment_ids + 0, 0)
    assert_sums_hold(sessions)
    for drive in made:
        delete(sessions, drive)
    assert count_of(sessions, "drive_passes") == 0
    assert rows_of(sessions) == {}


@pytest.mark.usefixtures("tiny")
def test_a_segment_that_moves_or_goes_loses_condensed_passes_and_the_others_keep_theirs(
    sessions: Sessions, chain: Chain, segment_ids: Ints
) -> None:
    """One moves a thousand kilometres into another region: nothing of what was measured goes along."""
    table = chain()
    ten_drives(sessions, table, segment_ids)
    drive_over(sessions, table, segment_ids, {1: (30.0, 0.3)}, 5.0)
    keep = np.arange(10) != 3
    lon0, lon1 = table.lon0_deg.copy(), table.lon1_deg.copy()
    lon0[1] += 15.0
    lon1[1] += 15.0
    with sessions.begin() as session:
        other = replace(table, lon0_deg=lon0, lon1_deg=lon1).subset(keep)
        replace_roads(session, other, "x", "1" * 64)
    swap.solve_all_marked(sessions)
    left = set(segment_ids[[0, 2, 4, 5]].tolist())
    assert assert_sums_hold(sessions).keys() == left
    with sessions() as session:
        for table_name in ("drive_passes", "condensed_passes", "rejected_passes"):
            query = text(f"SELECT DISTINCT segment_id FROM {table_name}")
            assert set(session.execute(query).scalars()) <= left
        wrong = text(
            "SELECT count(*) FROM drive_passes AS p JOIN segments AS s ON s.id = p.segment_id "
            "WHERE p.partition <> versant_partition(s.cell)"
        )
        assert session.execute(wrong).scalar_one() == 0
    drive_over(sessions, chain(), segment_ids, {1: (2.0, 0.3)}, 5.0)
    with sessions() as session:
        regions = text("SELECT count(DISTINCT partition) FROM drive_passes")
        assert session.execute(regions).scalar_one() == 2
        assert session.execute(wrong).scalar_one() == 0


@pytest.mark.usefixtures("tiny")
def test_who_asks_for_the_lag_of_a_drive_hears_nothing_of_what_it_said(
    sessions: Sessions, chain: Chain, segment_ids: Ints
) -> None:
    made = ten_drives(sessions, chain(), segment_ids)
    ids = segment_ids.tolist()
    with sessions() as session:
        whole = condensed.condensed_over(session, ids)
        without = condensed.condensed_over(session, ids, made[0])
    assert {one.drives for one in without.values()} == {one.drives - 1 for one in whole.values()}
    delete(sessions, made[0])
    with sessions() as session:
        for segment, one in condensed.condensed_over(session, ids).items():
            assert np.allclose(one.information, without[segment].information, rtol=1e-12)
