"""The height beside the plane: its command, its measurements, and the filter against closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio

from fusion.errors import MissingSensorError
from fusion.frames import LocalProjection
from fusion.pipeline import run_drive
from fusion.published.epochs.levelling import MountPitch
from fusion.published.epochs.table import Epochs, build_epochs
from fusion.published.gps_ins.height import (
    Climb,
    HeightReadings,
    climb_rate,
    filter_heights,
    gnss_heights,
    terrain_heights,
)
from fusion.published.gps_ins.options import KalmanOptions
from fusion.simulate.scene.town import Town
from fusion.simulate.write.dem_file import write_dem
from fusion.terrain.dem import Dem
from fusion.types import Attitude, DriveLog, GnssFix, GnssVelocity

PLANE = LocalProjection(8.0, 49.0)
OPTIONS = KalmanOptions(period_s=1.0)
LEVEL = MountPitch(0.0, math.inf, "none")


def slope(
    seconds: int = 60, *, grade: float = 0.05, speed_mps: float = 10.0, mount_grade: float = 0.0
) -> Epochs:
    """A steady climb to the east, with pitch, vertical Doppler velocity and altitude without noise."""
    time = np.arange(float(seconds))
    lon, lat = PLANE.to_lonlat(speed_mps * time, 0 * time)
    log = DriveLog(
        "csv",
        fix=GnssFix.assemble(
            time, lon_deg=lon, lat_deg=lat, alt_msl_m=100 + grade * speed_mps * time, v_acc_m=0 * time + 3.0
        ),
        velocity=GnssVelocity.assemble(
            time, vel_n_mps=0 * time, vel_e_mps=0 * time + speed_mps, vel_d_mps=0 * time - grade * speed_mps
        ),
        attitude=Attitude.assemble(
            time,
            pitch_rad=0 * time + math.atan(grade) + math.atan(mount_grade),
            yaw_rad=0 * time + math.pi / 2,
        ),
    )
    return build_epochs(log, PLANE, 1.0)


def constant(n: int, rate_mps: float, sigma_mps: float) -> Climb:
    return Climb(np.full(n, rate_mps), np.full(n, sigma_mps), np.ones(n, bool))


def readings(height_m: np.ndarray, sigma_m: float) -> HeightReadings:
    n = len(height_m)
    return HeightReadings(height_m, np.full(n, sigma_m), np.full(n, sigma_m), np.zeros(n))


@pytest.mark.parametrize("climb", ["all", "pitch", "doppler"])
def test_either_source_gives_the_climb(climb: str) -> None:
    epochs = slope()
    found = climb_rate(epochs, epochs.speed_mps, LEVEL, KalmanOptions(climb=climb))  # type: ignore[arg-type]
    assert found.rate_mps == pytest.approx(np.full(60, 0.5), abs=1e-9)
    assert found.known.all()


def test_two_sources_are_weighed_by_their_variances() -> None:
    """A mount of 1 % that nobody took off reads 0.1 m/s too much in the pitch alone."""
    epochs = slope(mount_grade=0.01)
    options = KalmanOptions(doppler_sigma_mps=0.2, pitch_sigma_rad=0.01)
    both = climb_rate(epochs, epochs.speed_mps, LEVEL, options)
    pitch = climb_rate(epochs, epochs.speed_mps, LEVEL, options.model_copy(update={"climb": "pitch"}))
    a, b = 0.1**-2, 0.2**-2  # 0.01 rad at 10 m/s, and the Doppler velocity
    assert both.rate_mps == pytest.approx((a * pitch.rate_mps + b * 0.5) / (a + b), rel=1e-6)
    assert both.sigma_mps == pytest.approx(np.full(60, (a + b) ** -0.5), rel=1e-6)
    levelled = climb_rate(epochs, epochs.speed_mps, MountPitch(0.01, 0.001, "x"), options)
    assert levelled.rate_mps == pytest.approx(np.full(60, 0.5), abs=1e-9)


def test_a_standing_vehicle_does_not_climb_and_an_unknown_speed_says_little() -> None:
    epochs = slope()
    speed = np.where(np.arange(60) < 20, 0.0, np.where(np.arange(60) < 40, 10.0, np.nan))
    found = climb_rate(epochs, speed, LEVEL, OPTIONS.model_copy(update={"climb": "none"}))
    assert not found.rate_mps.any()
    assert found.known.tolist() == [True] * 20 + [False] * 40
    assert found.sigma_mps[:20].max() < 0.05
    assert found.sigma_mps[20:40] == pytest.approx(np.full(20, 0.6))
    assert (found.sigma_mps[40:] > found.sigma_mps[39]).all()


def test_unstated_pitch_noise_is_read_from_its_scatter() -> None:
    epochs = slope(400)
    rng = np.random.default_rng(1)
    noisy = replace(epochs, pitch_rad=epochs.pitch_rad + 0.03 * rng.normal(size=400))
    options = KalmanOptions(climb="pitch")
    sigma = climb_rate(noisy, noisy.speed_mps, LEVEL, options).sigma_mps
    assert sigma == pytest.approx(np.full(400, 0.3), rel=0.2)
    stated = replace(noisy, pitch_acc_rad=np.full(400, 0.02))
    sigma = climb_rate(stated, noisy.speed_mps, LEVEL, options).sigma_mps
    assert sigma == pytest.approx(np.full(400, 10 * math.hypot(0.02, options.pitch_sigma_rad)))


def test_the_filter_is_the_scalar_kalman_filter() -> None:
    rng = np.random.default_rng(2)
    time = np.cumsum(rng.choice([0.5, 1.0, 2.0], size=200))
    heights = 50 + 0.3 * time + 2.0 * rng.normal(size=200)
    heights[80:120] = np.nan
    found = filter_heights(time, np.arange(200) == 0, constant(200, 0.3, 0.1), readings(heights, 2.0), 3)
    z, p = heights[0], 0.25
    for e in range(200):
        if e:
            dt = time[e] - time[e - 1]
            z, p = z + 0.3 * dt, p + (0.1 * dt) ** 2
            if math.isfinite(heights[e]):
                gain = p / (p + 4.0)
                z, p = z + gain * (heights[e] - z), (1 - gain) * p
        assert found.height_m[e] == pytest.approx(z, abs=1e-9)
        assert found.sigma_m[e] == pytest.approx(math.sqrt(p), abs=1e-9)
    assert found.starts.tolist() == [True] + [False] * 199
    assert found.sigma_m[119] > found.sigma_m[79]


def test_wild_heights_are_left_out_and_many_in_a_row_start_anew() -> None:
    time = np.arange(100.0)
    heights = np.full(100, 20.0)
    heights[[10, 30]] = 90.0
    heights[60:] = 80.0
    found = filter_heights(time, time == 0, constant(100, 0.0, 0.05), readings(heights, 1.0), 3)
    assert np.flatnonzero(found.gated).tolist() == [10, 30, 60, 61, 62]
    assert np.flatnonzero(found.starts).tolist() == [0, 62]
    assert found.height_m[59] == pytest.approx(20.0)
    assert found.height_m[62:] == pytest.approx(np.full(38, 80.0))


def test_heights_wait_for_the_first_and_start_anew_after_a_gap() -> None:
    time = np.arange(50.0)
    heights = np.where(time < 10, np.nan, 5.0)
    restart = (time == 0) | (time == 30)
    found = filter_heights(time, restart, constant(50, 1.0, 0.1), readings(heights, 3.0), 3)
    assert np.isnan(found.height_m[:10]).all()
    assert np.flatnonzero(found.starts).tolist() == [10, 30]


def test_altitudes_are_weighted_down_for_errors_that_hang_together_only_where_the_climb_is_known() -> None:
    epochs = slope()
    known = climb_rate(epochs, epochs.speed_mps, LEVEL, OPTIONS)
    counted = gnss_heights(epochs, known, OPTIONS)
    assert counted.sigma_m == pytest.approx(np.full(60, 3.0 * math.sqrt(121.0)))
    assert not counted.slow_m.any()
    # After half a minute without altitudes the next one tells more.
    missing = (np.arange(60) >= 20) & (np.arange(60) < 49)
    cut = replace(epochs, alt_m=np.where(missing, np.nan, epochs.alt_m))
    assert gnss_heights(cut, known, OPTIONS).sigma_m[[48, 49, 50]] == pytest.approx(
        3.0 * np.sqrt([1 + 120 / 29, 1 + 120 / 30, 121.0])
    )
    guess = climb_rate(epochs, epochs.speed_mps, LEVEL, OPTIONS.model_copy(update={"climb": "none"}))
    plain = gnss_heights(epochs, guess, OPTIONS)
    assert (plain.sigma_m < 0.1).all()  # these altitudes have no scatter
    assert plain.slow_m == pytest.approx(np.full(60, 3.0), abs=0.01)


def test_terrain_heights_count_by_the_way_between_them() -> None:
    climb = constant(3, 0.0, 0.1)
    found = terrain_heights(np.full(3, 7.0), climb, np.array([10.0, 10.0, 0.0]), np.arange(3.0), OPTIONS)
    assert found.sigma_m[1] == pytest.approx(6.0 * math.sqrt(1 + 600.0 / 10.0))
    # Standing, one height of the terrain is as good as a thousand.
    assert found.sigma_m[2] == pytest.approx(6.0 * math.sqrt(1 + 600.0 / 0.1))


def test_the_threshold_of_the_terrains_quality_is_kept(
    make_log: Callable[..., DriveLog], town: Town, tmp_path: Path
) -> None:
    """Posts that no scene saw are no heights, if so wished."""
    elevations, quality = (tmp_path / f"ASTGTM2_N47E007_{kind}.tif" for kind in ("dem", "num"))
    write_dem(town, elevations)
    with rasterio.open(elevations) as raster:
        profile = {**raster.profile, "dtype": "int16", "nodata": None, "driver": "GTiff"}
        with rasterio.open(quality, "w", **profile) as layer:
            layer.write(np.zeros(raster.shape, np.int16), 1)
    log = make_log(1, duration_s=240)
    with Dem.open([elevations]) as dem:
        options: dict[str, object] = {"height": "dem"}
        assert run_drive(log, town.roads, dem, method="gps-ins-kf", options=options)[1].slopes
        with pytest.raises(MissingSensorError, match="knows no height"):
            run_drive(log, town.roads, dem, method="gps-ins-kf", options={**options, "dem_min_quality": 1})
