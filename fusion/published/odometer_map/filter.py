"""The extended Kalman filter of Lahrech et al. 2005: GNSS position (9), wheels (10), map (11)-(12), in this order.

It corrects by whatever it is handed. Whether there is an outage, and which road was matched, is its caller's business.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fusion.published.nine_state.measurements import (
    SLOWEST_MPS,
    gaussian_estimate,
    ground_measurement,
    heading_measurement,
    predicted_map,
)
from fusion.published.nine_state.motion import STATES, VX, VY, VZ, X, Y, Z, whitened
from fusion.published.nine_state.protocol import Estimate, Measurement, PredictedMap, Road, WheelReading
from fusion.published.odometer_map.odometry import Odometry, heading_axes
from fusion.published.odometer_map.options import OdometerMapOptions
from fusion.published.odometer_map.state import BEFORE, SCALE, RememberedHeading, StepState
from fusion.types import Floats

_CLIMB_S = 10.0  # grades hang together so long while driving


class OdometerMapFilter:
    """Implements ``EpochFilter``; when wheels and map count is its caller's rule.

    ``counts`` says how many epochs each sensor corrected; ``open_loop`` are those with neither a fix nor a road, and
    ``blind`` those without a fix that lack turns, or any odometer.
    """

    def __init__(self, options: OdometerMapOptions) -> None:
        self._options = options
        self._odometry = Odometry(options)
        self.counts = dict.fromkeys(("gnss", "wheel", "speed", "map", "open_loop"), 0)
        self.blind = {"turns": 0, "everything": 0}
        self._wheels: tuple[Floats, Floats] = np.zeros(2), self._odometry.scale_covariance
        self._bridging = self._backwards = False
        self._course = self._bend_rad = 0.0
        self._climbing_s: float | None = None

    @property
    def scale(self) -> tuple[float, float]:
        """Factor on the radii, or on the way that a speed signal stands for, and its sigma."""
        mean, covariance = self._wheels
        return 1.0 - float(mean.mean()), 0.5 * math.sqrt(max(float(covariance.sum()), 0.0))

    def restart(self, mean: Floats, sigma: Floats) -> None:
        """See ``EpochFilter``; what was learned of the wheels is kept."""
        self._state = StepState(mean, sigma, self._odometry.rounding_rad, *self._wheels)
        self._heading = RememberedHeading().renewed(*self._state.motion, self._options.min_speed_mps)

    def sense(self, dt_s: float | None, measured: Measurement) -> PredictedMap:
        """See ``EpochFilter``."""
        seen = np.flatnonzero(measured.inv_var > 0)
        self._bridging = dt_s is not None and not len(seen)
        self._climbing_s = None if measured.inv_var[Z] > 0 else dt_s
        if dt_s is not None:
            self._state.widen(self._options, dt_s)
        if len(seen):
            innovation = measured.z[seen] - self._state.mean[seen]
            self._state.correct(innovation, np.eye(STATES)[seen], np.diag(1 / measured.inv_var[seen]))
            self.counts["gnss"] += 1
        rotated = dt_s is not None and self._correct_by(measured.wheels, dt_s)
        self._state.narrow(wheels_read=rotated)
        predicted = predicted_map(*self._state.motion)
        if dt_s is not None:
            # A road drawn as straight pieces turns at its nodes; no piece has the direction of a vehicle that is
            # turning, and each would hold it back.
            self._bend_rad = math.remainder(predicted.heading_rad - self._course, 2 * math.pi)
            predicted.covariance[2, 2] += self._bend_rad**2
        return predicted

    def _correct_by(self, reading: WheelReading | None, dt_s: float) -> bool:
        """(10) by two rotations, or by a speed; whether two rotations were there."""
        self._backwards = False
        mean = self._state.mean
        rotated = reading is not None and math.isfinite(reading.left_rad + reading.right_rad)
        if reading is not None and rotated:
            turned = reading.left_rad, reading.right_rad
            self._look_behind(self._odometry.way_m(*turned), mean[BEFORE])
            read = self._odometry.rotations(mean, dt_s, *turned, self._heading)
            self._heading = self._odometry.turned(self._heading, *turned)
            self.counts["wheel"] += 1
        elif reading is not None and math.isfinite(reading.speed_mps):
            self._heading = self._heading.after_way(reading.speed_mps * dt_s)
            read = self._odometry.speed(mean, reading.speed_mps, self._heading)
            self.counts["speed"] += 1
            self.blind["turns"] += self._bridging
        else:
            if self._bridging:
                self._heading = self._heading.after_way(math.hypot(*mean[BEFORE]) * dt_s)
                self.blind["everything"] += 1
            return False
        self._state.correct(read.innovation, read.jacobian, read.noise)
        return rotated

    def _look_behind(self, way_m: float, velocity: Floats) -> None:
        """Wheels that turn backwards while the vehicle goes where its nose was thought to point: it was the tail."""
        self._backwards = way_m < 0
        if self._backwards and math.hypot(*velocity) >= 2 * self._options.min_speed_mps:
            course = math.atan2(velocity[1], velocity[0])
            if math.cos(course - self._heading.angle_rad) > 0:
                self._heading = self._heading.behind()

    def locate(
        self, road: Road | None, use_heading: bool, ground_m: float | None, inv_var_ground: float
    ) -> Estimate:
        """See ``EpochFilter``."""
        if road is not None:
            self._correct_by_map(road, use_heading)
        self.counts["map"] += road is not None
        self.counts["open_loop"] += self._bridging and road is None
        if ground_m is not None and inv_var_ground > 0:
            self._correct_by_ground(ground_m, inv_var_ground)
        elif self._climbing_s is not None:
            self._bound_climb(self._climbing_s)
        return self._estimate()

    def _correct_by_map(self, road: Road, use_heading: bool) -> None:
        """(12)."""
        o = self._options
        innovation, jacobian = road_measurement(self._state.motion[0], road)
        first = 1 if o.map_correction == "line" else 0
        used = slice(first, 3 if use_heading else 2)
        sigma = np.array([o.map_sigma_m, o.map_sigma_m, math.hypot(o.map_sigma_rad, self._bend_rad)])
        self._state.correct(innovation[used], jacobian[used], np.diag(sigma[used] ** 2))

    def _correct_by_ground(self, ground_m: float, inv_var: float) -> None:
        expected, row = ground_measurement(self._state.motion[0], self._options.antenna_height_m)
        self._state.correct(np.array([ground_m - expected]), row[None], np.array([[1 / inv_var]]))

    def _bound_climb(self, dt_s: float) -> None:
        """Without a height the climb stays as it was for a while, and is that of any road later."""
        state, _ = self._state.motion
        climb = self._options.road_grade_sigma * max(math.hypot(state[VX], state[VY]), SLOWEST_MPS)
        variance = whitened(climb**2, dt_s, _CLIMB_S)
        self._state.correct(np.array([-state[VZ]]), np.eye(STATES)[[VZ]], np.array([[variance]]))

    def _estimate(self) -> Estimate:
        state, covariance = self._state.motion
        slowest = self._options.min_speed_mps
        self._wheels = self._state.mean[SCALE].copy(), self._state.covariance[SCALE, SCALE].copy()
        if not self._backwards:
            trust = not self._bridging
            self._heading = self._heading.renewed(state, covariance, slowest, trust_reversal=trust)
        estimate = gaussian_estimate(state, covariance)
        if math.hypot(state[VX], state[VY]) < slowest and self._heading.known:
            nose = math.remainder(self._heading.angle_rad, 2 * math.pi)
            estimate = replace(estimate, heading_rad=nose)
        self._course = estimate.heading_rad
        return estimate


def road_measurement(state: Floats, road: Road) -> tuple[Floats, Floats]:
    """Innovation (3,) by a matched road point, (6) and (7), and the Jacobian (3, 9) of what it is compared with.

    The rows are turned into the road: position along it, position across it (to its left), direction.
    """
    heading, row = heading_measurement(state)
    jacobian = np.zeros((3, STATES))
    jacobian[:2, [X, Y]] = heading_axes(road[2])
    jacobian[2] = row
    away = np.array([road[0] - state[X], road[1] - state[Y]])
    turn = math.remainder(road[2] - heading, 2 * math.pi)
    return np.append(jacobian[:2, [X, Y]] @ away, turn), jacobian
