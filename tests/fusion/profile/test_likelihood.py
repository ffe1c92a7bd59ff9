"""The sums over a pass against a dense integration: all measurements, walks, gusts, wander and place."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dense_equations import inverted
from fusion.network.curve import height_weights, variable_count
from fusion.network.pass_factor import CONSTANTS, ENTRY, EXIT, NUISANCES
from fusion.profile.factors import likelihoods
from fusion.profile.model import DRIFT, GUST_TAU_S, JUMP_SIGMA
from fusion.profile.traversals import OnTraversals

JOINED_M = 1e-4
"""By so much the error may move at the entry: entry and first state are told apart by nothing else."""
PASSING = 2
"""What is the pass's alone and stays as it is, in units of one sigma: the mount's wander, and its place along the road.
Behind these stand gusts, which come and go."""
GUST = PASSING
ROUNDING = 4 * float(np.finfo(float).eps) / JOINED_M**2
"""What that leaves of the digits of information about an error at the entry."""


@dataclass(frozen=True)
class Pass:
    """A traversal of a segment of ``length_m``, from ``enter_s`` to ``leave_s``."""

    length_m: float
    enter_s: float
    leave_s: float


def path_of(passes: list[Pass]) -> Any:
    """As much of a path as the sums look at."""
    length = np.array([p.length_m for p in passes])
    return SimpleNamespace(
        match=SimpleNamespace(
            segment=np.arange(len(passes)),
            enter_time_s=np.array([p.enter_s for p in passes]),
            leave_time_s=np.array([p.leave_s for p in passes]),
        ),
        network=SimpleNamespace(length_m=length, table=SimpleNamespace(length_m=length)),
    )


def drawn(
    rng: np.random.Generator, passes: list[Pass], sensors: tuple[int, ...] = (-1, 0, 1), most: int = 12
) -> OnTraversals:
    """Random measurements on the passes: some with one time, some just outside of theirs."""
    parts, first = [], [0]
    for one in passes:
        m = int(rng.integers(0, most))
        first.append(first[-1] + m)
        time = np.sort(rng.uniform(one.enter_s - 0.3, one.leave_s + 0.3, m))
        if m > 2:
            time[1] = time[0]
        kind = rng.choice(sensors, m)
        variable, weights = height_weights(rng.uniform(0, one.length_m, m), np.full(m, one.length_m))
        constants = rng.normal(size=(m, len(CONSTANTS))) * (rng.random((m, len(CONSTANTS))) < 0.4)
        passing = rng.normal(size=(m, PASSING + 1)) * (rng.random((m, PASSING + 1)) < 0.5)
        parts.append((variable, weights, constants, passing, kind, rng.normal(size=m), time))
    variable, weights, constants, passing, kind, value, time = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    variance = 10 ** rng.uniform(-2, 1, len(value))
    return OnTraversals(variable, weights, constants, passing, kind, value, variance, time, np.array(first))


Equation = tuple[dict[int, float], float, float]
"""Weights by unknown, value and variance."""


def walk_of(
    data: OnTraversals, one: Pass, mine: np.ndarray, sensor: int, rate: float, jumps_s: np.ndarray, first: int
) -> tuple[list[Equation], dict[int, int], int]:
    """The states of a height sensor's error behind unknown ``first``: their steps, the one that each measurement sees
    and the last one."""
    here, last, state_of = first, one.enter_s, {}
    steps: list[Equation] = []
    for i in [*mine[data.height_sensor[mine] == sensor].tolist(), -1]:
        until = one.leave_s if i < 0 else float(data.time_s[i])
        moved = rate * max(until - last, 0.0)
        if sensor == 0:
            moved += JUMP_SIGMA[DRIFT] ** 2 * int(np.sum((jumps_s > last) & (jumps_s <= until)))
        if moved > 0:
            steps.append(({here: -1.0, here + 1: 1.0}, 0.0, moved))
            here += 1
        last = max(last, until)
        state_of[i] = here
    return steps, state_of, here


def gusts_of(
    data: OnTraversals, one: Pass, mine: np.ndarray, first: int
) -> tuple[list[Equation], dict[int, int], int]:
    """The gusts behind unknown ``first``, one at each time that sees any: how they go on, the one that each measurement
    sees and the next free unknown. What was measured just before the entry counts as measured there."""
    steps: list[Equation] = []
    gust_of: dict[int, int] = {}
    here, last = first - 1, 0.0
    for i in mine[data.passing[mine, GUST] != 0].tolist():
        time = max(float(data.time_s[i]), one.enter_s)
        if here < first:
            steps.append(({first: 1.0}, 0.0, 1.0))
            here = first
        elif time > last:
            left = max(float(np.exp((last - time) / GUST_TAU_S)), 1e-3)
            steps.append(({here: -left, here + 1: 1.0}, 0.0, 1 - left**2))
            here += 1
        last, gust_of[i] = time, here
    return steps, gust_of, here + 1


def dense(
    data: OnTraversals, passes: list[Pass], k: int, rates: tuple[float, float], jumps_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Information, vector and square of pass ``k``, with every inner state written down and integrated out."""
    mine = np.arange(data.first[k], data.first[k + 1])
    knots = int(variable_count(passes[k].length_m))
    kept = knots + NUISANCES
    size = kept + PASSING
    equations: list[Equation] = [({kept + a: 1.0}, 0.0, 1.0) for a in range(PASSING)]
    state_of: dict[int, int] = {}
    leaves: dict[int, int] = {}  # the last state is the unknown at the exit
    for s, rate in enumerate(rates):
        if np.any(data.height_sensor == s):
            equations.append(({knots + ENTRY.start + s: -1.0, size: 1.0}, 0.0, JOINED_M**2))
            steps, states, last = walk_of(data, passes[k], mine, s, rate, jumps_s, size)
            equations += steps
            state_of |= states
            leaves[last], size = knots + EXIT.start + s, last + 1
    steps, gust_of, size = gusts_of(data, passes[k], mine, size)
    equations += steps
    for i in mine.tolist():
        row = {int(data.variable[i]) + a: float(data.weights[i, a]) for a in range(4)}
        row |= {knots + a: float(c) for a, c in enumerate(data.constants[i]) if c}
        row |= {state_of[i]: 1.0} if data.height_sensor[i] >= 0 else {}
        row |= {kept + a: float(data.passing[i, a]) for a in range(PASSING)}
        row |= {gust_of[i]: float(data.passing[i, GUST])} if i in gust_of else {}
        equations.append((row, float(data.value[i]), float(data.variance[i])))
    whole, right, square = np.zeros((size, size), np.longdouble), np.zeros(size, np.longdouble), 0.0
    for row, value, variance in equations:
        at, w = [leaves.get(u, u) for u in row], np.array(list(row.values()), np.longdouble)
        whole[np.ix_(at, at)] += np.outer(w, w) / variance
        right[at] += w * value / variance
        square += value**2 / variance
    inside = np.array([u for u in range(kept, size) if u not in leaves])
    inner = inverted(whole[np.ix_(inside, inside)])
    share = whole[:kept, inside] @ inner
    return (
        np.asarray(whole[:kept, :kept] - share @ whole[inside, :kept], float),
        np.asarray(right[:kept] - share @ right[inside], float),
        float(square - right[inside] @ inner @ right[inside]),
    )


def summed(
    data: OnTraversals, passes: list[Pass], rates: tuple[float, float], jumps_s: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray, float]]:
    return likelihoods(data, path_of(passes), rates, jumps_s)


def assert_as_dense(
    data: OnTraversals, passes: list[Pass], rates: tuple[float, float], jumps_s: np.ndarray
) -> None:
    found = summed(data, passes, rates, jumps_s)
    for k in range(len(passes)):
        information, vector, square = dense(data, passes, k, rates, jumps_s)
        got, said, explained = found[k]
        scale = float(np.abs(information).max())
        np.testing.assert_allclose(got, information, rtol=0, atol=1e-8 * scale + ROUNDING)
        scale = float(np.abs(vector).max())
        np.testing.assert_allclose(said, vector, rtol=0, atol=1e-8 * scale + ROUNDING)
        assert explained == pytest.approx(square, rel=1e-8, abs=ROUNDING)


def passes_of(rng: np.random.Generator, count: int) -> list[Pass]:
    """One behind the other, of any length."""
    out, time = [], 100.0
    for _ in range(count):
        length = float(rng.uniform(3.0, 70.0))
        out.append(Pass(length, time, time + length / float(rng.uniform(4.0, 20.0))))
        time = out[-1].leave_s
    return out


@settings(max_examples=60)
@given(seed=st.integers(0, 2**31), count=st.integers(1, 4), rates=st.tuples(*[st.floats(1e-3, 2.0)] * 2))
def test_sums_are_the_dense_integrals(seed: int, count: int, rates: tuple[float, float]) -> None:
    rng = np.random.default_rng(seed)
    passes = passes_of(rng, count)
    assert_as_dense(drawn(rng, passes), passes, rates, np.array([]))


@pytest.mark.parametrize("sensors", [(-1,), (0,), (1,), (-1, 0), (0, 1)])
def test_whatever_is_measured(sensors: tuple[int, ...]) -> None:
    for seed in range(10):
        rng = np.random.default_rng(seed)
        passes = passes_of(rng, 3)
        assert_as_dense(drawn(rng, passes, sensors), passes, (0.15, 0.01), np.array([]))


def test_a_height_that_jumps_is_free_from_there_on() -> None:
    for seed in range(10):
        rng = np.random.default_rng(seed)
        passes = passes_of(rng, 3)
        data = drawn(rng, passes, (0, 1, -1), most=20)
        middle = 0.5 * (passes[1].enter_s + passes[1].leave_s)
        jumps = np.array([middle, passes[2].leave_s + 5.0])
        assert_as_dense(data, passes, (0.15, 0.01), jumps)


def test_gusts_come_and_go_through_a_stop() -> None:
    """Of a pass that takes minutes: after half a minute nothing is left of a gust."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        passes = [Pass(40.0, 0.0, 400.0), Pass(20.0, 400.0, 402.0)]
        assert_as_dense(drawn(rng, passes, (1, -1)), passes, (0.15, 0.01), np.array([]))


def test_a_pass_that_measured_nothing_says_how_far_errors_walked_and_nothing_else() -> None:
    rng = np.random.default_rng(2)
    passes = [Pass(30.0, 0.0, 6.0), Pass(20.0, 6.0, 10.0)]
    data = drawn(rng, passes, (0,))
    only_first = data._replace(
        **{name: getattr(data, name)[: data.first[1]] for name in OnTraversals._fields if name != "first"},
        first=np.array([0, data.first[1], data.first[1]]),
    )
    information, vector, _ = summed(only_first, passes, (0.2, 0.01), np.array([]))[1]
    knots = int(variable_count(20.0))
    entry, leave = knots + ENTRY.start, knots + EXIT.start
    expected = np.zeros_like(information)
    expected[np.ix_([entry, leave], [entry, leave])] = np.array([[1, -1], [-1, 1]]) / (0.2 * 4 + JOINED_M**2)
    np.testing.assert_allclose(information, expected, atol=1e-6)
    np.testing.assert_allclose(vector, 0.0, atol=1e-12)


def test_lifting_the_road_is_lowering_the_error() -> None:
    """The height sensor alone cannot tell: what it says of heights it says of its error."""
    rng = np.random.default_rng(3)
    passes = passes_of(rng, 4)
    found = summed(drawn(rng, passes, (0, 1)), passes, (0.1, 0.01), np.array([]))
    for k, one in enumerate(passes):
        information, vector, _ = found[k]
        knots = int(variable_count(one.length_m))
        lift = np.zeros(len(vector))
        lift[:knots:2] = 1.0
        lift[knots + len(CONSTANTS) :] = -1.0
        np.testing.assert_allclose(information @ lift, 0, atol=1e-7 * max(np.abs(information).max(), 1))
        assert np.linalg.eigvalsh(information)[0] > -1e-6 * max(np.abs(information).max(), 1)
