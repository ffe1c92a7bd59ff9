"""Logs as they come: few sensors, other rates, irregular times, wild values, holes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.errors import MissingSensorError
from fusion.methods.base import DriveResult
from fusion.pipeline import run_drive
from fusion.profile.climbs import HeightLine, ascent, height_lines, steepest
from fusion.simulate.drive import SimulatedDrive
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import csv_columns
from fusion.types import DriveLog
from profile_support import (
    Change,
    Columns,
    Outcome,
    World,
    coverage,
    identities,
    inside,
    judged,
    log_of,
    pressure_of,
    rmse,
    unchanged,
)

FLEET = ((1, "m8"), (2, "phone"), (3, "m8"))
LENGTH_S = 350.0
HEIGHTS = ("alt_msl_m", "v_acc_m")
POSITIONS = ("time_s", "lat_deg", "lon_deg")


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return World(tmp_path_factory.mktemp("profile"))


@pytest.fixture(scope="module")
def fleet(world: World) -> list[SimulatedDrive]:
    return [world.drive(seed, receiver=receiver, duration_s=LENGTH_S) for seed, receiver in FLEET]


def keep(table: Columns, *names: str) -> None:
    for name in set(table) - set(names):
        del table[name]


def bare(table: Columns) -> None:
    """What a GPX file holds."""
    keep(table, *POSITIONS, "alt_msl_m")


def without_altitude(table: Columns) -> None:
    for name in HEIGHTS:
        del table[name]


@pytest.mark.slow
def test_positions_and_elevations_alone_give_honest_slopes(world: World, fleet: list[SimulatedDrive]) -> None:
    outcomes = [world.outcome(drive, bare) for drive in fleet]
    assert coverage(outcomes) >= 0.97
    assert inside(outcomes) > 0.85
    assert rmse(outcomes) < 2.0
    raw = [world.outcome(drive, bare, method="raw") for drive in fleet]
    assert rmse(outcomes) < rmse(raw) / 2
    # The sigmas say that this is less than a whole log: not the same number for everything.
    clean = [world.clean(drive) for drive in fleet]
    for less, more in zip(outcomes, clean, strict=True):
        assert np.median(less.sigma) > 1.3 * np.median(more.sigma)
        assert any("Doppler" in warning for warning in less.report["warnings"])


def height_lines_of(outcome: Outcome) -> list[list[HeightLine]]:
    """Heights along a drive: as they were estimated, and as they are."""
    track, town = outcome.result.track, outcome.town
    rows = np.flatnonzero(track.segment >= 0)
    row_of = {key: row for row, key in enumerate(identities(town.roads))}
    own = identities(outcome.network.table)
    segment = np.array([row_of[own[s]] for s in track.segment[rows]])
    share = np.clip(track.distance_m[rows] / town.length_m[segment], 0, 1)
    x, y = town.projection.to_xy(track.lon_deg[rows], track.lat_deg[rows])
    along = np.r_[0, np.cumsum(np.hypot(np.diff(x), np.diff(y)))]
    sigmas = (track.alt_sigma_m[rows], 100 * track.pitch_sigma_rad[rows], track.after_outage[rows])
    return [
        height_lines(along, height, *sigmas)
        for height in (track.alt_m[rows], town.road_height(segment, share))
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("change", "most_sigma_m"), [(unchanged, 8), (bare, 30)])
def test_the_ascent_of_a_drive_is_true_within_its_sigma(
    world: World, fleet: list[SimulatedDrive], change: Change, most_sigma_m: float
) -> None:
    for drive in fleet:
        estimated, true = height_lines_of(world.outcome(drive, change))
        found, exact = ascent(estimated), ascent(true)
        assert abs(found.up_m - exact.up_m) < 2.5 * found.up_sigma_m
        assert abs(found.down_m - exact.down_m) < 2.5 * found.down_sigma_m
        assert max(found.up_sigma_m, found.down_sigma_m) < most_sigma_m
        steep = steepest(estimated)
        assert steep is not None
        along, height = next((of.along_m, of.height_m) for of in true if of.along_m[-1] >= steep.to_m)
        rise = np.diff(np.interp([steep.from_m, steep.to_m], along, height))[0]
        assert abs(steep.percent - 100 * rise / (steep.to_m - steep.from_m)) < 2.5 * steep.sigma_percent


@pytest.mark.slow
def test_doppler_without_altitudes_is_nearly_as_good(world: World, fleet: list[SimulatedDrive]) -> None:
    outcomes = [world.outcome(drive, without_altitude) for drive in fleet]
    assert coverage(outcomes) >= 0.97
    assert inside(outcomes) > 0.85
    assert rmse(outcomes) < 1.3 * rmse([world.clean(drive) for drive in fleet])


def pressed(drive: SimulatedDrive, seed: int) -> DriveLog:
    """Positions and a barometer that drifts by half a metre in five minutes."""
    table = csv_columns(drive)
    keep(table, *POSITIONS)
    log = log_of(table)
    rng = np.random.default_rng(seed)
    time = drive.time_s
    drift = np.cumsum(0.03 * np.sqrt(np.diff(time, prepend=time[0])) * rng.normal(size=len(time)))
    height = drive.truth.z_m + drift + 0.1 * rng.normal(size=len(time)) - 35.0
    return replace(log, pressure=pressure_of(time, height))


@pytest.mark.slow
def test_a_barometer_alone_gives_honest_slopes(world: World, fleet: list[SimulatedDrive]) -> None:
    outcomes = []
    for drive in fleet:
        network, result = run_drive(pressed(drive, drive.seed), drive.town.roads, world.dem(drive.town.seed))
        outcomes.append(judged(drive, network, result))
        assert set(result.report["sensors"]) <= {"barometer", "dem"}
    assert coverage(outcomes) >= 0.97
    assert inside(outcomes) > 0.9
    assert rmse(outcomes) < 0.6


def at_rate(world: World, rate_hz: float) -> list[Outcome]:
    """The same ways at another rate."""
    return [
        world.clean(world.drive(seed, receiver=receiver, duration_s=LENGTH_S, rate_hz=rate_hz))
        for seed, receiver in FLEET
    ]


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [5.0, 10.0])
def test_rates_agree_within_sigma(rate_hz: float, world: World) -> None:
    """More epochs repeat the errors of springs and receivers; they may help a little, they prove no more."""
    slow, fast = at_rate(world, 1.0), at_rate(world, rate_hz)
    assert coverage(fast) >= 0.97
    assert inside(fast) > 0.85
    apart = []
    for a, b in zip(slow, fast, strict=True):
        assert a.segment.tolist() == b.segment.tolist()
        apart.append((a.error - b.error) / np.hypot(a.sigma, b.sigma))
        assert np.median(b.sigma) > np.median(a.sigma) / 3
        z = b.error / b.sigma
        assert np.sqrt(np.mean(z**2)) < 1.5, "sigma three times too small, or nearly so"
    assert np.mean(np.abs(np.concatenate(apart)) < 1.96) > 0.9


@pytest.mark.slow
def test_irregular_epochs_do_no_harm(world: World) -> None:
    """Of a 5 Hz log four in five epochs are lost at random: still about one a second."""
    outcomes = []
    for seed, receiver in FLEET:
        drive = world.drive(seed, receiver=receiver, duration_s=LENGTH_S, rate_hz=5.0)

        def change(table: Columns, seed: int = seed) -> None:
            stay = np.random.default_rng(seed).random(len(table["time_s"])) < 0.2
            for name in table:
                table[name] = table[name][stay]

        outcomes.append(world.outcome(drive, change))
    assert coverage(outcomes) >= 0.97
    assert inside(outcomes) > 0.85
    assert rmse(outcomes) < 1.4 * rmse(at_rate(world, 1.0))


def wild(table: Columns) -> None:
    """One height in twenty is 20 m off, one climb rate in twenty 4 m/s."""
    rng = np.random.default_rng(3)
    n = len(table["time_s"])
    for name, size in (("alt_msl_m", 20.0), ("vel_d_mps", 4.0)):
        chosen = rng.choice(n, n // 20, replace=False)
        table[name] = table[name].copy()
        table[name][chosen] += size * rng.choice([-1.0, 1.0], len(chosen))


@pytest.mark.slow
def test_wild_values_are_counted_and_given_little_weight(world: World, fleet: list[SimulatedDrive]) -> None:
    outcomes = [world.outcome(drive, wild) for drive in fleet]
    for drive, outcome in zip(fleet, outcomes, strict=True):
        n = len(drive.time_s)
        sensors = outcome.report["sensors"]
        assert sensors["altitude"]["outliers"] > 0.7 * (n // 20)
        # Standing and crawling epochs have no Doppler slope, and a slope beyond 60 % is not even looked at.
        assert sensors["doppler"]["outliers"] > 0.3 * (n // 20)
        assert sensors["pitch"]["outliers"] <= 0.01 * n
        assert not outcome.report["height_jumps_s"]
        assert rmse([outcome]) < 1.5 * rmse([world.clean(drive)])
    assert inside(outcomes) > 0.85


@pytest.mark.slow
def test_an_outage_costs_little_and_leaves_no_hole(world: World) -> None:
    whole, holed = [], []
    for seed, receiver in FLEET:
        whole.append(world.clean(world.drive(seed, receiver=receiver, duration_s=LENGTH_S)))
        drive = world.drive(seed, receiver=receiver, duration_s=LENGTH_S, outages=((150.0, 40.0),))
        holed.append(world.outcome(drive))
        t = holed[-1].result.track.time_s - drive.start_time_s
        moving = (drive.elapsed_s > 150) & (drive.elapsed_s < 190) & (drive.truth.speed_mps > 1.5)
        assert np.sum((t > 150) & (t < 190)) > 0.9 * moving.sum() > 10, "the track goes on by pitch"
    assert coverage(holed) >= 0.97
    assert inside(holed) > 0.85
    assert rmse(holed) < 1.4 * rmse(whole)


def run(log: DriveLog, town: Town, **options: object) -> DriveResult:
    return run_drive(log, town.roads, None, options=options)[1]


def test_positions_alone_say_what_is_missing(world: World, fleet: list[SimulatedDrive]) -> None:
    table = csv_columns(fleet[0])
    keep(table, *POSITIONS)
    with pytest.raises(MissingSensorError, match=r"Record altitudes.*\.$"):
        run(log_of(table), fleet[0].town)


def test_with_every_option_off_nothing_is_left(world: World, fleet: list[SimulatedDrive]) -> None:
    off = dict.fromkeys(("altitude", "doppler", "pitch", "force", "barometer", "dem"), False)
    log = log_of(csv_columns(fleet[0]))
    with pytest.raises(MissingSensorError, match="0 usable"):
        run_drive(log, fleet[0].town.roads, world.dem(1), options=off)
    assert run(log, fleet[0].town, **(off | {"doppler": True})).slopes


@pytest.mark.slow
@pytest.mark.parametrize(
    ("option", "sensor"),
    [("altitude", "altitude"), ("doppler", "doppler"), ("pitch", "pitch"), ("force", "specific force")],
)
def test_an_option_leaves_its_sensor_out(option: str, sensor: str, fleet: list[SimulatedDrive]) -> None:
    log = log_of(csv_columns(fleet[0]))
    assert sensor in run(log, fleet[0].town).report["sensors"]
    assert sensor not in run(log, fleet[0].town, **{option: False}).report["sensors"]
