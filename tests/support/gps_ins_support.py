"""Drives in the plane for the GPS/INS filters, whose noise is exactly the filters' model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.filters.unscented import Unscented
from fusion.published.gps_ins.filter import DriveReadings, Filtered, Settings, run
from fusion.published.gps_ins.models import ExtendedModel, KalmanModel, Model, UnscentedModel

KF, EKF = KalmanModel(), ExtendedModel()
UKF = UnscentedModel(Unscented(1e-3, 2.0, -1.0))
MODELS: dict[str, Model] = {"kf": KF, "ekf": EKF, "ukf": UKF}
COMMAND = Settings(heading="command", min_speed_mps=0.0)


@dataclass(frozen=True)
class Truth:
    """A drive and where the vehicle really was, shape (n,)."""

    drive: DriveReadings
    x_m: np.ndarray
    y_m: np.ndarray

    def errors(self, filtered: Filtered) -> np.ndarray:
        """Distances of the estimates from the truth."""
        return np.asarray(np.hypot(filtered.mean[:, 0] - self.x_m, filtered.mean[:, 1] - self.y_m))

    def run(self, model: Model, settings: Settings) -> np.ndarray:
        """The errors that a filter leaves."""
        return self.errors(run(self.drive, model, settings))

    def gps_errors(self) -> np.ndarray:
        return np.asarray(np.hypot(self.drive.x_m - self.x_m, self.drive.y_m - self.y_m))


def simulate(
    seed: int,
    *,
    steps: int = 100,
    dt_s: float | np.ndarray = 1.0,
    gps_sigma_m: float = 15.0,
    walk_m: float = 0.5,
    fastest_mps: float = 50.0,
    turn_rad: float = 0.0,
    heading_sigma_rad: float = 0.0,
) -> Truth:
    """Chapter 4: speed by a random process, heading constant or turning, the INS's own errors as a walk in place.

    ``walk_m`` is the noise of the displacement per axis and root second, ``turn_rad`` that of the heading, and
    ``heading_sigma_rad`` what the INS's heading is off by on top of it.
    """
    rng = np.random.default_rng([seed, 7])
    dt = np.broadcast_to(np.asarray(dt_s, float), (steps,))
    speed = np.clip(fastest_mps / 2 + np.cumsum(rng.normal(size=steps + 1)), 0.0, fastest_mps)
    heading = rng.uniform(-np.pi, np.pi) + turn_rad * np.cumsum(rng.normal(size=steps + 1))
    move = np.column_stack([np.cos(heading[:-1]), np.sin(heading[:-1])]) * (speed[:-1] * dt)[:, None]
    move += walk_m * np.sqrt(dt)[:, None] * rng.normal(size=(steps, 2))
    place = np.concatenate([np.zeros((1, 2)), np.cumsum(move, axis=0)])
    fix = place + gps_sigma_m * rng.normal(size=place.shape)
    drive = DriveReadings(
        time_s=np.concatenate([[0.0], np.cumsum(dt)]),
        x_m=fix[:, 0],
        y_m=fix[:, 1],
        fix_sigma_m=np.full(steps + 1, gps_sigma_m),
        speed_mps=speed,
        heading_rad=heading + heading_sigma_rad * rng.normal(size=steps + 1),
        heading_sigma_rad=np.full(steps + 1, max(heading_sigma_rad, 1e-3)),
        spread_m=np.zeros(steps + 1),
        restart=np.arange(steps + 1) == 0,
    )
    return Truth(drive, place[:, 0], place[:, 1])


def riccati(steps: int, r: float, q: float) -> np.ndarray:
    """Variance per axis after each of steps + 1 fixes, the first of which starts the filter."""
    variance = [r]
    for _ in range(steps):
        before = variance[-1] + q
        variance.append(before * r / (before + r))
    return np.array(variance)
