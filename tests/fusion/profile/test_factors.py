"""The factors of a drive's passes: what their measurements see, which count, and what each says of itself."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from factor_support import street
from fusion.frames import GRAVITY_MPS2
from fusion.network.adjust import adjust
from fusion.network.curve import (
    grade_rows,
    grade_variance,
    height_rows,
    height_variance,
    interval_count,
    knot_length,
    variable_count,
)
from fusion.network.pass_factor import (
    BIAS,
    CONSTANTS,
    EAST,
    ENTRY,
    EXIT,
    LAG,
    NUISANCES,
    SPEED_PRESSURE,
    SQUAT,
    PassFactor,
)
from fusion.network.pass_factor import MOUNT as MOUNT_PITCH
from fusion.pipeline import run_drive
from fusion.profile.levels import ROBUST_INFORMATION_LOSS
from fusion.profile.measurements import ALTITUDE, BARO, FORCE, PITCH, TERRAIN
from fusion.profile.model import MOUNT, decorrelated
from fusion.profile.prior import ALTIMETER_DRIFT
from fusion.profile.traversals import (
    Altimeter,
    segment_lengths,
)
from fusion.simulate.write.csv_file import csv_columns
from fusion.types import DriveLog
from profile_support import Levels, Smoothed, World, hills, log_of, smoothed, street_log
from street_drives import (
    ALONG_M,
    EDGES_M,
    TABLE,
    TIME_S,
    data_of,
    drive_log,
    factors_of,
    own_measurements,
    traversals,
)

LONG_TABLE = street(*[80.0] * 122)
LONG_S = 1.7e9 + np.arange(1200.0)
LONG_M = 5 + 8 * (LONG_S - LONG_S[0])
KINDS = (
    "everything",
    "positions and heights",
    "barometer as well",
    "steady heights",
    "back again",
    "jump",
    "outage",
)


@pytest.fixture(scope="module", params=KINDS)
def drive(request: pytest.FixtureRequest) -> tuple[Smoothed, list[PassFactor]]:
    one = smoothed(drive_log(request.param), TABLE)
    return one, factors_of(one)


def test_every_measurement_sees_what_its_sensor_does(drive: tuple[Smoothed, list[PassFactor]]) -> None:
    """Restated row by row: the road at its place, in the direction driven, and the drive's own errors."""
    one, _ = drive
    data, measured = data_of(one), one.measured
    clean, share = decorrelated(measured, one.learned.noise)
    _, distance = one.path.match.position_on(measured.along_m)
    length, scale = segment_lengths(one.path)
    q = one.learned.expected.roughness
    for k in range(len(one.path.match)):
        mine = own_measurements(one, k)
        assert data.first[k + 1] - data.first[k] == len(mine)
        for at, i in enumerate(mine.tolist(), start=int(data.first[k])):
            sensor, here = int(measured.sensor[i]), np.array([distance[i] * scale[k]])
            left, sign = 1 - share[i], 1.0 if one.path.match.forward[k] else -1.0
            row = np.zeros(int(variable_count(length[k])))
            row[data.variable[at] : data.variable[at] + 4] = data.weights[at]
            is_height = sensor in (ALTITUDE, BARO)
            if is_height:
                expected, inside = height_rows(here, length[k])[0], height_variance(here, length[k], q)[0]
            else:
                expected = left * sign * grade_rows(here, length[k])[0]
                inside = left**2 * grade_variance(here, length[k], q)[0]
            assert row == pytest.approx(expected, abs=1e-12)
            assert data.variance[at] == pytest.approx(
                ROBUST_INFORMATION_LOSS * one.learned.variance[i] + inside
            )
            assert data.value[at] == clean.value[i]
            constants = np.zeros(len(CONSTANTS))
            if sensor in (PITCH, FORCE):
                constants[MOUNT_PITCH] = left
            if sensor == FORCE:
                constants[BIAS] = 1.0
            squat = {PITCH: 1.0, FORCE: -share[i]}.get(sensor, 0.0)
            constants[SQUAT] = squat * measured.acceleration_mps2[i]
            assert data.constants[at, :EAST] == pytest.approx(constants[:EAST], abs=1e-15)
            leans = left if sensor in (PITCH, FORCE) else 0.0
            assert data.passing[at, 0] == pytest.approx(one.learned.expected.wander * leans, abs=1e-15)
            pressed = float(sensor == BARO)
            assert data.passing[at, 2] == pytest.approx(one.learned.expected.gust_m * pressed, abs=1e-15)
            head = pressed * measured.speed_mps[i] ** 2 / (2 * GRAVITY_MPS2)
            assert data.constants[at, SPEED_PRESSURE] == pytest.approx(-head, abs=1e-12)
            assert data.height_sensor[at] == {ALTITUDE: 0, BARO: 1}.get(sensor, -1)


def test_an_altimeter_that_is_late_shows_its_lag_in_its_own_heights() -> None:
    one = smoothed(drive_log("barometer as well"), TABLE)
    plain, late = data_of(one), data_of(one, Altimeter(ALTITUDE, 1.5))
    mine = late.height_sensor == 0
    assert np.all(late.constants[~mine, LAG] == 0)
    climb = np.interp(
        late.time_s[mine],
        TIME_S,
        8 * np.gradient(hills(np.arange(0, 900, 0.1)), 0.1)[(10 * ALONG_M).astype(int)],
    )
    assert late.constants[mine, LAG] == pytest.approx(-climb, abs=0.3)
    # The heights were put where the vehicle was 1.5 s before: the rest of the lag is what is left to find.
    assert late.value[mine] == pytest.approx(plain.value[mine] + 1.5 * late.constants[mine, LAG])
    for factor in factors_of(one, Altimeter(ALTITUDE, 1.5)):
        assert factor.lag_s == 1.5
        assert factor.used[LAG] == (factor.observations > 1 or factor.used[ENTRY.start])


def test_factors_are_symmetric_and_no_information_is_less_than_none(
    drive: tuple[Smoothed, list[PassFactor]],
) -> None:
    """Lifting the road and lowering the errors of heights changes nothing."""
    _, factors = drive
    for factor in factors:
        scale = max(np.abs(factor.information).max(), 1.0)
        np.testing.assert_allclose(factor.information, factor.information.T, atol=1e-12 * scale)
        values = np.linalg.eigvalsh(factor.information)
        assert values[0] > -1e-9 * max(values[-1], 1.0)
        lifted = np.zeros(len(factor.vector))
        knots = int(variable_count(knot_length(TABLE.length_m[factor.segment])))
        lifted[:knots:2] = 1.0
        lifted[knots + len(CONSTANTS) :] = -1.0
        np.testing.assert_allclose(factor.information @ lifted, 0, atol=1e-7 * scale)
        assert factor.square >= 0


def test_a_factor_speaks_of_its_own_passage(drive: tuple[Smoothed, list[PassFactor]]) -> None:
    one, factors = drive
    match, lengths = one.path.match, TABLE.length_m
    assert len(factors) == len(traversals(one)) >= len(TABLE) - 1
    for k, factor in zip(traversals(one), factors, strict=True):
        assert (factor.segment, factor.sequence) == (match.segment[k], k)
        assert (factor.first_time_s, factor.last_time_s) == (match.enter_time_s[k], match.leave_time_s[k])
        assert 0 <= factor.start_m <= factor.end_m <= max(float(lengths[factor.segment]), 1.0) + 1e-6
        mine = own_measurements(one, k)
        assert factor.rows == len(mine)
        seconds = np.unique(np.round(one.measured.time_s[mine]))
        assert 1 <= factor.observations <= max(len(seconds), 1) + 1
        assert factor.roughness == one.learned.expected.roughness
        assert factor.walk_m2_per_s == (one.learned.expected.drift, one.learned.expected.baro_drift)
        knots = 2 * (int(interval_count(knot_length(lengths[factor.segment]))) + 1)
        assert len(factor.vector) == knots + NUISANCES
        sensors = set(one.measured.sensor[mine].tolist())
        assert factor.used[MOUNT_PITCH] == bool(sensors & {PITCH, FORCE})
        assert factor.used[BIAS] == (FORCE in sensors)
        assert factor.used[SPEED_PRESSURE] == (BARO in sensors)
        inertial = np.isin(one.measured.sensor, (PITCH, FORCE)).any()
        assert factor.grade_length_m == (one.learned.noise.grade_length_m if inertial else 0.0)
        for s, sensor in enumerate((ALTITUDE, BARO)):
            # An error goes on through a pass that did not measure it, where the drive knows it at all.
            known = bool((one.measured.sensor == sensor).any())
            assert factor.used[ENTRY.start + s] == factor.used[EXIT.start + s] == known


def test_elevation_models_are_the_network_s_affair(tmp_path_factory: pytest.TempPathFactory) -> None:
    """One raster is one source, however many drives there are: no factor holds any of it."""
    world = World(tmp_path_factory.mktemp("profile"))
    drive = world.drive(1, duration_s=200.0)
    one = smoothed(log_of(csv_columns(drive)), drive.town.roads, world.dem(1))
    assert (one.measured.sensor == TERRAIN).sum() > 20
    data = data_of(one)
    traversal, _ = one.path.match.position_on(one.measured.along_m)
    assert len(data.value) == np.sum((one.measured.sensor != TERRAIN) & (traversal >= 0))
    assert sum(f.rows for f in factors_of(one)) <= len(data.value)


def test_a_doubtful_pass_says_less() -> None:
    one = smoothed(drive_log("everything"), TABLE)
    half = replace(one.path.match, confidence=np.where(np.arange(len(one.path.match)) == 3, 0.6, 1.0))
    doubtful = factors_of(replace(one, path=replace(one.path, match=half)))
    sure = factors_of(
        replace(one, path=replace(one.path, match=replace(half, confidence=np.ones(len(half)))))
    )
    for a, b in zip(doubtful, sure, strict=True):
        share = 0.6 if a.sequence == 3 else 1.0
        assert a.information == pytest.approx(share * b.information)
        assert a.vector == pytest.approx(share * b.vector)
        assert a.square == pytest.approx(share * b.square)


def test_a_pass_that_is_probably_wrong_says_nothing() -> None:
    one = smoothed(drive_log("everything"), TABLE)
    match = replace(one.path.match, confidence=np.where(np.arange(len(one.path.match)) == 3, 0.4, 1.0))
    factors = factors_of(replace(one, path=replace(one.path, match=match)))
    assert 3 not in [f.sequence for f in factors]
    assert len(factors) == len(match) - 1


def test_passes_before_and_after_a_mount_moved_do_not_share_it() -> None:
    """Nor does the one on which it moved share with either: of its two settings nobody knows which."""
    one = smoothed(drive_log("everything"), TABLE)
    when = TIME_S[50] + 0.2
    k = int(np.searchsorted(one.epochs.time_s, when))
    moved = replace(one, learned=replace(one.learned, jumps=((k, MOUNT),)))
    time = float(one.epochs.time_s[k])
    numbers = {"before": set(), "during": set(), "after": set()}
    for f in factors_of(moved):
        place = "before" if f.last_time_s < time - 1 else "after" if f.first_time_s > time + 1 else "during"
        numbers[place].add(f.mount)
    assert len(numbers["before"]) == len(numbers["after"]) == 1
    assert numbers["during"]
    assert not numbers["before"] & numbers["after"]
    assert not numbers["during"] & (numbers["before"] | numbers["after"])
    assert {f.mount for f in factors_of(one)} == {0}


@pytest.mark.slow
def test_what_passes_say_alone_is_honest() -> None:
    """Each solved by itself lies within its own sigma of the truth."""
    inside, worth = [], []
    for seed in range(24):
        one = smoothed(drive_log("everything", seed), TABLE)
        for factor in factors_of(one):
            length = float(TABLE.length_m[factor.segment])
            if length < 20 or factor.end_m - factor.start_m < 0.95 * length:
                continue
            alone = np.arange(len(TABLE)) == factor.segment
            found = adjust(TABLE.subset(alone), {0: [replace(factor, segment=0)]})
            x = EDGES_M[factor.segment] + np.linspace(0, length, 100)
            true = 100 * np.polyfit(x, hills(x), 1)[0]
            inside.append(abs(found.slope_percent[0] - true) < 1.96 * found.slope_sigma_percent[0])
            worth.append(found.slope_sigma_percent[0])
    assert np.mean(inside) > 0.9
    assert np.median(worth) < 1.5


def test_a_drive_s_factors_are_those_of_its_log() -> None:
    """``run_drive`` hands on what is made here, with the altimeter's lag where the heights are an altimeter's."""
    log = drive_log("everything")
    _, result = run_drive(log, TABLE, None)
    again = factors_of(smoothed(log, TABLE))
    assert [f.encode() for f in result.factors] == [f.encode() for f in again]
    assert result.late_by is None


def unstated(drift: float, seed: int) -> DriveLog:
    """Twenty minutes with velocities, and altitudes without accuracies that err by so much (m^2/s)."""
    levels = Levels(altitude_m=0.1, drift=drift)
    rng = np.random.default_rng(seed)
    log = street_log(LONG_S, LONG_M, hills, rng, levels=levels, without=("attitude", "force"))
    return replace(log, fix=replace(log.fix, v_acc_m=np.full(len(log.fix), np.nan)))


def test_heights_that_err_as_slowly_as_the_air_s_pressure_are_an_altimeter_s() -> None:
    """They may be late, and can be put right."""
    _, result = run_drive(unstated(0.001, 0), LONG_TABLE, None)
    assert result.late_by is not None
    assert {f.lag_s for f in result.factors} == {1.5}
    assert all(f.used[LAG] for f in result.factors if f.rows > 2)
    later = result.late_by(3.0)
    assert {f.lag_s for f in later} == {3.0}
    assert [f.segment for f in later] == [f.segment for f in result.factors]


@pytest.mark.parametrize(("drift", "stated_m", "low", "high"), [
    (0.001, math.nan, 0.9, 1.1),  # an altimeter's, whatever the log seems to say
    (0.15, math.nan, 10.0, 45.0),  # a receiver's: not far from a usual one
    (0.15, 3.5, 1.0, 25.0),  # whose log says how sure it is
])  # fmt: skip
def test_altitudes_alone_do_not_tell_how_fast_they_drift(
    drift: float, stated_m: float, low: float, high: float
) -> None:
    rng = np.random.default_rng(0)
    without = ("attitude", "force", "velocity")
    log = street_log(LONG_S, LONG_M, hills, rng, levels=Levels(altitude_m=0.3, drift=drift), without=without)
    log = replace(log, fix=replace(log.fix, v_acc_m=np.full(len(log.fix), stated_m)))
    _, result = run_drive(log, LONG_TABLE, None)
    assert result.report["altimeter"] == (high < 2)
    assert low < result.report["noise"]["drift"] / ALTIMETER_DRIFT.rate < high


@pytest.mark.slow
@pytest.mark.parametrize("drift", [0.001, 0.01])
def test_heights_of_the_best_receivers_are_no_altimeter_s(drift: float) -> None:
    """Of those that fix no carrier phase: 0.8 m for two minutes. Air drifts by 0.8 m in ten."""
    late = [run_drive(unstated(drift, seed), LONG_TABLE, None)[1].late_by for seed in range(3)]
    assert [by is not None for by in late] == [drift < 0.002] * 3
