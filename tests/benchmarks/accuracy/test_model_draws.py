"""Roads and logs drawn from the model: heights, slopes and sensors are as they were drawn."""

from __future__ import annotations

import numpy as np
import pytest

from accuracy.model_draws import FAST_HZ, DrawnDrive, draw_drive
from accuracy.road_draws import STEEPEST, DrawnRoad, draw_road
from fusion.frames import LocalProjection
from fusion.network.segment_slopes import PLACE_SIGMA_M
from fusion.profile.model import Noise


@pytest.fixture(scope="module")
def road() -> DrawnRoad:
    return draw_road(np.random.default_rng(3), 20)


def test_heights_are_the_integral_of_the_grade(road: DrawnRoad) -> None:
    along = np.linspace(0, road.node_m[-1], 40_001)
    height, grade = road.height_and_grade(along)
    step = along[1] - along[0]
    inside = 0.5 * (grade[1:] + grade[:-1]) * step
    assert np.max(np.abs(np.cumsum(inside) - (height[1:] - height[0]))) < 0.02
    assert np.max(np.abs(grade)) <= STEEPEST + 1e-9


def test_true_slopes_are_regressions(road: DrawnRoad) -> None:
    slopes = road.slopes_percent()
    for k in (0, 7, 19):
        along = np.linspace(road.true_node_m[k], road.true_node_m[k + 1], 5001)[1:-1]
        height, _ = road.height_and_grade(along)
        assert slopes[k] == pytest.approx(100 * np.polyfit(along, height, 1)[0], abs=0.01)


def test_the_walk_has_the_roughness_drawn() -> None:
    roads = [draw_road(np.random.default_rng(k), 20) for k in range(10)]
    ratio = [np.mean(r.bend**2 * np.diff(np.append(r.step_m, r.node_m[-1]))) / r.roughness for r in roads]
    assert ratio == pytest.approx(np.ones(10), abs=0.15)


def test_segments_are_in_the_order_of_the_road(road: DrawnRoad) -> None:
    assert np.diff(road.node_m) == pytest.approx(road.table.length_m)
    assert np.array_equal(road.table.from_node, np.arange(1, 21))


def test_maps_have_their_nodes_elsewhere() -> None:
    roads = [draw_road(np.random.default_rng(k), 20) for k in range(10)]
    moved = np.concatenate([r.true_node_m - r.node_m for r in roads])
    assert np.std(moved) == pytest.approx(PLACE_SIGMA_M, rel=0.2)
    assert all(np.min(np.diff(r.true_node_m)) >= 1.0 for r in roads)


def test_positions_wander_by_what_they_state(road: DrawnRoad) -> None:
    plane = LocalProjection(8.5, 49.0)
    errors = []
    for k in range(40):
        drive = draw_drive(np.random.default_rng(k), road, k)
        fix, velocity = drive.log.fix, drive.log.velocity
        x, y = plane.to_xy(fix.lon_deg, fix.lat_deg)
        way = np.hypot(x - x[0], y - y[0])
        gone = np.concatenate([[0.0], np.cumsum(np.hypot(velocity.vel_n_mps, velocity.vel_e_mps))[:-1]])
        off = (way - gone / drive.rate_hz)[1 : int(60 * drive.rate_hz)]
        errors.append(np.std(off) / fix.h_acc_m[0])
    assert 0.2 < np.median(errors) < 1.5  # a minute of a wander that lasts half a minute: 0.7 in the long run


def test_logs_lie_on_the_road(road: DrawnRoad) -> None:
    drives = [draw_drive(np.random.default_rng(k), road, k) for k in range(12)]
    plane = LocalProjection(8.5, 49.0)
    assert {d.rate_hz for d in drives} == {1.0, FAST_HZ}
    for drive in drives:
        fix, velocity = drive.log.fix, drive.log.velocity
        x, y = plane.to_xy(fix.lon_deg, fix.lat_deg)
        way = np.hypot(np.diff(x), np.diff(y)).sum()
        assert way == pytest.approx(road.node_m[-1], abs=30)
        speed = np.hypot(velocity.vel_n_mps, velocity.vel_e_mps)
        assert speed.min() >= 5 - 1e-6
        assert speed.max() <= 20 + 1e-6
        assert np.median(np.diff(fix.time_s)) == pytest.approx(1 / drive.rate_hz, abs=1e-6)


def test_a_lag_shows_earlier_heights(road: DrawnRoad) -> None:
    seed = next(k for k in range(50) if draw_drive(np.random.default_rng(k), road, 0).late)
    plain, late = (draw_drive(np.random.default_rng(seed), road, 0, lag) for lag in (0.0, 1.0))
    assert np.array_equal(plain.log.pressure.pressure_pa, late.log.pressure.pressure_pa)
    assert not plain.log.fix.has("v_acc_m")
    shift = plain.log.fix.alt_msl_m - late.log.fix.alt_msl_m
    climb = -plain.log.velocity.vel_d_mps
    assert np.corrcoef(shift, climb)[0, 1] > 0.9
    samples = round(plain.rate_hz)
    kept = shift[samples:].sum()  # all noise is the same, so that the shifts add up to what the heights say
    assert kept == pytest.approx(climb[samples:].sum() / plain.rate_hz, rel=0.2, abs=1.0)


def test_levels_are_of_averaged_samples(road: DrawnRoad) -> None:
    log = draw_drive(np.random.default_rng(0), road, 0).log
    slow, fast = (DrawnDrive(log, Noise(altitude_m=1.0, pitch=0.01), hz, False) for hz in (1.0, 5.0))
    assert slow.level("altitude_m") == 1.0
    assert fast.level("altitude_m") == pytest.approx(np.sqrt(1 / 5))
    assert fast.level("pitch") == pytest.approx(0.01 * np.sqrt((1 / 2 + 1 / 3) / 2), rel=0.01)
    assert fast.level("drift") == slow.level("drift")
