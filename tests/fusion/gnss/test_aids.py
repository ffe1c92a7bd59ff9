"""What other sensors say at the epochs of raw measurements."""

from __future__ import annotations

import numpy as np

from fusion.gnss.measurements import HEIGHT_SIGMA_M, NEAR_S, SPEED_SIGMA_MPS, Aids, aids_of, with_heights
from fusion.types import AngularRate, DriveLog, GnssFix, Odometry


def log() -> DriveLog:
    time = np.arange(0.0, 10.0, 0.5)
    return DriveLog(
        "test",
        GnssFix.empty(),
        odometry=Odometry.assemble(time, speed_mps=time * 2),
        rate=AngularRate.assemble(time, gyr_z_radps=np.full(20, 0.1)),
    )


def test_speed_and_yaw_rate_at_epochs() -> None:
    aids = aids_of(log(), np.array([1.25, 3.0]))
    assert np.allclose(aids.speed_mps, [2.5, 6.0])
    assert np.allclose(aids.yaw_rate_radps, -0.1)  # clockwise is positive, the sensor's z axis points up
    assert np.all(aids.speed_sigma_mps > SPEED_SIGMA_MPS)
    assert np.isnan(aids.height_m).all()


def test_far_from_any_reading_nothing_is_known() -> None:
    end = 9.5
    aids = aids_of(log(), np.array([-5.0, end + NEAR_S / 2, end + 2 * NEAR_S]))
    assert np.isnan(aids.speed_mps).tolist() == [True, False, True]
    assert np.isnan(aids.speed_sigma_mps).tolist() == [True, False, True]


def test_a_log_without_sensors_helps_nothing() -> None:
    aids = aids_of(DriveLog("test", GnssFix.empty()), np.arange(3.0))
    assert all(np.isnan(getattr(aids, name)).all() for name in ("speed_mps", "yaw_rate_radps", "height_m"))


def test_heights_have_a_sigma_where_they_are() -> None:
    aids = with_heights(Aids.none(3), np.array([1.0, np.nan, 2.0]))
    assert np.isnan(aids.height_sigma_m).tolist() == [False, True, False]
    assert aids.height_sigma_m[0] == HEIGHT_SIGMA_M
