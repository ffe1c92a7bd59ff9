"""Method ``odometer-map``: Lahrech, Boucher, Choquel and Noyer 2005.

An extended Kalman filter of nine states follows GNSS positions; where they fail, the rotations of the rear wheels and
then the matched road carry it on. Its rule for an outage is each epoch's own: no fix at this epoch, or one so far off
that the filter takes it for wrong. Between the fixes of a slow receiver nothing fails, and nothing is fused there.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fusion.errors import MissingSensorError
from fusion.methods.base import DriveResult
from fusion.published.epochs.line import ErrorShares, line_slopes
from fusion.published.epochs.table import Epochs, build_epochs
from fusion.published.matchers.base import PointMatch
from fusion.published.nine_state.protocol import PredictedMap
from fusion.published.nine_state.run import DriveRun
from fusion.published.nine_state.surroundings import Roads, Terrain
from fusion.published.odometer_map.filter import OdometerMapFilter
from fusion.published.odometer_map.options import OdometerMapOptions
from fusion.published.odometer_map.wheels import WheelSensors, rotations_between, with_inertial_turns
from fusion.roads.network import RoadNetwork
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, Floats, Progress, Track

_USUAL_STEPS = 1.5  # of the time between fixes: the next one came in time, so none was due between

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
        raise MissingSensorError(
            "The log has no altitude (alt_msl_m or height_ell_m) and no DEM that this method may use covers it: there "
            "is nothing to measure slopes from. Record altitudes, or import a DEM of the area."
        )
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
    return DriveRun(epochs, network, engine, options, sensors, terrain, paper, roads), engine


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
        return replace(
            exact, x_m=float(x[best]), y_m=float(y[best]), distance_m=float(along[best]), mahalanobis=d
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
    counts, (factor, sigma) = engine.counts, engine.scale
    return {
        "policy": options.policy,
        "match_gate": options.match_gate,
        "gnss_epochs": counts["gnss"],
        "wheel_epochs": counts["wheels"],
        "speed_epochs": counts["speed"],
        "map_epochs": counts["map"],
        "open_loop_epochs": counts["open_loop"],
        "wheel_scale": factor,
        "wheel_scale_sigma": sigma,
        "warnings": _outage_warnings(engine),
    }


def _outage_warnings(engine: OdometerMapFilter) -> list[str]:
    """What a driver should know of stretches that could be bridged badly only."""
    rows = []
    if engine.blind["everything"]:
        rows.append(
            f"{engine.blind['everything']} epochs have no position, and neither wheel rotations nor a speed: the "
            "motion before and the map alone bridge them. Record wheel_left_rad and wheel_right_rad, or odo_speed_mps."
        )
    if engine.blind["turns"]:
        rows.append(
            f"{engine.blind['turns']} epochs have no position, and a speed but nothing that feels turns: where the "
            "vehicle turned off, the estimate went straight on. Record both wheels, a gyroscope or yaw."
        )
    return rows
