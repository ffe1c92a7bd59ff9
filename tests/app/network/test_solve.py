"""Drives that are solved together: what each adds, what is left of it, and in which order."""

from __future__ import annotations

import uuid
from collections.abc import Callable

import numpy as np
import pytest
from sqlalchemy import text

from app.core.db import Sessions
from app.map import store as segments
from app.network import extracts as road_store
from app.network.settle import settle_network
from fusion.network.combine import combine
from fusion.roads.table import RoadTable
from fusion.simulate.scene.town import Town
from fusion.types import Ints
from network_support import (
    accepted_by_drive,
    assert_same,
    assert_settled,
    count_of,
    delete,
    drive_over,
    new_drive,
    pass_over,
    passes_of,
    publish,
    rows_of,
    walks,
)
from road_support import replace_roads

AddDrive = Callable[..., uuid.UUID]
Driven = tuple[RoadTable, Ints]


def test_drives_are_solved_together_and_gaps_between_them_filled(
    sessions: Sessions, chain: Callable[..., RoadTable], segment_ids: Ints
) -> None:
    table = chain()
    said = dict.fromkeys((0, 1, 2, 5, 6), (2.0, 0.5))  # 3 and 4 are 146 m together
    drive_over(sessions, table, segment_ids, said)
    drive_over(sessions, table, segment_ids, dict.fromkeys((1, 2), (2.2, 0.5)))
    found = rows_of(sessions)
    driven = {int(segment_ids[k]): (2 if k in (1, 2) else 1) for k in said}
    assert {i: row[2] for i, row in found.items() if row[2]} == driven
    assert [row[3] for i, row in sorted(found.items())] == [5, 10, 10, 0, 0, 5, 5]
    for slope, sigma, count, _ in found.values():
        assert 1.2 < slope < 2.8
        assert 0.15 < sigma < (0.6 if count else 20.0)
    assert found == rows_of(sessions, "network_slopes")


def test_gaps_are_shown_to_who_asks_for_them(
    sessions: Sessions, chain: Callable[..., RoadTable], segment_ids: Ints
) -> None:
    drive_over(sessions, chain(), segment_ids, dict.fromkeys((0, 1, 3), (2.0, 0.5)))
    gap = int(segment_ids[2])
    with sessions() as session:
        hidden = {row.id: row for row in segments.all_segments(session)}
        shown = {row.id: row for row in segments.all_segments(session, gaps=True)}
        driven = list(segments.all_segments(session, driven=True, gaps=True))
        undriven = list(segments.all_segments(session, driven=False, gaps=True))
        assert segments.count_segments(session, driven=True) == len(driven) == 3
        assert segments.get_segment(session, gap) == hidden[gap]
    assert (hidden[gap].slope_percent, hidden[gap].updated_at) == (None, None)
    assert shown[gap].slope_percent == pytest.approx(2.0, abs=0.5)
    assert (shown[gap].drives, shown[gap].observations) == (0, 0)
    assert gap in {row.id for row in undriven}
    assert {i: row for i, row in shown.items() if i != gap} == {
        i: row for i, row in hidden.items() if i != gap
    }


def test_a_gap_is_gone_when_it_joins_nothing_or_is_driven(
    sessions: Sessions, chain: Callable[..., RoadTable], segment_ids: Ints
) -> None:
    table = chain()
    drive_over(sessions, table, segment_ids, dict.fromkeys((0, 1), (2.0, 0.5)))
    far = drive_over(sessions, table, segment_ids, {3: (2.0, 0.5)})
    between = drive_over(sessions, table, segment_ids, {2: (2.0, 0.5)})
    assert rows_of(sessions)[int(segment_ids[2])][2] == 1
    delete(sessions, between)
    assert rows_of(sessions)[int(segment_ids[2])][2] == 0
    delete(sessions, far)
    assert sorted(rows_of(sessions)) == segment_ids[:2].tolist()


def test_order_does_not_matter_and_rebuilding_changes_next_to_nothing(
    sessions: Sessions, streets: Driven, town: Town
) -> None:
    said = walks(town, 12)
    made = [drive_over(sessions, *streets, one) for one in said]
    first = rows_of(sessions)
    assert max(row[2] for row in first.values()) >= 4
    assert min(row[2] for row in first.values()) == 0
    told: list[tuple[str, float]] = []
    assert settle_network(sessions, lambda *step: told.append(step)) == len(first)
    settled = rows_of(sessions)
    assert_same(first, settled)
    assert {stage for stage, _ in told} == {"slopes"}
    assert [share for _, share in told] == sorted(share for _, share in told)
    for drive in made:
        delete(sessions, drive)
    for relation in ("drive_passes", "network_slopes", "segment_slopes"):
        assert count_of(sessions, relation) == 0
    for k in np.random.default_rng(1).permutation(len(said)).tolist():
        drive_over(sessions, *streets, said[k])
    assert_same(settled, rows_of(sessions))
    settle_network(sessions)
    assert_settled(settled, rows_of(sessions))


def test_a_change_is_followed_as_far_as_it_reaches(
    sessions: Sessions, chain: Callable[..., RoadTable]
) -> None:
    """Where little is known of smooth roads, a good drive tells something of those beyond the usual radius."""
    with sessions.begin() as session:
        replace_roads(session, chain(40), "x", "0" * 64)
        table, ids = road_store.all_roads(session)
    for slope, sigma, driven in ((2.0, 8.0, 40), (5.0, 0.1, 1)):
        before = rows_of(sessions)
        drive_over(sessions, table, ids, dict.fromkeys(range(driven), (slope, sigma)), roughness=1e-6)
    found = rows_of(sessions)
    assert found[int(ids[6])][0] != before[int(ids[6])][0]  # some 370 m away
    settle_network(sessions)
    assert_same(found, rows_of(sessions))


def test_rebuilding_takes_a_new_terrain_into_account(
    sessions: Sessions, chain: Callable[..., RoadTable], segment_ids: Ints
) -> None:
    drive_over(sessions, chain(), segment_ids, {0: (2.0, 0.5), 2: (2.0, 0.5)})
    before = rows_of(sessions)
    with sessions.begin() as session:
        rise = [[12.0 * k, 12.0 * k + 2, 12.0 * k + 4, 12.0 * k + 6, 12.0 * k + 8] for k in range(10)]
        for segment, heights in zip(segment_ids.tolist(), rise, strict=True):
            session.execute(
                text("UPDATE segments SET dem_heights_m = :heights WHERE id = :id"),
                {"heights": heights, "id": segment},
            )
    settle_network(sessions)
    after = rows_of(sessions)
    assert after[int(segment_ids[1])][0] > before[int(segment_ids[1])][0] + 0.1


def test_nothing_is_left_of_a_deleted_drive(sessions: Sessions, streets: Driven, town: Town) -> None:
    said = walks(town, 8)
    for one in said:
        drive_over(sessions, *streets, one)
    before, accepted = rows_of(sessions), accepted_by_drive(sessions)
    settle_network(sessions)
    settled = rows_of(sessions)
    wild = {row: (slope + 8.0, 0.4) for row, (slope, _) in said[0].items()}
    delete(sessions, drive_over(sessions, *streets, wild))
    assert_same(before, rows_of(sessions))
    assert accepted_by_drive(sessions) == accepted
    settle_network(sessions)
    assert_settled(settled, rows_of(sessions))


def test_a_second_run_replaces_the_passes_of_the_first(
    sessions: Sessions, streets: Driven, town: Town
) -> None:
    table, ids = streets
    one, two, three = walks(town, 3)
    drive_over(sessions, *streets, two)
    once = drive_over(sessions, *streets, three)
    wanted, passes = rows_of(sessions), count_of(sessions, "drive_passes")
    publish(sessions, once, ids, passes_of(table, one))
    assert rows_of(sessions).keys() != wanted.keys()
    publish(sessions, once, ids, passes_of(table, three))
    assert count_of(sessions, "drive_passes") == passes
    assert_same(wanted, rows_of(sessions))


def test_a_drive_that_contradicts_the_others_is_rejected_until_it_is_one_of_many(
    sessions: Sessions, chain: Callable[..., RoadTable], segment_ids: Ints
) -> None:
    table = chain()
    here = int(segment_ids[0])
    for slope in (2.0, 2.1):
        drive_over(sessions, table, segment_ids, {0: (slope, 0.3)})
    odd = new_drive(sessions)
    assert publish(sessions, odd, segment_ids, passes_of(table, dict.fromkeys((0, 4), (9.0, 0.3)))) == (2, 1)
    with sessions() as session:
        behind = {row.drive_id: row for row in segments.segment_observations(session, here)}
        own = segments.drive_segment_rows(session, odd)
    assert len(behind) == 3
    assert (behind[odd].accepted, behind[odd].in_network, behind[odd].weight) == (False, True, 0.0)
    assert sum(row.weight for row in behind.values()) == pytest.approx(1.0)
    assert {row.segment.id: row.accepted for row in own} == {here: False, int(segment_ids[4]): True}
    slope, _, count, observations = rows_of(sessions)[here]
    assert slope == pytest.approx(2.3, abs=0.5)
    assert (count, observations) == (2, 10)

    for slope in (9.1, 8.9, 9.05):  # whether stored passes are accepted turns, theirs and its
        drive_over(sessions, table, segment_ids, {0: (slope, 0.3)})
    assert accepted_by_drive(sessions)[odd, here]
    slope, _, count, _ = rows_of(sessions)[here]
    assert slope == pytest.approx(9.0, abs=0.6)
    assert count == 4
    before = rows_of(sessions)
    accepted = accepted_by_drive(sessions)
    settle_network(sessions)
    assert_same(before, rows_of(sessions))
    assert accepted_by_drive(sessions) == accepted


def test_a_drive_that_passes_twice_counts_once(
    sessions: Sessions, chain: Callable[..., RoadTable], segment_ids: Ints
) -> None:
    table = chain()
    drive = new_drive(sessions)
    twice = [pass_over(table, 0, slope, 0.5, sequence=k) for k, slope in enumerate((1.0, 1.2))]
    publish(sessions, drive, segment_ids, twice)
    assert rows_of(sessions)[int(segment_ids[0])][2:] == (1, 10)


def test_slope_only_drives_are_combined_with_the_network(
    sessions: Sessions, chain: Callable[..., RoadTable], segment_ids: Ints, add_drive: AddDrive
) -> None:
    table = chain()
    for day in range(2):
        drive_over(sessions, table, segment_ids, {0: (2.0, 0.5), 2: (2.0, 0.5)}, begin_s=86_400.0 * day)
    alone = rows_of(sessions)
    raw = add_drive(segment_ids, {0: (3.0, 0.4), 1: (7.0, 0.6)})
    own, gap = int(segment_ids[0]), int(segment_ids[1])
    assert rows_of(sessions, "network_slopes") == alone
    slope, sigma, *_ = alone[own]
    whole = combine(np.array([slope, 3.0]), np.array([sigma, 0.4]), np.array([10, 5]))
    both = rows_of(sessions)
    assert both[own] == pytest.approx((whole.slope_percent, whole.slope_sigma_percent, 3, 15))
    assert both[gap] == pytest.approx((7.0, 0.6, 1, 5))  # a guess gives way to a measurement
    delete(sessions, raw)
    assert rows_of(sessions) == alone
