# mypy: disable-error-code="arg-type"
"""Drives through a made town, as measurements: half of the satellites reflected, for while, with wrong Doppler."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fusion.frames import local_axes
from fusion.gnss.earth import ecef
from fusion.gnss.measurements import Measurements
from fusion.types import Floats

ORIGIN_M = ecef(np.array([114.2]), np.array([22.3]), np.array([20.0]))[0]
AXES = local_axes(ORIGIN_M[None])[0]
REFLECTED_TO_FRO_S, DELAY_M, CORRELATED_S = 20.0, 35.0, 4.0


@dataclass(frozen=True)
class TownDrive:
    """Measurements with the truth: places (m, 3) in ECEF, speeds (m,), yaw rates (m,) and reflected rows (n,)."""

    measured: Measurements
    truth_m: Floats
    velocity_mps: Floats
    speed_mps: Floats
    yaw_radps: Floats
    reflected: Floats


def town_drive(
    seed: int, epochs: int = 300, step_s: float = 1.0, satellites: int = 16, reflected: float = 0.5
) -> TownDrive:
    """Stops and corners at town speed; two systems; Doppler of 0.2 m/s; delays of tens of metres; a bias each."""
    rng = np.random.default_rng(seed)
    time = np.arange(epochs) * step_s
    speed, yaw, velocity, way = _motion(rng, time)
    azimuth, elevation = rng.uniform(0, 2 * np.pi, satellites), np.arcsin(rng.uniform(0.15, 0.98, satellites))
    turning = azimuth + time[:, None] * 1e-4 * rng.normal(size=satellites)
    level = np.broadcast_to(np.cos(elevation), turning.shape)
    sky = 2.4e7 * np.stack(
        [level * np.sin(turning), level * np.cos(turning), np.broadcast_to(np.sin(elevation), turning.shape)],
        axis=-1,
    )
    rates = np.gradient(sky, step_s, axis=0)
    clock = 1e3 + 60 * time + np.cumsum(rng.normal(0, 0.3, epochs))
    late, wrong = _reflections(rng, speed, velocity, step_s, satellites, reflected)
    sight = sky - way[:, None]
    distance = np.linalg.norm(sight, axis=-1)
    group = np.arange(satellites) % 2
    cn0 = (
        46
        - (late > 0) * rng.uniform(3, 16, satellites)
        + rng.normal(0, 2, late.shape)
        - 6 * (elevation < 0.5)
    )
    noise = rng.normal(size=late.shape) * 0.75 * 10 ** ((45 - cn0) / 20)
    errors = _correlated(rng, late.shape, step_s) + rng.normal(0, 2, satellites) + noise
    ranges = distance + clock[:, None] + 25 * group + late + errors
    radial = np.einsum("kij,kij->ki", rates - velocity[:, None], sight / distance[..., None])
    radial += np.gradient(clock, step_s)[:, None] + wrong + rng.normal(0, 0.2, late.shape)
    seen = rng.random(late.shape) < 0.9
    epoch, satellite = np.nonzero(seen)
    measured = Measurements(
        time_s=1.4e9 + time,
        first=np.append(0, np.cumsum(seen.sum(axis=1))),
        satellite=satellite,
        group=group[satellite],
        pseudorange_m=ranges[epoch, satellite],
        range_rate_mps=radial[epoch, satellite],
        cn0_dbhz=cn0[epoch, satellite],
        sigma_m=np.full(len(epoch), np.nan),
        elevation_rad=elevation[satellite],
        azimuth_rad=azimuth[satellite],
        satellite_m=ORIGIN_M + sky[epoch, satellite] @ AXES,
        satellite_mps=rates[epoch, satellite] @ AXES,
        names=tuple(f"{'GC'[i % 2]}{i // 2 + 1:02d}" for i in range(satellites)),
        groups=("G", "C"),
        rough_m=ORIGIN_M + np.array([500.0, -300.0, 100.0]) @ AXES,
    )
    truth = ORIGIN_M + way @ AXES
    return TownDrive(measured, truth, velocity @ AXES, speed, yaw, late[epoch, satellite] > 0)


def rows_of(measured: Measurements, keep: Floats) -> Measurements:
    """The rows that a mask or an order of indices within epochs selects; epochs stay."""
    index = np.flatnonzero(keep) if keep.dtype == bool else keep
    columns = {
        name: getattr(measured, name)[index]
        for name in (
            "satellite", "group", "pseudorange_m", "range_rate_mps", "cn0_dbhz", "sigma_m", "elevation_rad",
            "azimuth_rad", "satellite_m", "satellite_mps",
        )
    }  # fmt: skip
    counts = np.bincount(measured.epoch[index], minlength=len(measured))
    return replace(measured, first=np.append(0, np.cumsum(counts)), **columns)


def _motion(rng: np.random.Generator, time: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Speed, yaw rate (clockwise), velocity (m, 3) and way (m, 3)."""
    step = time[1] - time[0]
    yaw = np.where(rng.random(len(time)) < 0.02 * step, rng.choice([-1, 1], len(time)) * 0.3, 0.0)
    yaw = np.clip(np.convolve(yaw, np.ones(round(5 / step)))[: len(time)], -0.3, 0.3)
    speed = np.clip(6 + 4 * np.sin(time / 40) + 3 * np.sin(time / 13), 0, 14)
    speed = np.where(np.abs(yaw) > 0.1, np.minimum(speed, 6), np.where(time % 120 < 30, 0.0, speed))
    width = 2 * round(3 / step) + 1
    speed = np.convolve(np.pad(speed, width // 2, mode="edge"), np.ones(width) / width, "valid")
    speed[speed < 0.3] = 0.0
    heading = 1.0 + np.cumsum(yaw * step)
    velocity = np.column_stack([speed * np.sin(heading), speed * np.cos(heading), 0.02 * speed])
    way = np.vstack([np.zeros(3), np.cumsum((velocity[1:] + velocity[:-1]) / 2 * step, axis=0)])
    return speed, yaw, velocity, way


def _reflections(
    rng: np.random.Generator, speed: Floats, velocity: Floats, step_s: float, satellites: int, share: float
) -> tuple[Floats, Floats]:
    """Delays (m, s), 0 where the signal is direct, and errors of range rates (m, s), of the size of the speed."""
    late, wrong = np.zeros((len(speed), satellites)), np.zeros((len(speed), satellites))
    on, delay = rng.random(satellites) < share, rng.exponential(DELAY_M, satellites)
    along = rng.normal(0, 0.7, (satellites, 3))
    for k in range(len(speed)):
        new = rng.random(satellites) < step_s / REFLECTED_TO_FRO_S * (speed[k] > 0.5) + 1e-3
        on = np.where(new, rng.random(satellites) < share, on)
        delay = np.where(new, rng.exponential(DELAY_M, satellites), delay)
        along = np.where(new[:, None], rng.normal(0, 0.7, (satellites, 3)), along)
        late[k], wrong[k] = on * delay, on * (along @ velocity[k])
    return late, wrong


def _correlated(rng: np.random.Generator, shape: tuple[int, ...], step_s: float) -> Floats:
    """Multipath of 1.5 m that stays alike for seconds."""
    kept = np.exp(-step_s / CORRELATED_S)
    found = np.zeros(shape)
    for k in range(1, shape[0]):
        found[k] = kept * found[k - 1] + np.sqrt(1 - kept**2) * rng.normal(0, 1.5, shape[1])
    return found
