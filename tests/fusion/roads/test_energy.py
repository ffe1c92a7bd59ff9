"""Energy of a path: the balance of forces in simple cases, and its sigma against drawn slopes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.roads.energy import (
    AIR_KGPM3,
    GRAVITY_MPS2,
    J_PER_KWH,
    TOGETHER_M,
    VEHICLES,
    Pieces,
    Vehicle,
    energy_along,
    forces_n,
)
from fusion.types import Floats

CAR = VEHICLES["electric-car"]


def path(
    slope: list[float] | Floats, sigma: float = 0.0, length_m: float = 100.0, measured: bool = True
) -> Pieces:
    n = len(slope)
    return Pieces(
        np.full(n, length_m), np.asarray(slope, float), np.full(n, sigma), np.arange(n), np.full(n, measured)
    )


@pytest.mark.parametrize("name", VEHICLES)
def test_a_level_road_takes_rolling_drag_and_auxiliaries(name: str) -> None:
    vehicle = VEHICLES[name]
    v = vehicle.speed_kmh / 3.6
    force = vehicle.mass_kg * GRAVITY_MPS2 * vehicle.rolling + 0.5 * AIR_KGPM3 * vehicle.drag_area_m2 * v**2
    wanted = (10_000 * force / vehicle.efficiency + vehicle.auxiliary_w * 10_000 / v) / J_PER_KWH
    found = energy_along(vehicle, path(np.zeros(100)))
    assert found.kwh == pytest.approx(wanted, rel=1e-12) and found.sigma_kwh == 0


def test_usual_vehicles_take_what_such_vehicles_take() -> None:
    """kWh per 100 km on the level at their speeds."""
    per_100_km = {name: energy_along(one, path(np.zeros(1000))).kwh for name, one in VEHICLES.items()}
    bounds = {"electric-car": (7, 15), "electric-van": (13, 25), "electric-truck": (90, 160), "e-bike": (0.5, 1.2),
              "car": (25, 60), "truck": (200, 350)}  # fmt: skip
    assert set(bounds) == set(VEHICLES)
    for name, (low, high) in bounds.items():
        assert low < per_100_km[name] < high


def test_a_lossless_vehicle_gets_all_back_and_one_without_regeneration_nothing() -> None:
    hill, level = path([0.06] * 10 + [-0.06] * 10), path(np.zeros(20))
    lossless = replace(CAR, efficiency=1.0, regeneration=1.0)
    assert energy_along(lossless, hill).kwh == pytest.approx(energy_along(lossless, level).kwh, rel=2e-3)
    brakes = replace(CAR, regeneration=0.0, auxiliary_w=0.0)
    down = energy_along(brakes, path([-0.06] * 10))
    up = energy_along(brakes, path([0.06] * 10))
    assert down.kwh == 0
    assert energy_along(brakes, hill).kwh == pytest.approx(up.kwh)
    assert up.kwh == pytest.approx(1000 * forces_n(brakes, 0.06) / brakes.efficiency / J_PER_KWH)


slopes = st.lists(st.floats(-0.2, 0.2), min_size=1, max_size=12)


@given(slopes, st.floats(0, 0.03), st.floats(0, 1))
def test_properties(slope: list[float], sigma: float, regeneration: float) -> None:
    """Steeper takes more; there and back takes no less than twice the level way; errors never save energy."""
    vehicle = replace(CAR, regeneration=regeneration)
    here = energy_along(vehicle, path(slope, sigma))
    assert energy_along(vehicle, path(np.array(slope) + 0.01, sigma)).kwh >= here.kwh
    assert here.kwh >= energy_along(vehicle, path(slope)).kwh - 1e-9
    back = energy_along(vehicle, path(-np.array(slope[::-1])))
    level = energy_along(vehicle, path(np.zeros(2 * len(slope))))
    assert energy_along(vehicle, path(slope)).kwh + back.kwh > 0.97 * level.kwh
    assert here.sigma_kwh >= 0 and (sigma > 0 or here.sigma_kwh == 0)


def test_pieces_of_one_segment_have_one_error() -> None:
    whole = path([0.03, -0.01], 0.01, length_m=300.0)
    rows = np.repeat([0, 1], 30)
    parts = Pieces(
        whole.length_m[rows] / 30,
        whole.slope[rows],
        whole.sigma[rows],
        np.array([7, 4])[rows],
        np.ones(60, bool),
    )
    one, many = energy_along(CAR, whole), energy_along(CAR, parts)
    assert many.kwh == pytest.approx(one.kwh)
    assert many.sigma_kwh == pytest.approx(one.sigma_kwh)


def test_what_is_unknown_counts_as_level_without_an_error() -> None:
    known, unknown = path([0.02, 0.0], 0.01), path([0.02, np.nan], 0.01)
    alone = energy_along(CAR, known.take(slice(0, 1)))
    assert energy_along(CAR, unknown).sigma_kwh == pytest.approx(alone.sigma_kwh)
    assert energy_along(CAR, unknown).kwh < energy_along(CAR, known).kwh


@pytest.mark.parametrize("measured", [True, False])
@pytest.mark.parametrize("mean", [0.0, 0.03, -0.012, -0.06])
@pytest.mark.parametrize("name", ["electric-car", "truck"])
def test_mean_and_sigma_are_those_of_drawn_slopes(name: str, mean: float, measured: bool) -> None:
    """Also where the force is about nothing, which is at -1.2 %."""
    vehicle, rng = VEHICLES[name], np.random.default_rng(5)
    n, length, sigma = 40, 30.0, 0.01
    slope = mean + 0.01 * rng.standard_normal(n)
    pieces = path(slope, sigma, length, measured)
    apart = length * np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    together = np.exp(-apart / TOGETHER_M) if measured else np.eye(n)
    drawn = slope + sigma * rng.standard_normal((20_000, n)) @ np.linalg.cholesky(together).T
    energy = _drawn_kwh(vehicle, drawn, length)
    found, level = energy_along(vehicle, pieces), energy_along(vehicle, path(np.zeros(n), 0.0, length))
    assert found.kwh == pytest.approx(
        energy.mean(), abs=4 * energy.std() / np.sqrt(len(energy)) + 1e-4 * abs(found.kwh)
    )
    # Far below the bend nothing is taken but in the tails, of which an expansion knows little.
    assert found.sigma_kwh == pytest.approx(energy.std(), rel=0.03, abs=2e-4 * level.kwh)


def _drawn_kwh(vehicle: Vehicle, slope: Floats, length_m: float) -> Floats:
    force = forces_n(vehicle, slope)
    taken = np.where(force > 0, force / vehicle.efficiency, force * vehicle.efficiency * vehicle.regeneration)
    seconds = slope.shape[1] * length_m / (vehicle.speed_kmh / 3.6)
    return np.asarray((taken.sum(axis=1) * length_m + vehicle.auxiliary_w * seconds) / J_PER_KWH)
