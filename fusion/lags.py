"""How late altimeters are: found by a network's solution, after which what their drives say is made anew."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence, Set

import numpy as np

from fusion.methods.base import DriveResult
from fusion.network.pass_factor import PassFactor
from fusion.network.segment_slopes import Adjustment
from fusion.types import Bools

LAG_ROUNDS, LAG_SETTLED_S = 6, 0.3
"""How often factors are made anew for altimeters that are late, and what counts as settled."""
LAG_GAIN, LAG_STEP_S = 1.3, 2.5
"""The response to a lag is taken from smoothed grades, which are too flat: steps are lengthened, within a bound."""
LARGEST_PART = 0.5
"""Of a network: what is larger is not solved by itself before all is."""


def with_settled_lags(
    every: Bools,
    adjusted: Callable[[Bools], Adjustment],
    made_anew: Callable[[Bools, Collection[int] | None], tuple[Adjustment | None, Set[int]]],
    around: Callable[[Set[int]], Bools],
) -> Adjustment:
    """The solution of ``every`` row (n,) after which no altimeter's lag is another than was thought.

    ``made_anew`` solves some rows, and makes the factors anew of all drives, or of those that it is given, whose lag
    does not stand then: the solution, None where only the rest is known from before, and which drives these were.
    ``around`` are the rows that drives passed. Most lags stand after one step. The others are followed where they
    drove, which takes little, and then all is solved (``adjusted``) once more.
    """
    for _ in range(LAG_ROUNDS):
        result, late = made_anew(every, None)
        if not late:
            return adjusted(every) if result is None else result
        for _ in range(LAG_ROUNDS):
            part = every & around(late)
            if not late or part.sum() > LARGEST_PART * every.sum():
                break
            late = made_anew(part, late)[1]
    return adjusted(every)


def factors_for_lag(
    result: DriveResult, factors: Sequence[PassFactor], lag_s: float | None
) -> tuple[PassFactor, ...] | None:
    """The factors of a drive made anew for the altimeter's lag that a network's solution finds, ``lag_s``.

    ``factors`` are those that were solved. None where the lag is settled, or nothing is known of one: the factors stay.
    A drive alone rarely shows the lag: where everybody drives the same way, lag and slope look alike.
    """
    if result.late_by is None or lag_s is None:
        return None
    next_s = next_lag(factors[0].lag_s, lag_s)
    return None if next_s is None else result.late_by(next_s)


def next_lag(before_s: float, lag_s: float) -> float | None:
    """The lag to try after ``before_s``, seconds, where a solution finds ``lag_s``; None where it is settled."""
    step_s = float(np.clip(LAG_GAIN * (lag_s - before_s), -LAG_STEP_S, LAG_STEP_S))
    return None if abs(step_s) < LAG_SETTLED_S else before_s + step_s
