"""Method ``particle``: Al Assaad 2020, chapter 3.

A sequential importance resampling filter of nine states corrects each epoch by GNSS, acceleration, pitch,
the matched road and the terrain around it, in this order; a line through the altitudes estimated on a
segment gives its slope (3.4.3).
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numba
import numpy as np

from fusion.errors import MissingSensorError
from fusion.methods.epochs import build_epochs
from fusion.methods.levelling import MountPitch, estimate_mount
from fusion.methods.particle_options import ParticleOptions
from fusion.methods.particle_run import DriveFilter
from fusion.roads.network import RoadNetwork
from fusion.slopes import AltitudeErrors, LineRule, segment_slopes
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, DriveResult, Progress, Track

# numba's portable threading layer aborts the process when two threads enter parallel loops at once.
_PARALLEL = threading.Lock()

_PARTICLES_PER_THREAD = 10_000

# How a slope's sigma follows from the cloud's spread. The spread is that of one epoch; what of it survives in a
# slope was fitted once, by likelihood, to the errors on twelve kinds of drives: three receiver classes on three real
# roads and the simulated town (1,600 slopes, 96 % of them within 1.96 sigma).
_GRADE_SHARE = 0.7
_GRADE_CORRELATION_S = 3.0
_HEIGHT_SHARE = 0.5
_HEIGHT_CORRELATION_S = 60.0
_WHITE_M = 0.05
_FLOOR_PERCENT = 0.3


class ParticleMethod:
    """The thesis's estimator behind the ``Method`` protocol."""

    name = "particle"
    source = "Al Assaad 2020, chapter 3"
    description = (
        "Particle filter over GNSS, acceleration, pitch, road map and terrain; a line through its altitudes."
    )
    needs = ("positions with altitude or, failing altitude, a DEM",)
    options_model = ParticleOptions

    def estimate(
        self,
        log: DriveLog,
        network: RoadNetwork,
        dem: Dem | None,
        options: ParticleOptions,
        progress: Progress,
    ) -> DriveResult:
        """See ``Method.estimate``."""
        epochs = build_epochs(log, network.projection, options.period_s)
        if not np.isfinite(epochs.alt_m).any() and dem is None:
            raise MissingSensorError(
                "The log has no altitude (alt_msl_m or height_ell_m) and no DEM covers it: there is nothing to "
                "measure slopes from. Record altitudes, or import a DEM of the area."
            )
        mount = estimate_mount(epochs) if options.level_pitch else MountPitch(0.0, np.inf, "off")
        run = DriveFilter(epochs, network, dem, options, mount)
        with _PARALLEL, threads_for(options.particles):
            run.filter(progress)
        track = run.rows.build(network.projection)
        if not len(track):
            raise MissingSensorError(
                "No epoch of the log has both a position and a height: it has no altitude (alt_msl_m or height_ell_m), "
                "and the DEM knows none along it. Record altitudes, or import a DEM that covers the drive."
            )
        rule = LineRule(min_epochs=options.min_epochs, floor_percent=_FLOOR_PERCENT)
        slopes = segment_slopes(track, _errors(run, track).covariance, rule)
        return DriveResult(track, slopes, run.report())


@contextmanager
def threads_for(particles: int) -> Iterator[None]:
    """As many threads as the cloud feeds: a small one is filtered faster than threads meet at a barrier."""
    before = numba.get_num_threads()
    numba.set_num_threads(max(1, min(before, particles // _PARTICLES_PER_THREAD)))
    try:
        yield
    finally:
        numba.set_num_threads(before)


def _errors(run: DriveFilter, track: Track) -> AltitudeErrors:
    """How the filter's altitude errors hang together: the cloud's spread in height and in pitch, and the mount."""
    share = _GRADE_SHARE if run.sensors.measures_grade else 1.0
    grade = share * np.nan_to_num(track.pitch_sigma_rad)
    if run.mount.known:
        grade = np.hypot(grade, run.mount.sigma)
    height = _HEIGHT_SHARE * np.nan_to_num(track.alt_sigma_m)
    return AltitudeErrors(
        time_s=track.time_s,
        speed_mps=np.nan_to_num(track.speed_mps),
        white_m=np.full(len(track), _WHITE_M),
        correlated_m=height,
        correlation_s=_HEIGHT_CORRELATION_S,
        grade=grade,
        grade_correlation_s=_GRADE_CORRELATION_S,
    )
