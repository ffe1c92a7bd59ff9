# mypy: disable-error-code="arg-type"
"""A small sky over a moving car, as measurements with a known truth: for tests of solvers."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fusion.frames import local_axes
from fusion.gnss.earth import ecef, elevation_azimuth
from fusion.gnss.measurements import Measurements, Solution
from fusion.types import Bools, Floats

ROUGH_M = ecef(np.array([13.37]), np.array([52.5]), np.array([80.0]))[0]
AXES = local_axes(ROUGH_M[None])[0]
FAR_M = 2.2e7


class GnssScene(NamedTuple):
    """What was measured, and the true places (m, 3), ECEF."""

    measured: Measurements
    truth_m: Floats


def sight(elevation_rad: Floats, azimuth_rad: Floats) -> Floats:
    """Unit vectors (n, 3) east, north, up."""
    flat = np.cos(elevation_rad)
    return np.column_stack([flat * np.sin(azimuth_rad), flat * np.cos(azimuth_rad), np.sin(elevation_rad)])


def scene(
    epochs: int = 60,
    satellites: int = 10,
    groups: int = 1,
    noise_m: float = 1.0,
    dt_s: float = 1.0,
    speed_mps: float = 10.0,
    cn0_dbhz: float = 46.0,
    clock_m: float = 2000.0,
    drift_mps: float = 5.0,
    bias_m: float = 30.0,
    seed: int = 0,
) -> GnssScene:
    """A car that goes east under satellites that stand; groups take turns in the order of satellites."""
    rng = np.random.default_rng(seed)
    elevation = np.radians(rng.uniform(20, 85, satellites))
    azimuth = 2 * np.pi * (np.arange(satellites) * 0.382 % 1.0)
    places = sight(elevation, azimuth) * FAR_M
    time_s = 1.6e9 + dt_s * np.arange(epochs)
    local = np.column_stack([speed_mps * (time_s - time_s[0]), np.zeros(epochs), np.zeros(epochs)])
    satellite = np.tile(np.arange(satellites), epochs)
    epoch = np.repeat(np.arange(epochs), satellites)
    group = satellite % groups
    away = places[satellite] - local[epoch]
    distance = np.linalg.norm(away, axis=1)
    clock = clock_m + drift_mps * (time_s - time_s[0])
    velocity = np.array([speed_mps, 0.0, 0.0])
    rate = -(away / distance[:, None]) @ velocity + drift_mps + rng.normal(0, 0.1, len(epoch))
    truth_m = ROUGH_M + local @ AXES
    satellite_m = ROUGH_M + places[satellite] @ AXES
    angles = elevation_azimuth(truth_m[epoch], satellite_m)
    n = len(epoch)
    measured = Measurements(
        time_s=time_s,
        first=np.arange(epochs + 1) * satellites,
        satellite=satellite,
        group=group,
        pseudorange_m=distance + clock[epoch] + bias_m * group + rng.normal(0, noise_m, n),
        range_rate_mps=rate,
        cn0_dbhz=np.full(n, cn0_dbhz),
        sigma_m=np.full(n, np.nan),
        elevation_rad=angles[0],
        azimuth_rad=angles[1],
        satellite_m=satellite_m,
        satellite_mps=np.zeros((n, 3)),
        names=tuple(f"G{s + 1:02d}" for s in range(satellites)),
        groups=tuple("GRECJS"[:groups]),
        rough_m=ROUGH_M,
    )
    return GnssScene(measured, truth_m)


def keep_rows(measured: Measurements, keep: Bools) -> Measurements:
    """The rows that a mask (n,) selects; epochs stay."""
    counts = np.bincount(measured.epoch[keep], minlength=len(measured))
    names = (
        "satellite", "group", "pseudorange_m", "range_rate_mps", "cn0_dbhz", "sigma_m", "elevation_rad",
        "azimuth_rad", "satellite_m", "satellite_mps",
    )  # fmt: skip
    columns = {name: getattr(measured, name)[keep] for name in names}
    return replace(measured, first=np.append(0, np.cumsum(counts)), **columns)


def errors_m(solution: Solution, truth_m: Floats) -> Floats:
    """East, north, up errors (m, 3)."""
    errors: Floats = np.einsum("nij,nj->ni", local_axes(truth_m), solution.position_m - truth_m)
    return errors


def horizontal_m2(solution: Solution, truth_m: Floats) -> Floats:
    """The covariances' horizontal part (m, 2, 2)."""
    axes = local_axes(truth_m)
    rotated: Floats = np.einsum("nij,njk,nlk->nil", axes, solution.covariance[:, :3, :3], axes)
    return rotated[:, :2, :2]


def coverage(solution: Solution, truth_m: Floats) -> float:
    """The share of true places within the 95 % ellipses, horizontally."""
    error = errors_m(solution, truth_m)[:, :2]
    spread = horizontal_m2(solution, truth_m)
    solved = np.isfinite(error).all(axis=1)
    distance2 = np.einsum("ni,nij,nj->n", error[solved], np.linalg.inv(spread[solved]), error[solved])
    return float(np.mean(distance2 <= 5.991))
