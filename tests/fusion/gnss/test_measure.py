"""Measurements from raw signals: exact where all is known, dropped and counted where not, and what is said of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pyrtklib
import pytest

from fusion.frames import local_axes
from fusion.gnss.clock_jumps import STEP_M
from fusion.gnss.earth import elevation_azimuth
from fusion.gnss.measure import measure
from fusion.gnss.measurements import Measurements
from fusion.signals import BEIDOU, GALILEO, GLONASS, GPS, LIGHT_MPS, QZSS, SBAS, Navigation, RawGnss, Signals
from fusion.types import Floats, no_progress
from gnss_support import (
    BERLIN_M,
    TOE_S,
    even_sky,
    gnss_file,
    measured,
    with_clock_steps,
)
from satellites.library import (
    gps_seconds,
    library_navigation,
    library_position,
    library_signals,
    navigation_of,
)
from source_tree import REPOSITORY

EPOCHS = 30
TAGS = TOE_S + np.arange(EPOCHS, dtype=float)
DRIVE_M = BERLIN_M + np.arange(EPOCHS)[:, None] * np.array([8.0, -9.0, 4.0])
CLOCK_M = 1e4 + 70.0 * np.arange(EPOCHS)
BIASES_M = {GLONASS: 80.0, GALILEO: -30.0, BEIDOU: 15.0}


@pytest.fixture(scope="module")
def raw() -> RawGnss:
    return measured(
        even_sky(GPS, GALILEO, BEIDOU, GLONASS), TAGS, DRIVE_M, CLOCK_M, bias_m=BIASES_M, lowest_rad=-0.3
    )


def measure_quietly(raw: RawGnss) -> Measurements:
    return measure(raw, no_progress)


def left_m(made: Measurements, user_m: Floats) -> Floats:
    """What is left of the pseudoranges beside the distances from a place at each epoch, (n,)."""
    return made.pseudorange_m - np.linalg.norm(made.satellite_m - user_m[made.epoch], axis=1)


def test_satellites_clocks_and_air_are_taken_off(raw: RawGnss) -> None:
    made = measure_quietly(raw)
    air = -(left_m(made, DRIVE_M) - CLOCK_M[made.epoch])
    for group, name in enumerate(made.groups):
        bias = BIASES_M.get({"GLONASS": GLONASS, "Galileo": GALILEO, "BeiDou": BEIDOU}.get(name, GPS), 0.0)
        rows = made.group == group
        # the simulation has no air: what was taken off for it is left, 3 m at the zenith and 60 m at the mask
        taken, high = air[rows] + bias, made.elevation_rad[rows]
        assert np.all((taken > 3.0) & (taken < 60.0))
        assert np.corrcoef(taken, 1.0 / np.sin(high))[0, 1] > 0.6
    sight = made.satellite_m - DRIVE_M[made.epoch]
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    assert np.allclose(made.range_rate_mps, np.sum(made.satellite_mps * sight, axis=1), atol=1e-3)
    elevation, azimuth = elevation_azimuth(DRIVE_M[made.epoch], made.satellite_m)
    assert np.allclose(made.elevation_rad, elevation, atol=1e-4)
    assert np.allclose(made.azimuth_rad, azimuth, atol=1e-3)
    assert np.linalg.norm(made.rough_m - DRIVE_M[15]) < 1_000.0
    assert made.groups[0] == "GPS"
    assert len(made) == EPOCHS
    assert not made.clock_anew.any()


def test_the_simulated_sky_is_what_a_library_positions_by() -> None:
    path = gnss_file("brdc1180.21n")
    gps_s = np.array([gps_seconds(library_navigation(path).eph[0].toe) + 3_600.0])
    raw = measured(navigation_of(path), gps_s, BERLIN_M[None], np.array([3e4]), lowest_rad=0.2)
    off = pyrtklib.IONOOPT_OFF, pyrtklib.TROPOPT_OFF
    theirs = library_position(raw.signals, 0, library_navigation(path), *off)
    assert np.linalg.norm(theirs - BERLIN_M) < 0.01


def test_air_that_a_library_expects_is_taken_off_again() -> None:
    path = gnss_file("brdc1180.21n")
    gps_s = np.array([gps_seconds(library_navigation(path).eph[0].toe) + 3_600.0])
    raw = measured(navigation_of(path), gps_s, BERLIN_M[None], np.array([3e4]), lowest_rad=0.35)
    made = measure_quietly(raw)
    air = 3e4 - left_m(made, BERLIN_M[None])
    order = np.array([made.names.index(f"G{n:02d}") for n in raw.signals.number])
    through_air = raw.signals.pseudorange_m + air[np.argsort(made.satellite)][order]
    signals = replace(raw.signals, pseudorange_m=through_air)
    options = pyrtklib.IONOOPT_BRDC, pyrtklib.TROPOPT_SAAS
    theirs = library_position(signals, 0, library_navigation(path), *options)
    assert np.linalg.norm(theirs - BERLIN_M) < 0.5  # they map the troposphere by 1 / sin(elevation)


def test_rows_that_cannot_be_used_are_counted_by_reason(raw: RawGnss) -> None:
    signals = raw.signals
    epoch = signals.epoch
    ranges = signals.pseudorange_m.copy()
    ranges[[0, 1]] = np.nan
    ranges[2] = 5.0
    ranges[np.flatnonzero((signals.system == GALILEO) & (epoch == 3))[-1]] += 5e5
    gps = np.flatnonzero(signals.system == GPS)
    lost, sick = np.unique(signals.number[gps])[[0, 3]]
    kepler = raw.navigation.kepler
    mine = kepler.system == GPS
    navigation = replace(
        raw.navigation,
        kepler=replace(
            kepler,
            number=np.where(mine & (kepler.number == lost), 63, kepler.number),
            healthy=~(mine & (kepler.number == sick)),
        ),
    )
    made = measure_quietly(RawGnss(replace(signals, pseudorange_m=ranges), navigation))
    good = np.isfinite(ranges) & (ranges > 1e7)
    assert made.counts["no pseudorange"] == 2
    assert made.counts["impossible pseudorange"] == 2
    assert made.counts["no ephemeris"] == np.count_nonzero(
        good & (signals.system == GPS) & (signals.number == lost)
    )
    assert made.counts["unhealthy"] == np.count_nonzero(
        good & (signals.system == GPS) & (signals.number == sick)
    )
    assert made.counts["below the mask"] > 0
    assert f"G{lost:02d}" not in made.names
    assert len(made.satellite) == len(epoch) - sum(made.counts.values())


def test_signals_under_a_wrong_systems_letter_are_dropped(raw: RawGnss) -> None:
    signals = raw.signals.take_rows(raw.signals.system != BEIDOU)
    wrong = replace(signals, system=np.where(signals.system == GALILEO, BEIDOU, signals.system))
    made = measure_quietly(replace(raw, signals=wrong))
    assert made.groups == ("GPS", "GLONASS")
    assert not any(name.startswith("C") for name in made.names)
    assert made.counts["impossible pseudorange"] + made.counts["below the mask"] >= np.sum(
        signals.system == GALILEO
    )
    assert np.linalg.norm(made.rough_m - DRIVE_M[15]) < 1_000.0


@pytest.mark.parametrize("tags_jump", [False, True])
def test_jumps_of_the_clock_are_added_back_and_counted(raw: RawGnss, tags_jump: bool) -> None:
    steps = STEP_M * np.repeat([0, 1, -2, -1], [7, 9, 4, 10]).astype(float)
    if tags_jump:
        jumped = measured(raw.navigation, TAGS + steps / LIGHT_MPS, DRIVE_M, CLOCK_M + steps, bias_m=BIASES_M)
    else:
        jumped = with_clock_steps(raw, steps)
    made, plain = measure_quietly(jumped), measure_quietly(raw)
    assert made.counts["clock jumps repaired"] == 3
    # a millisecond beside its tag is up to a metre of the satellite's way
    assert np.allclose(left_m(made, DRIVE_M), left_m(plain, DRIVE_M), atol=0.01 if tags_jump else 2.5)


def test_a_restart_begins_a_new_clock(raw: RawGnss) -> None:
    made = measure_quietly(with_clock_steps(raw, np.where(np.arange(EPOCHS) < 12, 0.0, 4_321_000.0)))
    assert made.counts["clock begins anew"] == 1
    assert np.flatnonzero(made.clock_anew).tolist() == [12]


def test_few_satellites_are_said_and_keep_their_epochs(raw: RawGnss) -> None:
    signals = raw.signals
    place = np.arange(len(signals.system)) - signals.first[signals.epoch]
    made = measure_quietly(replace(raw, signals=signals.take_rows((signals.epoch >= 10) | (place < 3))))
    assert len(made) == EPOCHS
    assert any(said.startswith("Fewer than four satellites for 10 of 30 epochs") for said in made.warnings)


def test_without_a_place_there_are_no_rows_and_a_sentence(raw: RawGnss) -> None:
    signals = raw.signals
    place = np.arange(len(signals.system)) - signals.first[signals.epoch]
    for some in (signals.take_rows(place < 3), Signals.empty()):
        made = measure_quietly(replace(raw, signals=some))
        assert len(made.satellite) == 0
        assert len(made) == len(some)
        assert np.isnan(made.rough_m).all()
        assert any("No epoch has 4 satellites" in said for said in made.warnings) or not len(some)


def test_without_coefficients_an_average_day_is_said(raw: RawGnss) -> None:
    assert any("ionosphere" in said for said in measure_quietly(raw).warnings)
    known = replace(raw.navigation, klobuchar=(1e-8, 0.0, 0.0, 0.0, 9e4, 0.0, 0.0, 0.0))
    assert measure_quietly(replace(raw, navigation=known)).warnings == ()


def test_the_reference_clock_is_gps_or_the_richest() -> None:
    one = measured(even_sky(BEIDOU, GALILEO), TAGS[:2], DRIVE_M[:2], CLOCK_M[:2])
    most = (
        BEIDOU if np.sum(one.signals.system == BEIDOU) >= np.sum(one.signals.system == GALILEO) else GALILEO
    )
    assert measure_quietly(one).groups[0] == ("BeiDou" if most == BEIDOU else "Galileo")


def brought(raw: RawGnss, systems: Sequence[int]) -> RawGnss:
    """A log that says itself where satellites are, in the frame of transmission, free of clocks and air."""
    made = measure_quietly(raw)
    flight_s = np.linalg.norm(made.satellite_m - DRIVE_M[made.epoch], axis=1) / LIGHT_MPS
    angle = -7.2921151467e-5 * flight_s
    x, y, z = made.satellite_m.T
    place = np.column_stack([np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x, z])
    rows = len(made.satellite)
    signals = Signals.assemble(
        TAGS[made.epoch], np.array(systems)[np.arange(rows) % len(systems)], made.satellite + 1,
        pseudorange_m=flight_s * LIGHT_MPS + CLOCK_M[made.epoch], position_m=place, range_rate_mps=np.zeros(rows),
    )  # fmt: skip
    return RawGnss(signals, Navigation())


def test_logs_that_bring_satellites_need_the_earths_turn_alone(raw: RawGnss) -> None:
    made = measure_quietly(brought(raw, [GPS, QZSS, SBAS]))
    assert np.allclose(left_m(made, DRIVE_M), CLOCK_M[made.epoch], atol=0.01)
    assert made.groups == ("GPS",)
    assert made.warnings == ()
    assert made.counts == {}
    assert np.isnan(made.range_rate_mps).all()  # without the satellites' velocities they say nothing


def test_rows_of_such_logs_without_a_satellite_are_counted(raw: RawGnss) -> None:
    whole = brought(raw, [GPS])
    places = whole.signals.position_m.copy()
    places[[3, 50]] = np.nan
    made = measure_quietly(RawGnss(replace(whole.signals, position_m=places)))
    assert made.counts == {"no satellite position": 2}
    assert len(made.satellite) == len(places) - 2


@pytest.mark.parametrize("name", ["pixel6.23o", "rinex_obs_mixed_types.20o"])
def test_navigation_of_another_day_gives_no_position(name: str) -> None:
    signals = library_signals(gnss_file(name))
    navigation = navigation_of(gnss_file("BRDC00WRD_S_20230730000_01D_MN.rnx"), gnss_file("brdc1180.21n"))
    made = measure_quietly(RawGnss(signals, navigation))
    assert len(made.satellite) == 0
    assert made.counts["no ephemeris"] == len(signals.system)
    day = "2023-11-07" if name.endswith("23o") else "2020-05-21"
    assert any("GPS are of 2021-04-28 to 2023-03-14" in said and day in said for said in made.warnings)
    assert not any("No epoch" in said for said in made.warnings)


def test_least_squares_of_a_real_drive_reach_what_the_notes_say() -> None:
    folder = REPOSITORY.parent / "shared" / "data" / "smartloc"
    if not folder.exists():
        pytest.skip(f"no measured data at {folder}")
    lines = (folder / "smartLoc__Berlin_Potsdamer_Platz_Input.txt").read_text().splitlines()
    rows = np.array([line.split()[1:11] for line in lines if line.startswith("pseudorange3")], float)
    truth = np.loadtxt(folder / "smartLoc__Berlin_Potsdamer_Platz_GT.txt", usecols=(1, 2, 3, 4))
    system = np.where(rows[:, 7] == 4, GLONASS, GPS)
    gps_s = 1.2e9 + rows[:, 0]
    signals = Signals.assemble(
        gps_s,
        system,
        rows[:, 6] % 100,
        pseudorange_m=rows[:, 1],
        position_m=rows[:, 3:6],
        cn0_dbhz=rows[:, 9],
    )
    made = measure_quietly(RawGnss(signals))
    places = np.array([least_squares(made, k) for k in range(len(made))])
    where = np.searchsorted(1.2e9 + truth[:, 0], signals.gps_s - 0.05)
    enu = np.einsum("nij,nj->ni", local_axes(truth[where, 1:]), places - truth[where, 1:])
    assert np.hypot(enu[:, 0], enu[:, 1]).mean() == pytest.approx(30.4, abs=0.1)
    assert np.linalg.norm(enu, axis=1).mean() == pytest.approx(77.0, abs=0.5)
    assert made.counts == {}


def least_squares(made: Measurements, epoch: int) -> Floats:
    """The place (3,) of an epoch by plain least squares with a bias of the second clock."""
    rows = slice(made.first[epoch], made.first[epoch + 1])
    state = np.append(made.rough_m, [0.0, 0.0])
    other = (made.group[rows] == 1).astype(float)
    for _ in range(6):
        away = made.satellite_m[rows] - state[:3]
        far = np.linalg.norm(away, axis=1)
        design = np.column_stack([-away / far[:, None], np.ones(len(far)), other])
        rest = made.pseudorange_m[rows] - far - design[:, 3:] @ state[3:]
        state += np.linalg.lstsq(design, rest, rcond=None)[0]
    return state[:3]
