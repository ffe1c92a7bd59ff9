"""One drive that is there twice counts once, whichever came first."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from sqlalchemy import text
from sqlalchemy.exc import OperationalError

from app.core.blobs import BlobStore
from app.core.db import Sessions
from app.drives import claims, publishing
from app.drives import store as drives
from app.network import results
from app.network.settle import settle_network
from fusion.network import duplicates as same_drives
from fusion.network.duplicates import DriveTrace, is_duplicate
from fusion.network.pass_factor import PassFactor
from fusion.roads.table import RoadTable
from fusion.types import Ints
from network_support import (
    Rows,
    accepted_by_drive,
    assert_settled,
    delete,
    drive_over,
    new_drive,
    pass_over,
    passes_of,
    publish,
    rows_of,
)

Chain = Callable[..., RoadTable]
ROWS = range(6)
BEGIN_S = 1_700_000_000.0


def duplicate_of(sessions: Sessions, drive: uuid.UUID) -> uuid.UUID | None:
    with sessions() as session:
        found = drives.get_drive(session, drive)
    assert found is not None
    return found.duplicate_of


def drive(
    sessions: Sessions,
    table: RoadTable,
    ids: Ints,
    rows: int,
    apart_s: float = 0.0,
    first: int = 0,
    epoch_s: Sequence[float] = (),
) -> uuid.UUID:
    """A drive over all rows from ``first`` on, of so many measurements a pass, so much later than others."""
    said = dict.fromkeys(ROWS, (2.0, 0.5))
    made = passes_of(table, said, begin_s=BEGIN_S + apart_s, rows=rows)
    one = new_drive(sessions)
    publish(sessions, one, ids, made[first:], epoch_s)
    return one


@pytest.fixture
def alone(sessions: Sessions, chain: Chain, segment_ids: Ints) -> Rows:
    """What the better of two logs of a drive publishes, alone."""
    one = drive(sessions, chain(), segment_ids, 9)
    settle_network(sessions)
    found = rows_of(sessions)
    delete(sessions, one)
    return found


@pytest.mark.parametrize("better_first", [True, False])
def test_the_log_with_more_measurements_counts(
    sessions: Sessions, chain: Chain, segment_ids: Ints, better_first: bool
) -> None:
    made = {
        n: drive(sessions, chain(), segment_ids, n, n / 100) for n in ((9, 5) if better_first else (5, 9))
    }
    assert duplicate_of(sessions, made[5]) == made[9]
    assert duplicate_of(sessions, made[9]) is None
    assert {good for (one, _), good in accepted_by_drive(sessions).items() if one == made[5]} == {False}
    assert {row[2] for row in rows_of(sessions).values()} == {1}
    delete(sessions, made[9])
    assert duplicate_of(sessions, made[5]) is None
    assert set(accepted_by_drive(sessions).values()) == {True}
    assert {row[2] for row in rows_of(sessions).values()} == {1}
    delete(sessions, made[5])
    assert rows_of(sessions) == {}


def test_which_drive_counts_does_not_depend_on_the_order(
    sessions: Sessions, chain: Chain, segment_ids: Ints, alone: Rows
) -> None:
    for n in (5, 9, 7):
        drive(sessions, chain(), segment_ids, n)
    settle_network(sessions)
    assert_settled(alone, rows_of(sessions))


def test_the_report_of_a_duplicate_names_the_original(
    sessions: Sessions, chain: Chain, segment_ids: Ints
) -> None:
    weak, strong = (drive(sessions, chain(), segment_ids, n) for n in (5, 9))
    for one in (weak, strong):
        with sessions.begin() as session:
            claims.mark_publishing(
                session,
                one,
                report={"warnings": ["first"]},
                bounds=(8.5, 49.0, 8.51, 49.0),
                epochs=5,
                distance_m=100.0,
                drive_time=None,
            )
    publishing.finish(sessions, BlobStore("memory://blobs"))
    with sessions() as session:
        told = {one: drives.get_drive(session, one) for one in (weak, strong)}
    first, second = told[weak].report["warnings"]  # type: ignore[union-attr, index]
    assert first == "first"
    assert f"a duplicate of {strong}" in second
    assert told[strong].report["warnings"] == ["first"]  # type: ignore[union-attr, index]


@pytest.mark.parametrize(("apart_s", "first", "same"), [(0.09, 0, True), (0.11, 0, False), (0.0, 4, True)])
def test_moments_of_entering_decide(
    sessions: Sessions, chain: Chain, segment_ids: Ints, apart_s: float, first: int, same: bool
) -> None:
    one = drive(sessions, chain(), segment_ids, 9)
    other = drive(sessions, chain(), segment_ids, 5, apart_s, first)
    assert duplicate_of(sessions, other) == (one if same else None)


@pytest.mark.parametrize(
    ("period_s", "phase_s", "apart_s", "same"),
    [(1.0, 0.0, 0.05, True), (1.0, 0.4, 0.0, False), (10.0, 0.0, 0.9, True), (60.0, 0.0, 3.1, False)],
)
def test_epochs_decide_too(
    sessions: Sessions,
    chain: Chain,
    segment_ids: Ints,
    period_s: float,
    phase_s: float,
    apart_s: float,
    same: bool,
) -> None:
    """Between positions far apart entries are less sure, to a bound; other epochs are another receiver's."""
    every_s = BEGIN_S + np.arange(200)
    one = drive(sessions, chain(), segment_ids, 9, epoch_s=every_s)
    other = drive(sessions, chain(), segment_ids, 5, apart_s, epoch_s=every_s[:: int(period_s)] + phase_s)
    assert duplicate_of(sessions, other) == (one if same else None)


def test_a_log_of_the_last_lap_is_of_the_drive(sessions: Sessions, chain: Chain, segment_ids: Ints) -> None:
    table = chain()
    laps = [
        pass_over(table, row, 2.0, 0.5, begin_s=BEGIN_S, sequence=10 * lap + row)
        for lap in range(3)
        for row in ROWS
    ]
    whole, last = new_drive(sessions), new_drive(sessions)
    publish(sessions, last, segment_ids, laps[12:])
    publish(sessions, whole, segment_ids, laps)
    assert (duplicate_of(sessions, whole), duplicate_of(sessions, last)) == (None, whole)


def test_three_quarters_of_a_drive_in_common_is_two_drives(
    sessions: Sessions, chain: Chain, segment_ids: Ints
) -> None:
    table = chain()
    one = drive_over(sessions, table, segment_ids, dict.fromkeys((0, 1, 2, 3), (2.0, 0.5)), begin_s=BEGIN_S)
    other = new_drive(sessions)
    made = passes_of(table, dict.fromkeys((0, 1, 2, 9), (2.0, 0.5)), begin_s=BEGIN_S)
    publish(sessions, other, segment_ids, made)
    assert duplicate_of(sessions, one) is duplicate_of(sessions, other) is None


def test_another_run_decides_anew(sessions: Sessions, chain: Chain, segment_ids: Ints) -> None:
    table = chain()
    weak, strong = (drive(sessions, table, segment_ids, n) for n in (5, 9))
    said = dict.fromkeys(ROWS, (2.0, 0.5))
    publish(sessions, weak, segment_ids, passes_of(table, said, begin_s=BEGIN_S, rows=20))
    assert (duplicate_of(sessions, weak), duplicate_of(sessions, strong)) == (None, weak)
    publish(sessions, weak, segment_ids, passes_of(table, said, begin_s=BEGIN_S + 900, rows=20))
    assert (duplicate_of(sessions, weak), duplicate_of(sessions, strong)) == (None, None)
    assert {row[2] for row in rows_of(sessions).values()} == {2}
    publish(sessions, weak, segment_ids, [])
    assert {row[2] for row in rows_of(sessions).values()} == {1}


COPIES = 12


@pytest.mark.parametrize("better", [False, True])
def test_the_cost_of_a_copy_does_not_grow_quadratically(
    sessions: Sessions, chain: Chain, segment_ids: Ints, monkeypatch: pytest.MonkeyPatch, better: bool
) -> None:
    for k in range(COPIES):
        drive(sessions, chain(), segment_ids, 5, k / 1000)
    compared = []

    def counted(one: DriveTrace, other: DriveTrace) -> bool:
        compared.append(1)
        return is_duplicate(one, other)

    monkeypatch.setattr(results, "is_duplicate", counted)
    monkeypatch.setattr(same_drives, "is_duplicate", counted)
    last = drive(sessions, chain(), segment_ids, 9 if better else 5, COPIES / 1000)
    assert (duplicate_of(sessions, last) is None) == better
    assert len(compared) <= (3 * COPIES if better else 2)


def test_what_is_decided_one_by_one_is_what_is_decided_at_once(
    sessions: Sessions, chain: Chain, segment_ids: Ints
) -> None:
    """Copies, better and worse ones in any order, and parts of them that are the same as some only."""
    rng = np.random.default_rng(7)
    said = [(n, first, apart) for n in (4, 6, 9, 9) for first in (0, 2) for apart in (0.0, 0.06, 0.12)]
    for k in rng.permutation(len(said)):
        rows, first, apart_s = said[k]
        drive(sessions, chain(), segment_ids, rows, apart_s, first)
    with sessions() as session:
        every = set(session.execute(text("SELECT id FROM drives")).scalars())
        rows_, again = results._assign(session, results._connected(session, every))
        assert {row.id for row in rows_} == every
        named = {row.id: rows_[again[k]].id if k in again else None for k, row in enumerate(rows_)}
        assert {row.id: row.duplicate_of for row in rows_} == named
    assert len(set(named.values())) > 2


def waits(sessions: Sessions, held: Sequence[PassFactor], wanted: Sequence[PassFactor]) -> bool:
    """Whether a drive that is about to store some passes waits for another that is at it."""
    one, other = new_drive(sessions), new_drive(sessions)
    with sessions() as session, sessions() as beside:
        results.begin_change(session, one, held)
        beside.execute(text("SET LOCAL lock_timeout = '200ms'"))
        try:
            results.begin_change(beside, other, wanted)
        except OperationalError:
            return True
        return False


def test_drives_of_a_place_and_hour_come_one_after_the_other(
    sessions: Sessions, streets_apart: tuple[RoadTable, Ints]
) -> None:
    table, ids = streets_apart

    def over(rows: range, begin_s: float) -> list[PassFactor]:
        made = passes_of(table, dict.fromkeys(rows, (2.0, 0.5)), begin_s=begin_s)
        return list(results.in_database([factor for factor, _ in made], ids))

    here = over(range(8), BEGIN_S)
    assert waits(sessions, here, over(range(8), BEGIN_S))
    assert not waits(sessions, here, over(range(8), BEGIN_S + 7200.0))
    assert not waits(sessions, here, over(range(8, 16), BEGIN_S))


@pytest.mark.parametrize("apart_s", [-2.9, 2.9])
def test_the_same_entry_at_the_edge_of_an_hour_is_of_both_hours(
    sessions: Sessions, streets_apart: tuple[RoadTable, Ints], apart_s: float
) -> None:
    table, ids = streets_apart
    full_hour_s = 3600.0 * round(BEGIN_S / 3600.0)
    one, other = (
        [replace(factor.over(int(ids[0])), first_time_s=moment_s)]
        for factor, _ in passes_of(table, {0: (2.0, 0.5)})
        for moment_s in (full_hour_s, full_hour_s + apart_s)
    )
    assert waits(sessions, one, other)
    assert waits(sessions, other, one)


def test_a_drive_that_is_removed_keeps_others_out_where_it_was(
    sessions: Sessions, streets_apart: tuple[RoadTable, Ints]
) -> None:
    table, ids = streets_apart
    stored = drive_over(sessions, table, ids, dict.fromkeys(range(8), (2.0, 0.5)), BEGIN_S)
    made = passes_of(table, dict.fromkeys(range(16), (2.0, 0.5)), begin_s=BEGIN_S)
    factors = results.in_database([factor for factor, _ in made], ids)
    for passes, expected in ((factors[:8], True), (factors[8:], False)):
        with sessions() as session, sessions() as beside:
            results.begin_change(session, stored)
            beside.execute(text("SET LOCAL lock_timeout = '200ms'"))
            with pytest.raises(OperationalError) if expected else nullcontext():
                results.begin_change(beside, new_drive(sessions), passes)
