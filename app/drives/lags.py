"""How late a drive's altimeter is, found among all drives before the drive is published.

The step is ``fusion.pipeline.factors_for_lag``, as for logs at hand. It is repeated before the network is owned: others
go on publishing meanwhile.
"""

from __future__ import annotations

import uuid
from dataclasses import replace

from app.core.db import Sessions
from app.network.results import in_database
from app.network.solve import lag_among_all
from fusion.methods.base import DriveResult
from fusion.pipeline import LAG_ROUNDS, factors_for_lag
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
        anew = factors_for_lag(result, factors, lag)
        if anew is None:
            break
        factors = anew
    return replace(result, factors=factors)
