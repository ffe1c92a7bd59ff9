"""Sums whatever comes when: drives that come and go, solvers that die or are in each other's way."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable, Iterator
from contextlib import suppress

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import text

from app.core.blobs import BlobStore
from app.core.db import Sessions
from app.network import condensed, passes, solve, swap
from app.network import results as slopes
from app.network.marks import MarkedBy
from app.network.settle import settle_network
from condensed_support import TINY, assert_sums_hold, ten_drives
from fusion.roads.table import RoadTable
from fusion.simulate.scene.town import Town
from fusion.types import Ints
from network_support import (
    append,
    count_of,
    delete,
    new_drive,
    passes_of,
    rows_of,
    walks,
)
from processing_support import remove_drive

Chain = Callable[..., RoadTable]
Driven = tuple[RoadTable, Ints]
ALL_SIGMAS, SIGMA_SHARE = 0.1, 0.03
"""What condensing may change of slopes, in sigmas, and of sigmas; drives that carry no errors along."""


# What may happen: a drive comes, goes or says something else; solvers, also such that die before or after a swap.
DRIVES = 10
STEPS = st.one_of(
    st.tuples(st.sampled_from(["comes", "comes", "goes", "other"]), st.integers(0, DRIVES - 1)),
    st.tuples(st.sampled_from(["solved", "died before", "died within"]), st.just(0)),
)


class Death(Exception):  # noqa: N818  (no error of the program)
    """The solver is gone."""


def die(*_: object, **__: object) -> None:
    raise Death


def solve_some(sessions: Sessions, how: str) -> None:
    """A solver that dies before it condensed, or in the middle of it."""
    with pytest.MonkeyPatch.context() as patch, suppress(Death):
        if how == "died before":
            patch.setattr(swap, "condense_old_passes", die)
        elif how == "died within":
            patch.setattr(condensed, "append_condensed", die)
        swap.solve_marked(sessions)


def assert_near(
    found: dict[int, tuple[float, float, int, int]], wanted: dict[int, tuple[float, float, int, int]]
) -> None:
    assert found.keys() == wanted.keys()
    for segment, (slope, sigma, *counts) in wanted.items():
        assert list(found[segment][2:]) == counts
        assert abs(found[segment][0] - slope) <= ALL_SIGMAS * sigma
        assert found[segment][1] == pytest.approx(sigma, rel=SIGMA_SHARE)


@pytest.mark.slow
@pytest.mark.usefixtures("tiny")
@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(history=st.lists(STEPS, min_size=10, max_size=25), order=st.permutations(range(DRIVES)))
def test_any_history_of_condensing_ends_near_what_all_passes_say(
    sessions: Sessions, streets: Driven, town: Town, history: list[tuple[str, int]], order: list[int]
) -> None:
    table, ids = streets
    said = walks(town, 2 * DRIVES)
    alive: dict[int, tuple[uuid.UUID, int]] = {}

    def come(k: int, what: int) -> None:
        drive = alive[k][0] if k in alive else new_drive(sessions)
        append(sessions, drive, ids, passes_of(table, said[what]))
        alive[k] = drive, what

    def all_gone() -> None:
        for drive, _ in alive.values():
            delete(sessions, drive)
        alive.clear()
        assert rows_of(sessions) == {}

    for step, k in history:
        if step == "comes" or (step == "other" and k in alive):
            come(k, k + DRIVES * (step == "other"))
        elif step == "goes" and k in alive:
            delete(sessions, alive.pop(k)[0])
        elif k == 0 and step not in {"goes", "other"}:
            solve_some(sessions, step)
    swap.solve_all_marked(sessions)
    settle_network(sessions)
    assert_sums_hold(sessions)
    settled, left = rows_of(sessions), {k: what for k, (_, what) in alive.items()}
    all_gone()
    for k in (k for k in order if k in left):
        come(k, left[k])
        swap.solve_all_marked(sessions)
    settle_network(sessions)
    assert_sums_hold(sessions)
    again = rows_of(sessions)
    all_gone()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(condensed, "RECENT_PASSES", 10**6)
        for k, what in left.items():
            come(k, what)
        swap.solve_all_marked(sessions)
        settle_network(sessions)
    every = rows_of(sessions)
    assert_near(settled, every)
    assert_near(again, every)
    all_gone()
    assert count_of(sessions, "drive_passes") == count_of(sessions, "rejected_passes") == 0


@pytest.fixture
def about_to_sum(
    sessions: Sessions, chain: Chain, segment_ids: Ints, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[list[uuid.UUID], list[condensed.StoredPass]]]:
    """Ten drives over a street that a solver is about to condense, and which of their passes."""
    with monkeypatch.context() as patch:
        patch.setattr(condensed, "RECENT_PASSES", 100)
        made = ten_drives(sessions, chain(), segment_ids)
    monkeypatch.setattr(condensed, "RECENT_PASSES", TINY)
    with swap.snapshot(sessions) as session:
        solution, shown = solve.solve_around(session, set(segment_ids[:6].tolist()))
        old = solution.old_passes(shown)
    assert {p.drive_id for p in old} == set(made[:7])
    yield made, old


def sum_them(
    sessions: Sessions, old: list[condensed.StoredPass], meanwhile: Callable[[], None] = lambda: None
) -> None:
    with sessions.begin() as session:
        made = condensed.condensed_by_drive(session, old)
        regions = passes.partitions_of(session, {p.factor.segment for p in old})
        condensed.condense(session, old, made, regions)
        meanwhile()


def test_a_drive_that_goes_while_it_is_condensed_is_subtracted(
    sessions: Sessions, about_to_sum: tuple[list[uuid.UUID], list[condensed.StoredPass]]
) -> None:
    """The removal waits for the end of the short transaction, and sees what it wrote."""
    made, old = about_to_sum
    gone = threading.Thread(target=remove_drive, args=(sessions, BlobStore("memory://blobs"), made[0]))

    def begin_removal() -> None:
        gone.start()
        waiting = text("SELECT count(*) FROM pg_stat_activity WHERE wait_event_type = 'Lock'")
        while gone.is_alive():
            with sessions() as session:
                if session.execute(waiting).scalar_one():
                    return

    sum_them(sessions, old, begin_removal)
    gone.join()
    left = assert_sums_hold(sessions)
    assert {one.drives for one in left.values()} == {6}


def test_a_drive_that_is_going_is_not_condensed(
    sessions: Sessions, about_to_sum: tuple[list[uuid.UUID], list[condensed.StoredPass]]
) -> None:
    """Nobody waits for it: the others are condensed."""
    made, old = about_to_sum
    with sessions.begin() as session:
        slopes.begin_change(session, made[0])
        slopes.append_removal(session, MarkedBy(made[0], 1))
        sum_them(sessions, old)
    left = assert_sums_hold(sessions)
    assert {one.drives for one in left.values()} == {6}
    assert {one.passes for one in left.values()} == {6}


def test_a_pass_is_condensed_once(
    sessions: Sessions, about_to_sum: tuple[list[uuid.UUID], list[condensed.StoredPass]]
) -> None:
    _, old = about_to_sum
    for _ in range(2):
        sum_them(sessions, old)
    assert {one.drives for one in assert_sums_hold(sessions).values()} == {7}
    assert count_of(sessions, "condensed_passes") == 6
