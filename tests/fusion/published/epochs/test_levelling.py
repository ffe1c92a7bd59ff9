"""The mount's tilt is found from the drive itself, with a sigma that is true."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.frames import LocalProjection
from fusion.published.epochs.levelling import estimate_mount
from fusion.published.epochs.table import Epochs, build_epochs
from fusion.types import Attitude, DriveLog, GnssFix, GnssVelocity

PLANE = LocalProjection(8.0, 49.0)


def drive(
    mount_rad: float, seed: int, *, doppler: bool = True, altitude: bool = True, n: int = 300
) -> Epochs:
    """A winding hill at 12 m/s with receiver noise as in the shared tool's m8 profile."""
    rng = np.random.default_rng(seed)
    time = np.arange(float(n))
    grade = 0.06 * np.sin(time / 17) + 0.03 * np.sin(time / 5)
    height = 200 + np.cumsum(12 * grade)
    slow = np.zeros(n)
    for k in range(1, n):
        slow[k] = np.exp(-1 / 120) * slow[k - 1] + rng.normal() * 3 * np.sqrt(1 - np.exp(-2 / 120))
    x = 12 * time
    lon, lat = PLANE.to_lonlat(x, np.zeros(n))
    up = np.gradient(height) + 0.1 * rng.normal(size=n)
    pitch = np.arctan(grade + 0.011 * rng.normal(size=n)) + mount_rad
    log = DriveLog(
        "csv",
        fix=GnssFix.assemble(
            time,
            lon_deg=lon,
            lat_deg=lat,
            alt_msl_m=height + slow + 0.5 * rng.normal(size=n) if altitude else np.full(n, np.nan),
            v_acc_m=np.full(n, 3.5),
        ),
        velocity=GnssVelocity.assemble(
            time,
            vel_e_mps=np.full(n, 12.0),
            vel_n_mps=np.zeros(n),
            vel_d_mps=-up if doppler else np.full(n, np.nan),
        ),
        attitude=Attitude.assemble(time, pitch_rad=pitch, yaw_rad=np.full(n, np.pi / 2)),
    )
    return build_epochs(log, PLANE)


@pytest.mark.slow
@pytest.mark.parametrize(("doppler", "altitude"), [(True, True), (True, False), (False, True)])
def test_the_tilt_is_found_within_its_sigma(doppler: bool, altitude: bool) -> None:
    """Over many drives the errors, in sigmas, have the spread that a true sigma gives: none far out, not all tiny."""
    errors = []
    for seed in range(40):
        mount = np.radians(np.random.default_rng([seed, 9]).normal() * 2)
        found = estimate_mount(drive(float(mount), seed, doppler=doppler, altitude=altitude))
        errors.append((found.angle_rad - mount) / found.sigma)
    spread = np.sqrt(np.mean(np.square(errors)))
    assert 0.3 < spread < 1.6


def test_the_source_is_named() -> None:
    assert estimate_mount(drive(0.02, 1)).source == "Doppler velocity and altitude"
    assert estimate_mount(drive(0.02, 1, doppler=False)).source == "altitude"


def test_a_few_wild_epochs_do_not_tilt_a_drive() -> None:
    epochs = drive(0.02, 3, altitude=False)
    wild = epochs.pitch_rad.copy()
    wild[::37] += 0.5
    assert estimate_mount(replace(epochs, pitch_rad=wild)).angle_rad == pytest.approx(
        estimate_mount(epochs).angle_rad, abs=0.002
    )


def test_a_drive_that_tells_nothing_leaves_the_sensor_alone() -> None:
    found = estimate_mount(drive(0.02, 1, doppler=False, altitude=False))
    assert not found.known
    assert found.angle_rad == 0.0
    assert found.source == "none"


def test_the_tilt_by_altitude_is_that_of_generalised_least_squares() -> None:
    """The recursion over epochs against the dense normal equations under the errors' whole covariance."""
    epochs = drive(0.02, 5, doppler=False)
    found = estimate_mount(epochs)
    time = epochs.time_s
    step = 12.0 * np.diff(time)
    grade = np.tan(epochs.pitch_rad)
    distance = np.concatenate([[0.0], np.cumsum(step)])
    climb = np.concatenate([[0.0], np.cumsum(step * 0.5 * (grade[1:] + grade[:-1]))])
    slow = 3.5**2 * np.exp(-np.abs(time[:, None] - time[None, :]) / 100.0)
    walk = 0.011**2 * 2 * 12.0 * np.minimum(distance[:, None], distance[None, :])
    precision = np.linalg.inv(slow + walk + 0.25 * np.eye(len(time)))
    design = np.column_stack([np.ones(len(time)), -distance])
    normal = design.T @ precision @ design
    tilt = np.linalg.solve(normal, design.T @ precision @ (epochs.alt_m - climb))[1]
    assert found.grade == pytest.approx(tilt, rel=1e-6)
    assert found.sigma == pytest.approx(np.sqrt(np.linalg.inv(normal)[1, 1]), rel=1e-6)
