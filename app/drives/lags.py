"""How late a drive's altimeter is, found among all drives before the drive is published.

One drive alone rarely shows it: where everybody drives the same way, lag and slope look alike. The network's solution
corrects the lag, and the factors are made anew until it stands, as ``fusion.pipeline.solve_network`` does with logs at
hand. All of it happens before the network is owned: others go on publishing meanwhile.
"""

from __future__ import annotations

import uuid
from dataclasses import replace

import numpy as np

from app.core.db import Sessions
from app.network.results import in_database
from app.network.solve import lag_among_all
from fusion.methods.base import DriveResult
from fusion.pipeline import LAG_GAIN, LAG_ROUNDS, LAG_SETTLED_S, LAG_STEP_S
from fusion.types import Ints


def with_settled_lag(
    sessions: Sessions, drive_id: uuid.UUID, segment_ids: Ints, result: DriveResult
) -> DriveResult:
    """The result with its factors made anew for the lag that the stored network finds; most results as they are.

    ``segment_ids`` maps the segments of the result's factors to the database's ids.
    """
    factors = result.factors
    if result.late_by is None or not factors:
        return result
    for _ in range(LAG_ROUNDS - 1):
        with sessions() as session:
            lag = lag_among_all(session, drive_id, in_database(factors, segment_ids))
        before = factors[0].lag_s
        step = 0.0 if lag is None else float(np.clip(LAG_GAIN * (lag - before), -LAG_STEP_S, LAG_STEP_S))
        if abs(step) < LAG_SETTLED_S:
            break
        factors = result.late_by(before + step)
    return replace(result, factors=factors)
