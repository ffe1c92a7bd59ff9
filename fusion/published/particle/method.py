"""Method ``particle``: Al Assaad 2020, chapters 2 and 3.

A sequential importance resampling filter of nine states corrects each epoch by GNSS, acceleration, in chapter 3 pitch,
the matched road and the terrain around it, in this order; a line through the altitudes estimated on a segment gives
its slope (3.4.3). The Kalman filters of the background chapter (1.4.2) take the same way: ``KalmanRun`` hands the drive
to ``kalman_loop`` in plain arrays, and answers what the loop stops for, the terrain under a segment.
"""

from __future__ import annotations

import math
import threading
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fusion.errors import MissingSensorError
from fusion.messages import say
from fusion.methods.base import DriveResult
from fusion.published.epochs.levelling import MountPitch, estimate_mount, mount_report, unknown_mount
from fusion.published.epochs.line import ErrorShares, line_slopes
from fusion.published.epochs.table import build_epochs
from fusion.published.nine_state.motion import half_rate, process_noise_rates
from fusion.published.nine_state.run import DriveRun, FilterRun, Terrain
from fusion.published.nine_state.sensors import Sensors
from fusion.published.particle import kalman_loop as loop
from fusion.published.particle.filter import ParticleCloud
from fusion.published.particle.options import ParticleOptions
from fusion.published.threads import at_most_threads
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.terrain.plane import PlaneModel
from fusion.types import DriveLog, Floats, Progress

# numba's portable threading layer aborts the process when two threads enter parallel loops at once.
_PARALLEL = threading.Lock()

# At least; `benchmarks/particle_speed.py` shows the time by number of particles.
_PARTICLES_PER_THREAD = 10_000

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
            cloud = {"particles": options.particles, **run.rows.cloud_report()}
        else:
            run.run(progress)
        track = run.track()
        shares = _SHARES if run.sensors.measures_grade else replace(_SHARES, grade=1.0)
        sigma = mount.sigma if mount is not None and mount.known else 0.0
        slopes = line_slopes(track, shares, sigma, options.min_epochs)
        report = {**cloud, **run.report(), **({} if mount is None else mount_report(mount))}
        return DriveResult(track, slopes, report)


def threads_for(particles: int) -> AbstractContextManager[None]:
    """As many threads as the cloud feeds."""
    return at_most_threads(particles // _PARTICLES_PER_THREAD)


def prepare(
    log: DriveLog, network: RoadNetwork, dem: Dem | None, options: ParticleOptions
) -> tuple[FilterRun, MountPitch | None]:
    """The run of a drive through the filter, and the tilt of the pitch sensor (None where no pitch is used).

    Chapter 2 has no pitch, and the Kalman filter takes none, for it is not linear in the state.

    Raises ``MissingSensorError`` where neither the log nor a DEM has heights.
    """
    epochs = build_epochs(log, network.projection, options.period_s)
    if not np.isfinite(epochs.alt_m).any() and dem is None:
        raise MissingSensorError(say("method.no_height"))
    mount = None
    if options.variant == "ch3" and options.filter != "kf":
        mount = estimate_mount(epochs) if options.level_pitch else unknown_mount("off")
    window = options.dem_window or _WINDOWS[options.variant]
    terrain = (
        None if dem is None else Terrain(dem, window, network, epochs, options, options.antenna_height_m)
    )
    sensors = Sensors(epochs, options, options, mount)
    if options.filter == "sir":
        return DriveRun(epochs, network, options, sensors, terrain, ParticleCloud(options)), mount
    return KalmanRun(epochs, network, options, sensors, terrain, linear=options.filter == "kf"), mount


@dataclass
class KalmanRun(FilterRun):
    """What ``DriveRun`` is to engines, for filters small enough to be compiled whole: ``linear`` or extended."""

    options: ParticleOptions
    linear: bool

    def run(self, progress: Progress) -> None:
        """Process every epoch in order."""
        drive, rules, planes, now = self._drive(), self._rules(), self._planes(), loop.Now.begin()
        e = 0
        while e < len(self.epochs):
            progress("filter", e / len(self.epochs))
            e = loop.advance(drive, self.sensors.columns, rules, self.network.grid, planes, self.rows, now, e)
            if e < len(self.epochs) and self.terrain is not None:
                _look(self.terrain, planes, now)

    def _drive(self) -> loop.EpochInputs:
        ep = self.epochs
        fix = np.column_stack([ep.x_m, ep.y_m, ep.alt_m])
        return loop.EpochInputs(
            ep.time_s, ep.after_outage, ep.has_gnss, fix, ep.speed_mps, self._start_altitude()
        )

    def _start_altitude(self) -> Floats:
        """The fix's own, else that of the ground with the antenna above it."""
        ep, altitude = self.epochs, self.epochs.alt_m.copy()
        without = ep.has_gnss & ~np.isfinite(altitude)
        if self.terrain is not None and without.any():
            ground = self.terrain.below(ep.x_m[without], ep.y_m[without])
            altitude[without] = ground + self.options.antenna_height_m
        return altitude

    def _rules(self) -> loop.Rules:
        o = self.options
        made: dict[str, Any] = {
            "linear": self.linear,
            "half_rate": half_rate(o),
            "process_noise": process_noise_rates(o),
            "map_var_m2": o.map_sigma_m**2,
            "map_var_rad2": o.map_sigma_rad**2,
            "pitch_var_rad2": o.pitch_sigma_rad**2,
            "dem_var_m2": o.dem_sigma_m**2,
        }
        named = {name: getattr(o, name) for name in loop.Rules._fields if name not in made}
        return loop.Rules(**made, **named)

    def _planes(self) -> loop.Planes:
        n = len(self.network)
        kind = np.full(n, loop.NOTHING if self.terrain is None else loop.UNKNOWN, np.int8)
        return loop.Planes(kind, np.zeros((n, 5)))


def _look(terrain: Terrain, planes: loop.Planes, now: loop.Now) -> None:
    """Answer what the loop stopped for."""
    segment = int(now.flags[loop.SEGMENT])
    if planes.kind[segment] == loop.UNKNOWN:
        model = terrain.model(segment)
        if isinstance(model, PlaneModel):
            planes.kind[segment] = loop.PLANE
            planes.plane[segment] = model.a, model.b, model.c + terrain.offset_m, model.x0, model.y0
        else:
            planes.kind[segment] = loop.NOTHING if model is None else loop.OTHER
    if planes.kind[segment] == loop.OTHER:
        height = terrain.height(
            segment, float(now.place[loop.PREDICTED_X]), float(now.place[loop.PREDICTED_Y])
        )
        now.place[loop.GROUND] = math.nan if height is None else height
