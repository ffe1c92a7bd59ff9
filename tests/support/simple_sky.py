# mypy: disable-error-code="arg-type"
"""A sky of satellites over a moving receiver, as measurements: exact, or with the errors that a test asks for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.frames import local_axes
from fusion.gnss.earth import ecef, elevation_azimuth
from fusion.gnss.measurements import Measurements
from fusion.types import Floats

START_S = 1_600_000_000.0
RANGE_M = 2.2e7


@dataclass(frozen=True)
class Sky:
    """Measurements, and where the receiver was and how fast (m, 3), ECEF."""

    measured: Measurements
    position_m: Floats
    velocity_mps: Floats


def sky(
    *,
    epochs: int = 60,
    satellites: int = 9,
    period_s: float = 1.0,
    lon_deg: float = 13.4,
    lat_deg: float = 52.5,
    speed_mps: float = 10.0,
    climb_mps: float = 0.3,
    noise_m: float = 0.0,
    rate_noise_mps: float = 0.0,
    clock_m: float = 1234.0,
    drift_mps: float = 3.0,
    doppler: bool = True,
    seed: int = 0,
) -> Sky:
    """A receiver that drives north-east and climbs, under satellites that move slowly."""
    rng = np.random.default_rng(seed)
    start = ecef(np.array([lon_deg]), np.array([lat_deg]), np.array([80.0]))
    axes = local_axes(start)[0]
    velocity = axes.T @ np.array([speed_mps * 0.6, speed_mps * 0.8, climb_mps])
    time = period_s * np.arange(epochs)
    position = start + time[:, None] * velocity
    azimuth = 2 * np.pi * (np.arange(satellites) + rng.uniform(0, 0.6, satellites)) / satellites
    elevation = np.radians(rng.permutation(np.linspace(15, 80, satellites)))
    sight = np.column_stack(
        [np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)]
    )
    place = start + RANGE_M * sight @ axes
    moving = rng.normal(0, 1500.0, (satellites, 3))
    satellite_m = (place[None] + time[:, None, None] * moving[None]).reshape(-1, 3)
    satellite_mps = np.tile(moving, (epochs, 1))
    epoch = np.repeat(np.arange(epochs), satellites)
    line = satellite_m - position[epoch]
    distance = np.linalg.norm(line, axis=1)
    rate = np.einsum("ni,ni->n", satellite_mps - velocity, line / distance[:, None]) + drift_mps
    n = len(epoch)
    up, around = elevation_azimuth(position[epoch], satellite_m)
    measured = Measurements(
        time_s=START_S + time,
        first=np.arange(0, n + 1, satellites),
        satellite=np.tile(np.arange(satellites), epochs),
        group=np.zeros(n, np.int64),
        pseudorange_m=distance + clock_m + drift_mps * time[epoch] + rng.normal(0, 1, n) * noise_m,
        range_rate_mps=rate + rng.normal(0, 1, n) * rate_noise_mps if doppler else np.full(n, np.nan),
        cn0_dbhz=np.full(n, 47.0),
        sigma_m=np.full(n, np.nan),
        elevation_rad=up,
        azimuth_rad=around,
        satellite_m=satellite_m,
        satellite_mps=satellite_mps,
        names=tuple(f"G{k + 1:02d}" for k in range(satellites)),
        groups=("GPS",),
        rough_m=start[0],
    )
    return Sky(measured, position, np.tile(velocity, (epochs, 1)))
