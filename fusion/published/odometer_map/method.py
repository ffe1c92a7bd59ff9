"""Method ``odometer-map``: Lahrech, Boucher, Choquel and Noyer 2005.

An extended Kalman filter of nine states follows GNSS positions; where they fail, the rotations of the rear wheels and
then the matched road carry it on. Its rule for an outage is each epoch's own: no fix at this epoch, or one so far off
that the filter takes it for wrong. Between the fixes of a slow receiver nothing fails, and nothing is fused there.

A log's cumulative wheel rotations become what each wheel turned between two epochs: resets and outages of the counters
end here; what a rotation says about the motion is the filter's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fusion.errors import MissingSensorError
from fusion.messages import say
from fusion.methods.base import DriveResult
from fusion.published.epochs.line import ErrorShares, line_slopes
from fusion.published.epochs.table import Epochs, build_epochs
from fusion.published.matchers.base import PointMatch
from fusion.published.nine_state.protocol import Measurement, PredictedMap, WheelReading
from fusion.published.nine_state.run import DriveRun, Roads, Terrain
from fusion.published.nine_state.sensors import Sensors
from fusion.published.odometer_map.filter import OdometerMapFilter
from fusion.published.odometer_map.options import OdometerMapOptions
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, Floats, Progress, Track

_USUAL_STEPS = 1.5  # of the time between fixes: the next one came in time, so none was due between

# What a counter may do from one sample to the next before it counts as begun anew.
_FASTEST_RADPS = 400.0  # no wheel turns faster: 120 m/s on 0.3 m
_QUICKEST_RADPS2 = 35.0  # nor gathers or loses speed quicker: 10 m/s2 on 0.3 m
_JITTER_RAD = 0.7  # a tick of the coarsest counters, and some
_LONGEST_STEPS = 2.5  # of the usual time between samples: after a longer one nothing is known

# Fitted by likelihood to the errors of 3,000 slopes (three receiver classes on three real roads and the simulated town,
# with and without outages); on other seeds of the same 96 % lie within 1.96 sigma. From positions alone a slope's
# error is the slow error of the heights, with velocities that of the climb.
_SHARES = ErrorShares(
    grade=0.05,
    grade_correlation_s=3.0,
    height=1.0,
    height_correlation_s=120.0,
    white_m=0.05,
    floor_percent=0.35,
)
_SHARES_OF_CLIMB = ErrorShares(
    grade=0.7,
    grade_correlation_s=3.0,
    height=0.4,
    height_correlation_s=80.0,
    white_m=0.05,
    floor_percent=0.27,
)


class OdometerMapMethod:
    """The paper's estimator behind the ``Method`` protocol."""

    name = "odometer-map"
    source = "Lahrech, Boucher, Choquel, Noyer 2005"
    description = "Extended Kalman filter over GNSS positions; wheels and the road map bridge outages."
    needs = (
        "positions with altitude or, failing altitude, a DEM",
        "to bridge outages, wheel rotations or a speed signal; without them the map alone has to do",
    )
    cues = ("altitude", "doppler", "pitch", "specific force")
    options_model = OdometerMapOptions

    def estimate(
        self,
        log: DriveLog,
        network: RoadNetwork,
        dem: Dem | None,
        options: OdometerMapOptions,
        progress: Progress,
    ) -> DriveResult:
        """See ``Method.estimate``."""
        run, engine = prepare(log, network, dem, options)
        run.run(progress)
        track = run.track()
        shares = _SHARES_OF_CLIMB if run.sensors.measures_grade else _SHARES
        slopes = line_slopes(_for_slopes(run, track, shares), shares, 0.0, options.min_epochs)
        return DriveResult(track, slopes, {**run.report(), **_own_report(run, engine, options)})


def prepare(
    log: DriveLog, network: RoadNetwork, dem: Dem | None, options: OdometerMapOptions
) -> tuple[DriveRun, OdometerMapFilter]:
    """The run of a drive and the filter that it leads.

    Raises ``MissingSensorError`` where neither the log nor a DEM has heights.
    """
    epochs = without_waiting(build_epochs(log, network.projection, options.period_s))
    heights = bool(np.isfinite(epochs.alt_m).any())
    used = dem if options.dem == "always" or (options.dem == "missing" and not heights) else None
    if not heights and used is None:
        raise MissingSensorError(say("method.no_height_allowed"))
    terrain = (
        None
        if used is None
        else Terrain(used, options.dem_window, network, epochs, options, options.antenna_height_m)
    )
    paper = options.policy == "paper"
    rotations = rotations_between(log, epochs)
    if options.inertial_turns:
        rotations = with_inertial_turns(rotations, epochs, options)
    sensors = WheelSensors(
        epochs,
        options,
        rotations=rotations,
        radii_m=(options.wheel_radius_left_m, options.wheel_radius_right_m),
        in_outages=paper,
    )
    engine = OdometerMapFilter(options)
    roads = NearRoads(network, options)
    return DriveRun(epochs, network, options, sensors, terrain, engine, paper, roads), engine


def without_waiting(epochs: Epochs) -> Epochs:
    """Without the epochs at which no fix was due, since the next one came in time."""
    fixed = epochs.time_s[epochs.has_gnss]
    if len(fixed) < 2:
        return epochs
    usual = _USUAL_STEPS * float(np.median(np.diff(fixed)))
    after = np.clip(np.searchsorted(fixed, epochs.time_s), 1, len(fixed) - 1)
    keep = epochs.has_gnss | (fixed[after] - fixed[after - 1] > usual)
    return epochs.take(keep)


class NearRoads(Roads):
    """``Roads`` that answer while the position is known to ``match_within_m``: beyond it any road would do.

    With ``map_step_m`` a match is one of the matched segment's points, so far apart, and its end (11).
    """

    def __init__(self, network: RoadNetwork, options: OdometerMapOptions) -> None:
        super().__init__(network, options)
        self._table, self._options = network, options

    def match(self, predicted: PredictedMap, use_heading: bool) -> PointMatch | None:
        """The road point of least Mahalanobis distance, or None where that is outside the gate."""
        widest = float(np.linalg.eigvalsh(predicted.covariance[:2, :2])[-1])
        if widest > self._options.match_within_m**2:
            return None
        exact = super().match(predicted, use_heading)
        if exact is None or self._options.map_step_m is None:
            return exact
        return self._nearest_point(exact, predicted, use_heading)

    def _nearest_point(
        self, exact: PointMatch, predicted: PredictedMap, use_heading: bool
    ) -> PointMatch | None:
        along, x, y = self._points(exact.segment)
        turn = math.remainder(exact.heading_rad - predicted.heading_rad, 2 * math.pi)
        used = slice(0, 3 if use_heading else 2)
        away = np.column_stack([x - predicted.x_m, y - predicted.y_m, np.full(len(x), turn)])[:, used]
        o = self._options
        noise = np.diag([o.map_sigma_m, o.map_sigma_m, o.map_sigma_rad]) ** 2
        spread = (predicted.covariance + noise)[used, used]
        square = np.sum(away * np.linalg.solve(spread, away.T).T, axis=1)
        best = int(np.argmin(square))
        d = math.sqrt(float(square[best]))
        if d > o.match_gate:
            return None
        return exact._replace(
            x_m=float(x[best]), y_m=float(y[best]), distance_m=float(along[best]), mahalanobis=d
        )

    def _points(self, segment: int) -> tuple[Floats, Floats, Floats]:
        """Distances from from_node, x and y of a segment's points, metres."""
        t, length = self._table, float(self._table.length_m[segment])
        along = np.append(np.arange(0.0, length, self._options.map_step_m), length)
        share = along / length if length > 0 else np.zeros(len(along))
        x = t.x0[segment] + share * (t.x1[segment] - t.x0[segment])
        y = t.y0[segment] + share * (t.y1[segment] - t.y0[segment])
        return along, x, y


def _for_slopes(run: DriveRun, track: Track, shares: ErrorShares) -> Track:
    """The track without the heights that nothing measured, and with the climb less sure while the altitude settles.

    After an outage the altitude runs to where the fixes are, several metres in as many seconds, and its sigma falls
    with it. That is no road's climb.
    """
    measured = track.has_gnss | run.rows.ground[run.rows.done]
    fallen = np.maximum(-np.diff(track.alt_sigma_m, prepend=track.alt_sigma_m[0]), 0.0)
    way = np.maximum(track.speed_mps * np.diff(track.time_s, prepend=track.time_s[0] - 1.0), 1.0)
    climb = np.where(track.after_outage, 0.0, fallen / way) / shares.grade
    return replace(
        track,
        alt_m=np.where(measured, track.alt_m, np.nan),
        pitch_sigma_rad=np.hypot(track.pitch_sigma_rad, climb),
    )


def _own_report(run: DriveRun, engine: OdometerMapFilter, options: OdometerMapOptions) -> dict[str, object]:
    factor, sigma = engine.scale
    return {
        "policy": options.policy,
        "match_gate": options.match_gate,
        **{f"{sensor}_epochs": count for sensor, count in engine.counts.items()},
        "wheel_scale": factor,
        "wheel_scale_sigma": sigma,
        "warnings": _outage_warnings(engine),
    }


def _outage_warnings(engine: OdometerMapFilter) -> list[str]:
    """What a driver should know of stretches that could be bridged badly only."""
    rows: list[str] = []
    if engine.blind["everything"]:
        rows.append(say("method.blind", n=engine.blind["everything"]))
    if engine.blind["turns"]:
        rows.append(say("method.without_turns", n=engine.blind["turns"]))
    return rows


@dataclass(frozen=True)
class Rotations:
    """What the wheels turned since the epoch before, radians, forwards positive; NaN where that is not known."""

    left_rad: Floats
    right_rad: Floats

    @property
    def known(self) -> NDArray[np.bool_]:
        """Whether both are."""
        return np.isfinite(self.left_rad) & np.isfinite(self.right_rad)


@dataclass(frozen=True)
class WheelSensors(Sensors):
    """``Sensors`` with wheels of ``radii_m``: at every epoch, or only ``in_outages``, where no fix is used."""

    rotations: Rotations = field(kw_only=True)
    radii_m: tuple[float, float] = field(kw_only=True)
    in_outages: bool = field(kw_only=True)

    def at(self, e: int, dt_s: float, *, use_fix: bool, moving: bool) -> Measurement:
        """See ``Sensors.at``."""
        measured = super().at(e, dt_s, use_fix=use_fix, moving=moving)
        if self.in_outages and use_fix:
            return measured
        left, right = float(self.rotations.left_rad[e]), float(self.rotations.right_rad[e])
        speed = float(self.epochs.odo_mps[e])
        if not math.isfinite(speed):
            # One wheel alone is a speed signal.
            ways = left * self.radii_m[0], right * self.radii_m[1]
            speed = next((way / dt_s for way in ways if math.isfinite(way)), math.nan)
        return replace(measured, wheels=WheelReading(left, right, abs(speed)))


def rotations_between(log: DriveLog, epochs: Epochs) -> Rotations:
    """Rotations at the epochs of a drive, each (n,): the counters read between their samples, never across outages."""
    left, right = (
        _steps(log.odometry.time_s, column, log.outages_s, epochs.time_s)
        for column in (log.odometry.wheel_left_rad, log.odometry.wheel_right_rad)
    )
    return Rotations(left, right)


def with_inertial_turns(rotations: Rotations, epochs: Epochs, options: OdometerMapOptions) -> Rotations:
    """What two wheels would have turned, by a speed signal and a gyroscope or else a yaw, where they are not known."""
    step_s = np.diff(epochs.time_s, prepend=np.nan)
    way = _mean_with_previous(epochs.odo_mps) * step_s
    turn = _mean_with_previous(epochs.turn_radps) * step_s
    by_yaw = np.remainder(np.pi - np.diff(epochs.yaw_rad, prepend=np.nan), 2 * np.pi) - np.pi
    turn = np.where(np.isfinite(turn), turn, by_yaw)
    apart = 0.5 * options.track_width_m * turn
    left = (way - apart) / options.wheel_radius_left_m
    right = (way + apart) / options.wheel_radius_right_m
    known = rotations.known
    return Rotations(np.where(known, rotations.left_rad, left), np.where(known, rotations.right_rad, right))


def _mean_with_previous(values: Floats) -> Floats:
    before = np.concatenate([[np.nan], values[:-1]])
    return 0.5 * (before + values)


def _steps(time_s: Floats, counter_rad: Floats, outages_s: Floats, epochs_s: Floats) -> Floats:
    known = np.isfinite(counter_rad)
    time_s, counter_rad = time_s[known], counter_rad[known]
    unknown = np.full(len(epochs_s), np.nan)
    if len(time_s) < 2:
        return unknown
    unbroken = _unbroken(time_s, counter_rad, outages_s)
    total = np.concatenate([[0.0], np.cumsum(np.where(unbroken, np.diff(counter_rad), 0.0))])
    run = np.concatenate([[0], np.cumsum(~unbroken)])
    here = np.interp(epochs_s, time_s, total, left=np.nan, right=np.nan)
    before = np.clip(np.searchsorted(time_s, epochs_s, side="right") - 1, 0, None)
    after = np.clip(np.searchsorted(time_s, epochs_s, side="left"), None, len(time_s) - 1)
    here[run[before] != run[after]] = np.nan
    steps = unknown
    steps[1:] = np.where(run[before][1:] == run[before][:-1], np.diff(here), np.nan)
    return steps


def _unbroken(time_s: Floats, counter_rad: Floats, outages_s: Floats) -> NDArray[np.bool_]:
    """Whether a counter went on from one sample to the next, (n - 1,): no outage, no reset, no step like no other.

    A counter that begins anew or wraps jumps by more than wheels turn, or at least turns unlike before and after.
    """
    step_s = np.diff(time_s)
    rate = np.diff(counter_rad) / step_s
    unbroken = (step_s <= _LONGEST_STEPS * float(np.median(step_s))) & (np.abs(rate) <= _FASTEST_RADPS)
    for outage in outages_s.tolist():
        unbroken[(time_s[:-1] < outage) & (time_s[1:] >= outage)] = False
    if len(rate) > 1:
        around_s = 0.5 * (step_s[1:] + step_s[:-1])
        change = np.abs(np.diff(rate)) > _QUICKEST_RADPS2 * around_s + _JITTER_RAD / around_s
        # The first and the last step have one neighbour, which decides alone.
        from_left, from_right = np.concatenate([change[:1], change]), np.concatenate([change, change[-1:]])
        unbroken &= ~(from_left & from_right)
    return unbroken
