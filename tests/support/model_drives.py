"""Measurements of a drive at constant speed, drawn from the linear model of method ``profile``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from fusion.frames import GRAVITY_MPS2
from fusion.network.curve import RANDOM_WALK_M
from fusion.network.pass_factor import USUAL_SPEED_PRESSURE
from fusion.profile.measurements import ALTITUDE, BARO, DOPPLER, FORCE, PITCH, Measurements
from fusion.profile.model import DRIFT_TAU_S, GUST_MPS, GUST_TAU_S, WANDER_TAU_S, Noise, SmootherEpochs
from fusion.profile.noise import Learned, learn
from fusion.profile.prior import prior_of

SPEED_MPS = 10.0
MOUNT_GRADE = 0.02
BIAS_GRADE = 0.005
FINE = 50
"""Steps of the road to a second."""


@dataclass(frozen=True, eq=False)
class Simulated:
    """Measurements of a drive at constant speed, and the true grade at its epochs."""

    measured: Measurements
    epochs: SmootherEpochs
    grade: np.ndarray

    def learned(self) -> Learned:
        return learn(self.measured, self.epochs, prior_of(self.measured))


def grades(
    rng: np.random.Generator, seconds: int, roughness: float, length_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Grades once a second, and the rise since the second before: an Ornstein-Uhlenbeck process in fine steps.

    It begins anywhere; a random walk begins near level.
    """
    if length_m == RANDOM_WALK_M:
        grade = np.cumsum(np.sqrt(roughness * SPEED_MPS) * rng.normal(size=seconds))
        # The area under a random walk between two steps, given both ends, has a spread of its own.
        bridge = np.sqrt(roughness * SPEED_MPS**3 / 12) * rng.normal(size=seconds)
        return grade, SPEED_MPS * 0.5 * (grade + np.r_[grade[0], grade[:-1]]) + bridge
    fine = SPEED_MPS / FINE
    left, spread = np.exp(-fine / length_m), np.sqrt(roughness * length_m / 2)
    begin = spread * rng.normal()
    change = spread * np.sqrt(-np.expm1(-2 * fine / length_m)) * rng.normal(size=seconds * FINE)
    grade = np.concatenate([[begin], lfilter([1.0], [1.0, -left], change, zi=[left * begin])[0]])
    rise = fine * 0.5 * (grade[1:] + grade[:-1])
    return grade[FINE::FINE], rise.reshape(seconds, FINE).sum(axis=1)


def gusts(rng: np.random.Generator, seconds: int, speed_mps: np.ndarray | float = SPEED_MPS) -> np.ndarray:
    """What they add to a barometer's heights at these speeds, once a second."""
    out, stay = rng.normal(size=seconds), np.exp(-1 / GUST_TAU_S)
    for k in range(1, seconds):
        out[k] = stay * out[k - 1] + np.sqrt(1 - stay**2) * out[k]
    return np.asarray(USUAL_SPEED_PRESSURE * speed_mps * GUST_MPS / GRAVITY_MPS2 * out)


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

    Without pitch and force the grade is a random walk: such a drive takes it for one.

    ``mount_step`` and ``height_step``: (share of the drive, size). ``tails``: errors follow Student's t of 3 degrees of
    freedom instead of Gauss.
    """
    rng = np.random.default_rng(seed)
    n = seconds
    time = np.arange(float(n))
    learns_lengths = PITCH in sensors or FORCE in sensors
    grade, rise = grades(rng, n, truth.roughness, truth.grade_length_m if learns_lengths else RANDOM_WALK_M)
    height = 200 + np.cumsum(rise)
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
    air = np.zeros(n)
    if BARO in sensors:
        air = np.cumsum(np.sqrt(truth.baro_drift) * rng.normal(size=n)) + gusts(rng, n)
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
    Noise(
        grade_length_m=100.0, roughness=1e-6, altitude_m=0.3, drift=0.05, doppler=0.5, pitch=0.006, force=0.01
    ),
    Noise(
        grade_length_m=100.0, roughness=1e-5, altitude_m=0.6, drift=0.2, doppler=1.0, pitch=0.012, force=0.02
    ),
    Noise(
        grade_length_m=100.0, roughness=1e-4, altitude_m=1.5, drift=1.0, doppler=3.0, pitch=0.02, force=0.03
    ),
)
