"""Speeds on slopes: laws of the balance of forces, and figures that are known from elsewhere."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.exports.formats.osrm import AIR_KGPM3, GRAVITY_MPS2, SLOPES_PERCENT, VEHICLES, Kind, SpeedOptions
from fusion.roads.osm import DRIVABLE

KINDS = st.sampled_from(list(Kind))
ROADS = st.sampled_from(sorted(DRIVABLE))
SLOPES = st.floats(-35, 35)


@given(KINDS, ROADS, SLOPES, SLOPES)
def test_steeper_up_is_never_faster(kind: Kind, highway: str, one: float, other: float) -> None:
    low, high = sorted((abs(one), abs(other)))
    slow, fast = VEHICLES[kind].speed_kmh(high, highway), VEHICLES[kind].speed_kmh(low, highway)
    assert slow <= fast + 1e-9


@given(KINDS, ROADS, SLOPES)
def test_no_speed_is_beyond_the_road_s_or_nothing(kind: Kind, highway: str, slope: float) -> None:
    vehicle = VEHICLES[kind]
    assert 0 < vehicle.speed_kmh(slope, highway) <= vehicle.limit_kmh(highway)


@given(st.sampled_from([Kind.CAR, Kind.BICYCLE, Kind.E_BIKE]), ROADS, SLOPES, SLOPES)
def test_without_a_limit_of_the_brakes_steeper_down_is_never_slower(
    kind: Kind, highway: str, one: float, other: float
) -> None:
    low, high = sorted((one, other))
    vehicle = VEHICLES[kind]
    assert vehicle.speed_kmh(high, highway) <= vehicle.speed_kmh(low, highway) + 1e-9


@given(KINDS, ROADS, SLOPES, st.floats(1.05, 3.0))
def test_more_power_is_never_slower_and_more_mass_never_faster_uphill(
    kind: Kind, highway: str, slope: float, factor: float
) -> None:
    usual = VEHICLES[kind]
    stronger = SpeedOptions(vehicle=kind, power_kw=usual.power_w * factor / 1000).chosen()
    heavier = SpeedOptions(vehicle=kind, mass_kg=usual.mass_kg * factor).chosen()
    slopes = np.array([slope, abs(slope)])
    own = usual.speeds_kmh(slopes, highway)
    assert (stronger.speeds_kmh(slopes, highway) >= own - 1e-9).all()
    assert heavier.speeds_kmh(slopes, highway)[1] <= own[1] + 1e-9


@pytest.mark.parametrize("slope", [1.0, 4.0, 9.0])
def test_the_balance_holds_where_power_is_the_bound(slope: float) -> None:
    lorry = VEHICLES[Kind.TRUCK]
    speed = float(lorry.speeds_kmh(np.array([slope]), "motorway")[0]) / 3.6
    angle = math.atan(slope / 100)
    force = lorry.mass_kg * GRAVITY_MPS2 * (math.sin(angle) + lorry.rolling * math.cos(angle))
    needed = speed * (force + 0.5 * AIR_KGPM3 * lorry.drag_area_m2 * speed**2)
    if speed < 85 / 3.6 - 1e-6:
        assert needed == pytest.approx(lorry.power_w, rel=1e-6)
    else:
        assert needed <= lorry.power_w


def test_known_figures() -> None:
    """A rider of 120 W rolls at 20 to 25 km/h on the level and climbs 6 % at about 7; a laden lorry crawls up 6 %."""
    rider, lorry = VEHICLES[Kind.BICYCLE], VEHICLES[Kind.TRUCK]
    assert 20 < rider.speed_kmh(0, "residential") < 25
    assert 6 < rider.speed_kmh(6, "residential") < 8
    assert 35 < lorry.speed_kmh(6, "motorway") < 50
    assert lorry.speed_kmh(-10, "motorway") < 50 < lorry.speed_kmh(-3, "motorway")
    assert VEHICLES[Kind.E_BIKE].speed_kmh(2, "residential") == pytest.approx(25, abs=0.1)
    assert 9 < VEHICLES[Kind.E_BIKE].speed_kmh(10, "residential") < 14


def test_given_values_replace_the_usual_ones_and_bound_all_roads() -> None:
    chosen = SpeedOptions(vehicle=Kind.CAR, max_kmh=50, drag_area_m2=0.0, rolling=0.0).chosen()
    assert chosen.limit_kmh("motorway") == 50 and chosen.limit_kmh("living_street") == 10
    assert chosen.drag_area_m2 == 0 and chosen.rolling == 0
    assert np.isfinite(chosen.speeds_kmh(SLOPES_PERCENT, "motorway")).all()
