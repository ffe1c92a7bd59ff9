"""How late altimeters are: found by a network's solution, after which what their drives say is made anew."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence, Set
from typing import Protocol

import numpy as np

from fusion.methods.base import DriveResult
from fusion.network.pass_factor import PassFactor
from fusion.network.segment_slopes import Adjustment
from fusion.types import Bools, Progress

LAG_ROUNDS, LAG_SETTLED_S = 6, 0.3
"""How often factors are made anew for altimeters that are late, and what counts as settled."""
LAG_GAIN, LAG_STEP_S = 1.3, 2.5
"""The response to a lag is taken from smoothed grades, which are too flat: steps are lengthened, within a bound."""
LARGEST_PART = 0.5
"""Of a network: what is larger is not solved by itself before all is."""
OFF_AMONG_ALL = 2.0
"""A lag that stands where its drive drove may be off by so many times as much among all, so that one drive is no reason
to solve all once more."""


class MadeAnew(Protocol):
    """Solves some rows (n,), and makes the factors anew of drives whose lag is another by ``settled_s`` or more, s."""

    def __call__(
        self, part: Bools, among: Collection[int] | None, settled_s: float
    ) -> tuple[Adjustment | None, Set[int]]:
        """The solution, None where only the rest is known from before, and which drives ``among`` all these were."""
        ...


def with_settled_lags(
    every: Bools,
    altimeters: Set[int],
    adjusted: Callable[[Bools], Adjustment],
    made_anew: MadeAnew,
    around: Callable[[Set[int]], Bools],
) -> Adjustment:
    """The solution of ``every`` row (n,), where no lag of the drives with ``altimeters`` is another than was thought.

    Drives whose lag does not stand yet are followed where they drove (``around``), which takes less than all does. A
    lag that stands there may be a little off among all.
    """
    late = altimeters
    for _ in range(LAG_ROUNDS):
        stands_there = False
        for _ in range(LAG_ROUNDS):
            if not late:
                break
            part = every & around(late)
            if part.sum() > LARGEST_PART * every.sum():
                break
            late = made_anew(part, late, LAG_SETTLED_S)[1]
            stands_there = not late
        result, late = made_anew(every, None, LAG_SETTLED_S * (OFF_AMONG_ALL if stands_there else 1.0))
        if not late:
            return adjusted(every) if result is None else result
    return adjusted(every)


def factors_for_lag(
    result: DriveResult,
    factors: Sequence[PassFactor],
    lag_s: float | None,
    settled_s: float = LAG_SETTLED_S,
    progress: Progress | None = None,
) -> Sequence[PassFactor] | None:
    """The factors of a drive made anew for the altimeter's lag that a network's solution finds, ``lag_s``.

    ``factors`` are those that were solved. None where the lag is settled, or nothing is known of one: the factors stay.
    A drive alone rarely shows the lag: where everybody drives the same way, lag and slope look alike.
    """
    if result.late_by is None or lag_s is None:
        return None
    next_s = next_lag(factors[0].lag_s, lag_s, settled_s)
    if next_s is None:
        return None
    return result.late_by(next_s) if progress is None else result.late_by(next_s, progress)


def next_lag(before_s: float, lag_s: float, settled_s: float = LAG_SETTLED_S) -> float | None:
    """The lag to try after ``before_s``, seconds, where a solution finds ``lag_s``; None where it is settled."""
    step_s = float(np.clip(LAG_GAIN * (lag_s - before_s), -LAG_STEP_S, LAG_STEP_S))
    return None if abs(step_s) < settled_s else before_s + step_s
