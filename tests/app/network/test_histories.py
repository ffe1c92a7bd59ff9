"""Whatever happened in whatever order, the settled map is that of the drives that are left."""

from __future__ import annotations

import uuid
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from app.core.db import Sessions
from app.network import swap
from app.network.settle import settle_network
from fusion.roads.table import RoadTable
from fusion.simulate.scene.town import Town
from fusion.types import Ints
from network_support import append, assert_at_once, count_of, delete, new_drive, passes_of, rows_of, walks

Driven = tuple[RoadTable, Ints]
DRIVES = 6
SETTLED_SIGMAS = 0.01

# What may happen: a drive comes, goes or says something else; a solver takes some squares, and may die over them.
STEPS = st.one_of(
    st.tuples(st.sampled_from(["comes", "goes", "other"]), st.integers(0, DRIVES - 1)),
    st.tuples(st.sampled_from(["solved", "died before", "died after"]), st.just(0)),
)


class Death(Exception):  # noqa: N818  (no error of the program)
    """The solver is gone."""


def die(*_: object, **__: object) -> None:
    raise Death


def solve_some(sessions: Sessions, how: str) -> None:
    if how == "solved":
        swap.solve_marked(sessions)
    else:
        with pytest.MonkeyPatch.context() as patch, suppress(Death):
            patch.setattr(swap, {"died before": "swap", "died after": "delete_marks"}[how], die)
            swap.solve_marked(sessions)


@pytest.mark.slow
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(history=st.lists(STEPS, min_size=4, max_size=14), order=st.permutations(range(DRIVES)))
def test_any_history_ends_in_the_map_of_the_drives_that_are_left(
    sessions: Sessions, streets: Driven, town: Town, history: list[tuple[str, int]], order: list[int]
) -> None:
    table, ids = streets
    said = walks(town, 2 * DRIVES)
    alive: dict[int, tuple[uuid.UUID, int]] = {}

    def come(k: int, what: int) -> None:
        drive = alive[k][0] if k in alive else new_drive(sessions)
        append(sessions, drive, ids, passes_of(table, said[what]))
        alive[k] = drive, what

    for step, k in history:
        if step == "comes" or (step == "other" and k in alive):
            come(k, k + DRIVES * (step == "other"))
        elif step == "goes" and k in alive:
            delete(sessions, alive.pop(k)[0])
        elif step in {"solved", "died before", "died after"}:
            solve_some(sessions, step)
    swap.solve_all_marked(sessions)
    at_once = rows_of(sessions)
    settle_network(sessions)
    settled = rows_of(sessions)
    assert_at_once(at_once, settled)

    left = {k: what for k, (_, what) in alive.items()}
    for drive, _ in alive.values():
        delete(sessions, drive)
    assert rows_of(sessions) == {}
    alive.clear()
    for k in (k for k in order if k in left):
        come(k, left[k])
    swap.solve_all_marked(sessions)
    settle_network(sessions)
    again = rows_of(sessions)
    assert again.keys() == settled.keys()
    for segment, (slope, sigma, *counts) in settled.items():
        assert abs(again[segment][0] - slope) <= SETTLED_SIGMAS * sigma
        assert again[segment][1] == pytest.approx(sigma, rel=SETTLED_SIGMAS)
        assert list(again[segment][2:]) == counts
    for drive, _ in alive.values():
        delete(sessions, drive)
    assert np.all(
        [count_of(sessions, name) == 0 for name in ("network_marks", "drive_passes", "segment_slopes")]
    )
