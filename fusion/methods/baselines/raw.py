"""Baseline ``raw``: a line through the altitudes as the receiver logged them."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from fusion.errors import MissingSensorError
from fusion.methods.base import DriveResult, Options
from fusion.methods.baselines.matched_fixes import match_fixes
from fusion.methods.epochs.line import AltitudeErrors, LineRule, segment_slopes
from fusion.methods.epochs.table import UNKNOWN_ALTITUDE_SIGMA_M, Epochs, white_altitude_sigma
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, Floats, Progress, Track

_CORRELATION_S = 60.0


class RawOptions(Options):
    """Options of the raw baseline."""

    period_s: float = Field(0.5, gt=0, le=10, description="Shortest time between two epochs, s.")
    min_epochs: int = Field(4, ge=2, le=100, description="Altitudes that a slope needs.")


class RawMethod:
    """The baseline behind the ``Method`` protocol."""

    name = "raw"
    source = "Baseline; matching and line of Al Assaad 2020, 2.3.3.3 and 3.4.3"
    description = "Line through the raw altitudes of the fixes nearest to a segment."
    needs = ("positions with altitude",)
    options_model = RawOptions

    def estimate(
        self, log: DriveLog, network: RoadNetwork, dem: Dem | None, options: RawOptions, progress: Progress
    ) -> DriveResult:
        """See ``Method.estimate``."""
        if not (log.fix.has("alt_msl_m") or log.fix.has("height_ell_m")):
            raise MissingSensorError(
                "Method 'raw' draws a line through altitudes, and the log has none (alt_msl_m or height_ell_m). "
                "Record altitudes, or choose another method."
            )
        progress("match", 0.0)
        epochs, track = match_fixes(log, network, options.period_s)
        slopes = segment_slopes(
            track, _errors(epochs, track).covariance, LineRule(min_epochs=options.min_epochs)
        )
        return DriveResult(track, slopes, {"white_altitude_sigma_m": white_altitude_sigma(epochs)})


def _errors(epochs: Epochs, track: Track) -> AltitudeErrors:
    white = white_altitude_sigma(epochs)
    stated: Floats = np.nan_to_num(epochs.v_acc_m, nan=UNKNOWN_ALTITUDE_SIGMA_M)
    nothing = np.zeros(len(epochs))
    return AltitudeErrors(
        time_s=track.time_s,
        speed_mps=np.nan_to_num(track.speed_mps),
        white_m=np.full(len(epochs), white),
        correlated_m=np.sqrt(np.maximum(stated**2 - white**2, 0.0)),
        correlation_s=_CORRELATION_S,
        grade=nothing,
        grade_correlation_s=1.0,
    )
