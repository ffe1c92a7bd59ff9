"""Rides: the truth of a simulated drive, on the plane and in ECEF."""

from __future__ import annotations

import numpy as np

from fusion.frames import geodetic
from fusion.published.canyon.ride import ride_of
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town


def test_a_simulated_drive_keeps_its_truth(town: Town) -> None:
    drive = simulate_drive(town, 5, 60.0)
    ride = ride_of(drive)
    lon, lat, height = geodetic(ride.position_m)
    x, y = town.projection.to_xy(lon, lat)
    np.testing.assert_allclose(x, drive.truth.x_m, atol=1e-4)
    np.testing.assert_allclose(y, drive.truth.y_m, atol=1e-4)
    np.testing.assert_allclose(height, drive.truth.z_m + drive.antenna_m + 48.0, atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(ride.velocity_mps, axis=1), drive.truth.speed_mps, atol=2e-3)
