"""States of satellites: against an independent library on measured navigation, and by what orbits must obey."""

from __future__ import annotations

import numpy as np
import pyrtklib
import pytest

from fusion.gnss.orbits.glonass import glonass_states
from fusion.gnss.orbits.kepler import RATE_RADPS, is_geostationary, kepler_states
from fusion.gnss.orbits.satellites import choose_kepler, states_at, states_when_sent
from fusion.signals import BEIDOU, GALILEO, GLONASS, GPS, LIGHT_MPS, QZSS, Navigation
from gnss_support import TOE_S, glonass_row_of, gnss_file, kepler_row_of
from satellites.library import (
    glonass_records,
    glonass_table,
    kepler_records,
    kepler_table,
    library_record,
    library_state,
    navigation_of,
)

FILES = ("BRDC00WRD_S_20230730000_01D_MN.rnx", "brdc1180.21n", "brdc1370.20g", "brdc1370.20n")


@pytest.mark.parametrize("name", FILES)
def test_kepler_agrees_with_the_library_all_day(name: str) -> None:
    path = gnss_file(name)
    eph = navigation_of(path).kepler
    for row, record in enumerate(kepler_records(path)):
        gps_s = eph.toe_s[row] + np.linspace(-86_400.0, 86_400.0, 25)
        position, _, clock, _ = kepler_states(eph, np.full(25, row), gps_s)
        for k, t in enumerate(gps_s):
            place, lead = library_state(pyrtklib.eph2pos, record, t)
            assert np.linalg.norm(position[k] - place) < 1e-5
            assert abs(clock[k] - lead) < 1e-15


@pytest.mark.parametrize(
    ("system", "number", "root_a", "eccentricity"),
    [(GPS, 7, 5153.7, 0.02), (GALILEO, 18, 5291.0, 0.16), (BEIDOU, 3, 6493.4, 0.001), (BEIDOU, 9, 6493.1, 0.01),
     (BEIDOU, 25, 5282.6, 0.001), (BEIDOU, 60, 6493.4, 0.001), (QZSS, 2, 6493.2, 0.075)],
)  # fmt: skip
def test_a_synthetic_day_of_records_agrees_with_the_library(
    system: int, number: int, root_a: float, eccentricity: float
) -> None:
    toes = TOE_S + 3_600.0 * np.arange(24) + np.where(np.arange(24) == 5, -16.0, 0.0)
    rows = [
        kepler_row_of(system, number, root_a=root_a, eccentricity=eccentricity, toe_s=toe)
        | {"m0_rad": 0.26 * k, "omega_rad": 0.1 * k, "af2_per_s": 1e-18}
        for k, toe in enumerate(toes)
    ]
    navigation = Navigation(kepler_table(rows))
    gps_s = TOE_S + np.arange(0.0, 86_400.0, 450.0)
    which = choose_kepler(navigation.kepler, np.full(192, system), np.full(192, number), gps_s)
    ours = states_at(navigation, np.full(192, system), np.full(192, number), gps_s)
    for k, t in enumerate(gps_s):
        place, lead = library_state(pyrtklib.eph2pos, library_record(rows[which[k]]), t)
        assert np.linalg.norm(ours.position_m[k] - place) < 1e-5
        assert abs(ours.clock_s[k] - lead) < 1e-15


@pytest.mark.parametrize("name", FILES)
def test_glonass_agrees_with_the_library_through_its_validity(name: str) -> None:
    path = gnss_file(name)
    eph = navigation_of(path).glonass
    for row, record in enumerate(glonass_records(path)):
        gps_s = eph.toe_s[row] + np.linspace(-1_800.0, 1_800.0, 25)
        position, _, clock, _ = glonass_states(eph, np.full(25, row), gps_s)
        for k, t in enumerate(gps_s):
            place, lead = library_state(pyrtklib.geph2pos, record, t)
            assert np.linalg.norm(position[k] - place) < 0.01  # their constant of gravity is that of 1990
            assert abs(clock[k] - lead) < 1e-15


@pytest.mark.parametrize(
    ("system", "number", "root_a"),
    [(GPS, 7, 5153.7), (GALILEO, 11, 5440.6), (BEIDOU, 3, 6493.4), (BEIDOU, 9, 6493.1), (BEIDOU, 25, 5282.6),
     (QZSS, 2, 6493.2)],
)  # fmt: skip
def test_velocity_and_clock_rate_are_derivatives(system: int, number: int, root_a: float) -> None:
    eph = kepler_table([kepler_row_of(system, number, root_a=root_a, eccentricity=0.02)])
    gps_s = eph.toe_s[0] + np.linspace(-7_000.0, 7_000.0, 40)
    which = np.zeros(40, np.int64)
    _, velocity, _, rate = kepler_states(eph, which, gps_s)
    after, _, clock_after, _ = kepler_states(eph, which, gps_s + 0.5)
    before, _, clock_before, _ = kepler_states(eph, which, gps_s - 0.5)
    assert np.allclose(velocity, after - before, atol=2e-5)
    assert np.allclose(rate, clock_after - clock_before, rtol=1e-4, atol=1e-18)


def test_without_corrections_an_orbit_keeps_its_energy_and_comes_back() -> None:
    eph = kepler_table([kepler_row_of(GPS, 1, eccentricity=0.01, plain=True)])
    mu, axis = 3.986005e14, eph.root_a[0] ** 2
    period_s = 2.0 * np.pi * np.sqrt(axis**3 / mu)
    gps_s = eph.toe_s[0] + np.linspace(0.0, period_s, 33)
    position, velocity, _, _ = kepler_states(eph, np.zeros(33, np.int64), gps_s)
    inertial = velocity + np.cross([0.0, 0.0, RATE_RADPS[GPS]], position)
    radius = np.linalg.norm(position, axis=1)
    energy = 0.5 * np.sum(inertial**2, axis=1) - mu / radius
    assert np.allclose(energy, -mu / (2.0 * axis), rtol=1e-12)
    assert radius[-1] == pytest.approx(radius[0], abs=1e-4)
    assert position[-1, 2] == pytest.approx(position[0, 2], abs=2e-3)  # a double holds GPS seconds to 2e-7


def test_a_geostationary_satellite_stays_over_its_place() -> None:
    # the frame is tilted about the x axis: an orbit inclined as much, its node opposite, is the equator's
    rate = RATE_RADPS[BEIDOU]
    row = kepler_row_of(BEIDOU, 2, root_a=(3.986004418e14 / rate**2) ** (1 / 6), eccentricity=0.0, plain=True)
    node_rad = np.pi + rate * ((row["toe_s"] - 14.0) % 604_800.0)
    eph = kepler_table([row | {"i0_rad": np.radians(5.0), "omega0_rad": node_rad}])
    gps_s = eph.toe_s[0] + np.linspace(-7_200.0, 7_200.0, 9)
    position, velocity, _, _ = kepler_states(eph, np.zeros(9, np.int64), gps_s)
    assert np.allclose(position, position[0], atol=0.01)
    assert np.allclose(velocity, 0.0, atol=1e-5)
    assert is_geostationary(np.array([BEIDOU, BEIDOU, BEIDOU, GPS]), np.array([5, 6, 60, 3])).tolist() == [
        True, False, True, False,
    ]  # fmt: skip


def test_glonass_keeps_its_velocity_and_its_energy() -> None:
    eph = glonass_table([glonass_row_of(3)])
    gps_s = eph.toe_s[0] + np.linspace(-1_700.0, 1_700.0, 30)
    which = np.zeros(30, np.int64)
    _, velocity, _, _ = glonass_states(eph, which, gps_s)
    after, before = (glonass_states(eph, which, gps_s + shift)[0] for shift in (0.5, -0.5))
    assert np.allclose(velocity, after - before, atol=1e-5)
    there, speed, _, _ = glonass_states(eph, which[:1], eph.toe_s[:1] + 1_800.0)
    back = glonass_table([glonass_row_of(3) | {"position_m": there[0], "velocity_mps": speed[0]}])
    again, _, _, _ = glonass_states(back, which[:1], back.toe_s[:1] - 1_800.0)
    assert np.linalg.norm(again[0] - eph.position_m[0]) < 1e-3


def test_glonass_of_the_worked_example() -> None:
    """GLONASS ICD for CDMA signals, general description, edition 1.0 (2016), appendix J: a state of 2012-09-07.

    Carried on by ten minutes with exact forces of sun and moon it is where the appendix says to the millimetre, and
    half a metre away with their broadcast accelerations.
    """
    row = glonass_row_of(1, toe_s=11_700.0) | {
        "position_m": [7_003_008.789, -12_206_626.953, 21_280_765.625],
        "velocity_mps": [783.5417, 2_804.2530, 1_352.5150],
        "acceleration_mps2": [0.0, 1.7e-6, -5.41e-6],
    }
    position, velocity, _, _ = glonass_states(
        glonass_table([row]), np.zeros(1, np.int64), np.array([12_300.0])
    )
    assert np.linalg.norm(position[0] - [7_523_174.819, -10_506_961.965, 21_999_239.413]) < 1.0
    assert np.linalg.norm(velocity[0] - [950.126007, 2_855.687825, 1_040.679862]) < 0.005


def test_the_group_delay_comes_off_the_clock_and_the_channel_gives_the_carrier() -> None:
    navigation = Navigation(
        kepler_table(
            [kepler_row_of(GPS, 1) | {"group_delay_s": 5e-9}, kepler_row_of(GPS, 1) | {"number": 2}]
        ),
        glonass_table([glonass_row_of(3) | {"channel": -4}]),
    )
    toe_s = navigation.kepler.toe_s[0]
    found = states_at(navigation, np.array([GPS, GPS, GLONASS]), np.array([1, 2, 3]), np.full(3, toe_s))
    assert found.clock_s[1] - found.clock_s[0] == pytest.approx(5e-9, abs=1e-17)
    assert found.carrier_hz.tolist() == [1_575.42e6, 1_575.42e6, 1_602e6 - 4 * 562.5e3]
    assert found.known.all() and found.healthy.all()


def test_the_time_of_transmission_does_not_hang_on_the_receivers_clock() -> None:
    navigation = Navigation(kepler_table([kepler_row_of(GPS, 1) | {"af0_s": 7e-4}]))
    system, number = np.array([GPS]), np.array([1])
    toe_s = navigation.kepler.toe_s[0]
    sent = states_when_sent(navigation, system, number, np.array([toe_s]), np.array([22e6]))
    true_s = toe_s - 22e6 / LIGHT_MPS - sent.clock_s
    assert np.allclose(sent.position_m, states_at(navigation, system, number, true_s).position_m, atol=2e-3)
    late_m = 0.003 * LIGHT_MPS
    late = states_when_sent(navigation, system, number, np.array([toe_s + 0.003]), np.array([22e6 + late_m]))
    assert np.allclose(late.position_m, sent.position_m, atol=2e-3)
