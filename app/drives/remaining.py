"""How long a drive that is computed will still take: from the time that it has taken and the share that is done.

Shares are about those of the time (``computing.PARTS``). Where it waits for solvers, or has hardly begun, nobody knows.
"""

from __future__ import annotations

LEAST_SHARE, LEAST_S = 0.03, 2.0
"""Before, the share says nothing."""
_STEPS_S = ((60.0, 5.0), (600.0, 30.0), (3600.0, 60.0))
"""Up to so long it is told in such steps: it is no surer, and readers see a change where there is one."""
_LONG_STEP_S = 600.0


def remaining_s(ran_s: float | None, share: float, stage: str | None) -> float | None:
    """Seconds that are left, rounded; None where nobody knows. ``ran_s``: how long it runs, None if it does not."""
    if ran_s is None or stage == "publishing" or share < LEAST_SHARE or ran_s < LEAST_S:
        return None
    left_s = ran_s * (1.0 - share) / share
    step_s = next((step for limit, step in _STEPS_S if left_s <= limit), _LONG_STEP_S)
    return max(step_s * round(left_s / step_s), step_s)
