"""An elevation model beside the drives: an exact one is believed, a poor one is not, and edges are seen."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from factor_support import Sensors, block_of_streets, driven, street
from fusion.network.adjust import adjust
from fusion.network.pass_factor import PassFactor
from fusion.network.terrain import DEFAULT_LENGTH_M, DEFAULT_SIGMA_M, Terrain
from fusion.network.unknowns import RoadUnknowns, knot_positions
from fusion.roads.table import RoadTable
from street_support import height_at, knots_m, ride, true_percent

SIDE_M, COUNT = 60.0, 40
STREET = street(*[SIDE_M] * COUNT)
ORDINARY = Sensors(0.03, altitude_m=0.5)
POOR = Sensors(0.15, altitude_m=1.5, walk_m2_per_s=(0.5, 0.01))
DEFAULT_RATE = DEFAULT_SIGMA_M**2 / DEFAULT_LENGTH_M
"""Half the squared difference of a model's errors for each metre, m: what counts for slopes."""


TRUE_PERCENT = true_percent(STREET)
KNOTS_M = knots_m(STREET)


def rides(sensors: Sensors, count: int = 1) -> dict[int, list[PassFactor]]:
    return {seed: ride(STREET, sensors, seed) for seed in range(count)}


def root(drives: Mapping[int, list[PassFactor]], terrain: Terrain | None) -> tuple[float, float]:
    """RMSE, %, and share within 1.96 sigma."""
    found = adjust(STREET, drives, terrain)
    error = found.slope_percent - TRUE_PERCENT
    return float(np.sqrt(np.mean(error**2))), float(np.mean(np.abs(error) < 1.96 * found.slope_sigma_percent))


def wander(seed: int, sigma_m: float, length_m: float) -> np.ndarray:
    """Errors of an Ornstein-Uhlenbeck process at the street's knots."""
    rng, out = np.random.default_rng(seed), np.empty(len(KNOTS_M))
    out[0] = sigma_m * rng.normal()
    for k in range(1, len(out)):
        keep = np.exp(-(KNOTS_M[k] - KNOTS_M[k - 1]) / length_m)
        out[k] = keep * out[k - 1] + sigma_m * np.sqrt(1 - keep**2) * rng.normal()
    return out


@pytest.mark.parametrize("up_m", [0.0, 40.0], ids=["on its datum", "on another"])
def test_an_exact_model_is_believed(up_m: float) -> None:
    """Heights of the road itself, whatever they count from, are worth more drives."""
    alone, error, inside = [], [], []
    for seed in range(3):
        drives = {0: ride(STREET, ORDINARY, seed)}
        alone.append(adjust(STREET, drives).slope_percent - TRUE_PERCENT)
        found = adjust(STREET, drives, Terrain(height_at(KNOTS_M) + up_m))
        error.append(found.slope_percent - TRUE_PERCENT)
        inside.append(np.abs(error[-1]) < 1.96 * found.slope_sigma_percent)
        assert found.model is not None
        assert found.model.sigma_m**2 / found.model.length_m < 0.1 * DEFAULT_RATE
    assert np.sqrt(np.mean(np.square(error))) < 0.75 * np.sqrt(np.mean(np.square(alone)))
    assert np.mean(inside) > 0.93


def test_a_model_without_heights_is_no_model() -> None:
    drives = rides(POOR)
    none, nothing = (adjust(STREET, drives, t) for t in (None, Terrain(np.full(len(KNOTS_M), np.nan))))
    assert nothing.slope_percent == pytest.approx(none.slope_percent, abs=1e-9)
    assert nothing.slope_sigma_percent == pytest.approx(none.slope_sigma_percent, rel=1e-9)


@pytest.mark.parametrize(("sigma_m", "length_m"), [(0.5, 100.0), (3.0, 60.0), (6.0, 300.0), (12.0, 100.0)])
def test_a_model_s_quality_is_learned_where_roads_are_driven(sigma_m: float, length_m: float) -> None:
    rate = []
    for seed in range(4):
        terrain = Terrain(height_at(KNOTS_M) + wander(seed, sigma_m, length_m))
        model = adjust(STREET, rides(Sensors(0.01, pressure_m=0.05), 2), terrain).model
        assert model is not None
        rate.append(model.sigma_m**2 / model.length_m)
    ratio = np.exp(np.mean(np.log(rate))) / (sigma_m**2 / length_m)
    assert 1 / 3 < ratio < 3, (rate, sigma_m**2 / length_m)


@pytest.mark.parametrize("sensors", [ORDINARY, POOR], ids=["ordinary", "poor"])
def test_a_poor_model_does_no_harm(sensors: Sensors) -> None:
    drives = rides(sensors)
    alone, _ = root(drives, None)
    for seed in range(3):
        with_it, inside = root(drives, Terrain(height_at(KNOTS_M) + wander(seed, 8.0, 80.0)))
        assert with_it < 1.15 * alone
        assert inside > 0.88


def test_white_noise_of_a_third_of_a_metre_is_a_good_model() -> None:
    """A lidar's."""
    drives = rides(ORDINARY)
    alone, _ = root(drives, None)
    noise = 0.3 * np.random.default_rng(1).normal(size=len(KNOTS_M))
    noise[4::4] = noise[3:-1:4]  # one place, one height
    with_it, inside = root(drives, Terrain(height_at(KNOTS_M) + noise))
    assert with_it < 0.85 * alone
    assert inside > 0.88


def test_the_same_model_is_one_source_however_many_drives_there_are() -> None:
    """Drives that know nothing but the model would all repeat it: it is in the equations once."""
    terrain = Terrain(height_at(KNOTS_M) + wander(2, 6.0, 100.0))
    blind = Sensors(2.0)
    one, ten = (adjust(STREET, rides(blind, count), terrain).slope_sigma_percent for count in (1, 10))
    assert np.all(ten > 0.7 * one)


def block() -> tuple[RoadTable, np.ndarray, np.ndarray]:
    """A grid of streets on an even slope, where its knots lie east, and their heights."""
    table = block_of_streets(7, 7, SIDE_M)
    lon, lat = knot_positions(table)
    east = (lon - lon.min()) * 111_320 * np.cos(np.radians(49.0))
    north = (lat - lat.min()) * 111_132
    return table, np.column_stack([east, north]), 120 + 0.03 * east - 0.02 * north


def test_a_model_that_is_30_m_off_in_one_corner_is_not_believed_there() -> None:
    """A quarry, or a tile from elsewhere: slopes stay the drives' at its edge, and everywhere else too."""
    table, place, height = block()
    last = np.cumsum(RoadUnknowns(table).intervals + 1) - 1
    first = np.concatenate([[0], last[:-1] + 1])
    grade = (height[last] - height[first]) / table.length_m
    rng = np.random.default_rng(3)
    drives = {
        0: driven(
            table, range(len(table)), lambda row, at: height[first[row]] + grade[row] * at, Sensors(0.02), rng
        )
    }
    in_corner = (place[:, 0] < 130) & (place[:, 1] < 130)
    wrong = np.where(in_corner, 30.0, 0.0)
    alone, found = adjust(table, drives), adjust(table, drives, Terrain(height + wrong))
    error, before = (np.abs(one.slope_percent - 100 * grade) for one in (found, alone))
    assert np.sqrt(np.mean(error**2)) < 1.1 * np.sqrt(np.mean(before**2))
    assert error.max() < 3 * alone.slope_sigma_percent.max(), "no slope follows the edge"
    assert np.mean(error < 1.96 * found.slope_sigma_percent) > 0.93
    # The steps over the edge are known for what they are.
    assert found.model is not None
    within = np.concatenate([np.arange(a, b) for a, b in zip(first, last, strict=True)])
    jumps = np.abs(wrong[within + 1] - wrong[within]) > 1
    assert jumps.any()
    assert found.model.tail[jumps].max() < 0.1 * np.median(found.model.tail)
