"""Method ``particle``: Al Assaad 2020, chapters 2 and 3.

A sequential importance resampling filter of nine states corrects each epoch by GNSS, acceleration, in chapter 3 pitch,
the matched road and the terrain around it, in this order; a line through the altitudes estimated on a segment gives
its slope (3.4.3). The Kalman filters of the background chapter (1.4.2) take the same way.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numba
import numpy as np

from fusion.errors import MissingSensorError
from fusion.methods.base import DriveResult
from fusion.published.epochs.levelling import MountPitch, estimate_mount, mount_report
from fusion.published.epochs.line import ErrorShares, line_slopes
from fusion.published.epochs.table import build_epochs
from fusion.published.nine_state.run import DriveRun
from fusion.published.nine_state.sensors import Sensors
from fusion.published.nine_state.surroundings import Terrain
from fusion.published.particle.filter import ParticleCloud
from fusion.published.particle.kalman_run import KalmanRun
from fusion.published.particle.options import ParticleOptions
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, Progress

# numba's portable threading layer aborts the process when two threads enter parallel loops at once.
_PARALLEL = threading.Lock()

_PARTICLES_PER_THREAD = (
    10_000  # at least; `benchmarks/particle_speed.py` shows the time by number of particles
)

_WINDOWS = {"ch2": "tin", "ch3": "adjacent"}

# How a slope's sigma follows from the cloud's spread. The spread is that of one epoch; what of it survives in a
# slope was fitted once, by likelihood, to the errors on twelve kinds of drives: three receiver classes on three real
# roads and the simulated town (1,600 slopes, 96 % of them within 1.96 sigma).
_SHARES = ErrorShares(
    grade=0.7,
    grade_correlation_s=3.0,
    height=0.5,
    height_correlation_s=60.0,
    white_m=0.05,
    floor_percent=0.3,
)


class ParticleMethod:
    """The thesis's estimator behind the ``Method`` protocol."""

    name = "particle"
    source = "Al Assaad 2020, chapters 2 and 3"
    description = (
        "Particle filter over GNSS, acceleration, pitch, road map and terrain; a line through its altitudes."
    )
    needs = ("positions with altitude or, failing altitude, a DEM",)
    cues = ("altitude", "doppler", "pitch", "specific force")
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
        run, mount = prepare(log, network, dem, options)
        cloud: dict[str, object] = {}
        if isinstance(run, DriveRun):
            with _PARALLEL, threads_for(options.particles):
                run.run(progress)
            cloud = {"particles": options.particles, **run.cloud_report()}
        else:
            run.run(progress)
        track = run.track()
        shares = _SHARES if run.sensors.measures_grade else replace(_SHARES, grade=1.0)
        sigma = mount.sigma if mount is not None and mount.known else 0.0
        slopes = line_slopes(track, shares, sigma, options.min_epochs)
        report = {**cloud, **run.report(), **({} if mount is None else mount_report(mount))}
        return DriveResult(track, slopes, report)


def prepare(
    log: DriveLog, network: RoadNetwork, dem: Dem | None, options: ParticleOptions
) -> tuple[DriveRun | KalmanRun, MountPitch | None]:
    """The run of a drive through the filter, and the tilt of the pitch sensor (None where no pitch is used).

    Chapter 2 has no pitch, and the Kalman filter takes none, for it is not linear in the state.

    Raises ``MissingSensorError`` where neither the log nor a DEM has heights.
    """
    epochs = build_epochs(log, network.projection, options.period_s)
    if not np.isfinite(epochs.alt_m).any() and dem is None:
        raise MissingSensorError(
            "The log has no altitude (alt_msl_m or height_ell_m) and no DEM covers it: there is nothing to "
            "measure slopes from. Record altitudes, or import a DEM of the area."
        )
    mount = None
    if options.variant == "ch3" and options.filter != "kf":
        mount = estimate_mount(epochs) if options.level_pitch else MountPitch(0.0, np.inf, "off")
    window = options.dem_window or _WINDOWS[options.variant]
    terrain = (
        None if dem is None else Terrain(dem, window, network, epochs, options, options.antenna_height_m)
    )
    sensors = Sensors(epochs, options, options, mount)
    if options.filter == "sir":
        return DriveRun(epochs, network, ParticleCloud(options), options, sensors, terrain), mount
    return KalmanRun(epochs, network, options, sensors, terrain, linear=options.filter == "kf"), mount


@contextmanager
def threads_for(particles: int) -> Iterator[None]:
    """As many threads as the cloud feeds: a small one is filtered faster than threads meet at a barrier."""
    before = numba.get_num_threads()
    numba.set_num_threads(max(1, min(before, particles // _PARTICLES_PER_THREAD)))
    try:
        yield
    finally:
        numba.set_num_threads(before)
