"""Measurements of a drive at constant speed, drawn from the linear model of method ``profile``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.profile.levels import prior_noise
from fusion.profile.measurements import ALTITUDE, BARO, DOPPLER, FORCE, PITCH, Measurements
from fusion.profile.model import DRIFT_TAU_S, WANDER_TAU_S, Noise, SmootherEpochs
from fusion.profile.noise import Learned, learn

SPEED_MPS = 10.0
MOUNT_GRADE = 0.02
BIAS_GRADE = 0.005


@dataclass(frozen=True, eq=False)
class Simulated:
    """Measurements of a drive at constant speed, and the true grade at its epochs."""

    measured: Measurements
    epochs: SmootherEpochs
    grade: np.ndarray

    def learned(self) -> Learned:
        return learn(self.measured, self.epochs, prior_noise(self.measured))


def simulate(
    seed: int,
    truth: Noise,
    *,
    seconds: int = 600,
    sensors: tuple[int, ...] = (ALTITUDE, DOPPLER, PITCH, FORCE),
    springs: float = 0.0,
    mount_step: tuple[float, float] = (0.0, 0.0),
    height_step: tuple[float, float] = (0.0, 0.0),
    tails: bool = False,
) -> Simulated:
    """One measurement a sensor and second, drawn from the model; ``springs`` move pitch and force alike.

    ``mount_step`` and ``height_step``: (share of the drive, size). ``tails``: errors follow Student's t of 3 degrees of
    freedom instead of Gauss.
    """
    rng = np.random.default_rng(seed)
    n = seconds
    time = np.arange(float(n))
    grade = np.cumsum(np.sqrt(truth.roughness * SPEED_MPS) * rng.normal(size=n))
    # The area under a random walk between two steps, given both ends, has a spread of its own.
    bridge = np.sqrt(truth.roughness * SPEED_MPS**3 / 12) * rng.normal(size=n)
    height = 200 + np.cumsum(SPEED_MPS * 0.5 * (grade + np.r_[grade[0], grade[:-1]]) + bridge)
    a = np.exp(-1 / DRIFT_TAU_S)
    wander = np.zeros(n)
    for k in range(1, n):
        wander[k] = a * wander[k - 1] + rng.normal() * np.sqrt(0.5 * truth.drift * DRIFT_TAU_S * (1 - a * a))

    def white() -> np.ndarray:
        return np.asarray(rng.standard_t(3, n) / np.sqrt(3) if tails else rng.normal(size=n))

    lean, stay = np.zeros(n), np.exp(-1 / WANDER_TAU_S)
    for k in range(n):
        before = lean[k - 1] if k else rng.normal() * truth.wander
        lean[k] = stay * before + truth.wander * np.sqrt(1 - stay**2) * rng.normal()
    air = np.cumsum(np.sqrt(truth.baro_drift) * rng.normal(size=n)) if BARO in sensors else 0.0
    late = {name: time >= s[0] * n for name, s in (("mount", mount_step), ("height", height_step))}
    body = grade + MOUNT_GRADE + lean + springs * white() + np.where(late["mount"], mount_step[1], 0.0)
    values = {
        ALTITUDE: height
        + wander
        + truth.altitude_m * white()
        + np.where(late["height"], height_step[1], 0.0),
        DOPPLER: grade + truth.doppler * 0.01 * white(),
        PITCH: body + truth.pitch * white(),
        FORCE: body + BIAS_GRADE + truth.force * white(),
    }
    if BARO in sensors:
        values[BARO] = height - 35 + air + truth.baro_m * white()
    m = len(sensors) * n
    order = np.repeat(np.arange(n), len(sensors))
    sensor = np.tile(np.array(sorted(sensors)), n)
    value = np.array([values[s][k] for s, k in zip(sensor.tolist(), order.tolist(), strict=True)])
    stated_sigma = np.where(sensor == DOPPLER, 0.01, np.where(sensor == ALTITUDE, 3.0, np.nan))
    zero = np.zeros(m)
    measured = Measurements(
        time_s=time[order],
        along_m=SPEED_MPS * time[order],
        run=np.zeros(m, np.int64),
        sensor=sensor,
        value=value,
        stated_sigma=stated_sigma,
        speed_mps=np.full(m, SPEED_MPS),
        acceleration_mps2=zero,
        turn=zero,
    )
    epochs = SmootherEpochs(time, SPEED_MPS * time, np.zeros(n, np.int64), np.zeros(n), order)
    return Simulated(measured, epochs, grade)


TRUTHS = (
    Noise(roughness=1e-6, altitude_m=0.3, drift=0.05, doppler=0.5, pitch=0.006, force=0.01),
    Noise(roughness=1e-5, altitude_m=0.6, drift=0.2, doppler=1.0, pitch=0.012, force=0.02),
    Noise(roughness=1e-4, altitude_m=1.5, drift=1.0, doppler=3.0, pitch=0.02, force=0.03),
)
