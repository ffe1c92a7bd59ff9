"""The method ``odometer-map`` on drives: outages bridged within sigma, the paper's policy, what logs lack."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from fusion.errors import BadOptionsError
from fusion.methods.base import DriveResult
from fusion.pipeline import parse_options, run_drive
from fusion.published.odometer_map.method import prepare
from fusion.published.odometer_map.options import OdometerMapOptions
from fusion.roads.network import RoadNetwork
from fusion.simulate.drive import SimulatedDrive
from fusion.simulate.receiver.wheels import WheelSet
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import csv_columns
from fusion.terrain.dem import Dem
from fusion.types import AngularRate, Attitude, DriveLog, GnssVelocity, Odometry, no_progress
from profile_support import identities, log_of
from published.odometer_map.scene import TEN_PERCENT_WHEELS, lahrech_drive

MakeLog = Callable[..., DriveLog]
NAME = "odometer-map"
SEEDS = (1, 2, 3, 4, 5, 6)


@cache
def paper_drive(seed: int, wheels: WheelSet = TEN_PERCENT_WHEELS) -> tuple[SimulatedDrive, DriveLog]:
    drive = lahrech_drive(seed, wheels=wheels)
    return drive, log_of(csv_columns(drive))


def fuse(drive: SimulatedDrive, log: DriveLog, **options: object) -> DriveResult:
    return run_drive(log, drive.town.roads, None, method=NAME, options=options)[1]


def in_outages(drive: SimulatedDrive, result: DriveResult) -> tuple[np.ndarray, np.ndarray]:
    """Horizontal errors and their sigmas (2-D, as stated) at the epochs without GNSS, metres."""
    row = np.searchsorted(drive.time_s, result.track.time_s - 1e-3)
    x, y = drive.town.projection.to_xy(result.track.lon_deg, result.track.lat_deg)
    error = np.hypot(x - drive.truth.x_m[row], y - drive.truth.y_m[row])
    lost = ~drive.has_gnss[row]
    return error[lost], result.track.h_sigma_m[lost]


def without_wheels(log: DriveLog) -> DriveLog:
    unknown = np.full(len(log.odometry), np.nan)
    odometry = replace(log.odometry, wheel_left_rad=unknown, wheel_right_rad=unknown)
    return replace(log, odometry=odometry)


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["paper", "always"])
def test_outages_are_bridged_within_sigma(policy: str) -> None:
    """40 s and 31 s by wheels that are 90 % reliable."""
    found = [in_outages(drive, fuse(drive, log, policy=policy)) for drive, log in map(paper_drive, SEEDS)]
    error, sigma = (np.concatenate(part) for part in zip(*found, strict=True))
    assert len(error) == len(SEEDS) * 71
    assert np.median(error) < 4.0
    assert error.max() < 35.0
    # The error lies along the road, so that it is nearly one-dimensional: 95 % within 1.96 sigma.
    assert np.mean(error <= 1.96 * sigma) > 0.93
    assert 0.5 < np.sqrt(np.mean((error / sigma) ** 2)) < 1.3


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["paper", "always"])
def test_ordinary_wheels_keep_an_outage_under_the_papers_figure(policy: str) -> None:
    """Std of the position error at most 1.25 m (section 4.2)."""
    for seed in SEEDS:
        drive, log = paper_drive(seed, WheelSet())
        error, _ = in_outages(drive, fuse(drive, log, policy=policy))
        assert error.std() < 1.25
        assert error.max() < 7.0


@pytest.mark.slow
def test_a_speed_signal_and_a_gyroscope_stand_in_for_wheels() -> None:
    for seed in SEEDS[:3]:
        drive, log = paper_drive(seed)
        error, sigma = in_outages(drive, fuse(drive, without_wheels(log)))
        assert error.max() < 10.0
        assert np.mean(error <= 1.96 * sigma) > 0.93


@pytest.mark.slow
def test_wrong_radii_are_found_out_where_everything_is_fused() -> None:
    """Radii given 8 % too large: calibrated, an outage is as good as ever; the paper's policy runs ahead."""
    drive, log = paper_drive(1, WheelSet())
    wrong = {"wheel_radius_left_m": 0.324, "wheel_radius_right_m": 0.324}
    result = fuse(drive, log, policy="always", **wrong)
    assert result.report["wheel_scale"] == pytest.approx(
        0.3 / 0.324, abs=3 * result.report["wheel_scale_sigma"]
    )
    assert result.report["wheel_scale_sigma"] < 0.02
    calibrated, _ = in_outages(drive, result)
    as_given, _ = in_outages(drive, fuse(drive, log, **wrong))
    assert calibrated.max() < 7.0
    assert as_given.max() > 2 * calibrated.max()


def test_the_paper_ignores_odometers_and_map_while_there_is_gnss(make_log: MakeLog, town: Town) -> None:
    """Bit by bit the same with and without wheels, speed signal and roads' direction."""
    log = make_log(4, duration_s=120, wheels=TEN_PERCENT_WHEELS)
    bare = replace(log, odometry=Odometry.empty(), rate=AngularRate.empty(), attitude=Attitude.empty())
    assert np.all(np.diff(log.fix.time_s) < 1.5)
    tracks = [run_drive(x, town.roads, None, method=NAME)[1].track for x in (log, bare)]
    blind = run_drive(log, town.roads, None, method=NAME, options={"match_gate": 0.2})[1].track
    for name in ("lat_deg", "lon_deg", "alt_m", "speed_mps", "h_sigma_m", "pitch_rad"):
        np.testing.assert_array_equal(getattr(tracks[0], name), getattr(tracks[1], name))
        np.testing.assert_array_equal(getattr(tracks[0], name), getattr(blind, name))
    always = run_drive(log, town.roads, None, method=NAME, options={"policy": "always"})[1].track
    assert not np.array_equal(tracks[0].lat_deg, always.lat_deg)


def test_without_a_match_the_filter_runs_open_loop(make_log: MakeLog, town: Town) -> None:
    log = make_log(2, duration_s=200, outages=[(80.0, 20.0)], wheels=WheelSet())
    _, matched = run_drive(log, town.roads, None, method=NAME)
    _, alone = run_drive(log, town.roads, None, method=NAME, options={"match_gate": 0.05})
    assert matched.report["map_epochs"] > 10
    assert alone.report["map_epochs"] <= 3
    assert alone.report["open_loop_epochs"] >= 17
    lost = ~alone.track.has_gnss
    assert lost.sum() == 20
    last = np.flatnonzero(lost)[-1]
    assert alone.track.h_sigma_m[last] > matched.track.h_sigma_m[last]


def test_points_of_a_map_lie_apart_as_asked(make_log: MakeLog, town: Town) -> None:
    log = make_log(2, duration_s=200, outages=[(80.0, 20.0)], wheels=WheelSet())
    near = RoadNetwork.project(town.roads, town.projection)
    run, _ = prepare(log, near, None, OdometerMapOptions(map_step_m=5.0))
    taken = []
    match = run.roads.match

    def watch(*args: object) -> object:
        taken.append(match(*args))
        return taken[-1]

    run.roads.match = watch  # type: ignore[method-assign]
    run.run(no_progress)
    points = [m for m in taken if m is not None]
    assert len(points) > 150
    for m in points:
        at_end = m.distance_m == pytest.approx(near.length_m[m.segment])
        assert at_end or m.distance_m % 5.0 == pytest.approx(0.0, abs=1e-9)
        x = near.x0[m.segment] + m.distance_m * np.cos(near.heading_rad[m.segment])
        assert m.x_m == pytest.approx(x, abs=1e-6)
        assert m.mahalanobis <= OdometerMapOptions().match_gate


def test_a_position_that_may_be_anywhere_matches_no_road(make_log: MakeLog, town: Town) -> None:
    log = make_log(2, duration_s=240, outages=[(80.0, 60.0)])
    blind = replace(log, odometry=Odometry.empty())
    _, near = run_drive(blind, town.roads, None, method=NAME)
    sigma, segment = near.track.h_sigma_m, near.track.segment
    assert sigma.max() > 100.0
    assert np.all(
        segment[sigma > 100.0] == -1
    )  # 50 m on the widest axis are at most 71 m in 2-D, before the match
    _, far = run_drive(blind, town.roads, None, method=NAME, options={"match_within_m": 1e6})
    assert np.any(far.track.segment[far.track.h_sigma_m > 100.0] >= 0)


def test_what_bridged_an_outage_is_reported(make_log: MakeLog, town: Town) -> None:
    log = make_log(2, duration_s=200, outages=[(80.0, 20.0)], wheels=WheelSet())
    _, result = run_drive(log, town.roads, None, method=NAME)
    report = result.report
    assert report["outage_share"] == pytest.approx(20 / len(result.track))
    assert report["wheel_epochs"] == 20
    assert report["speed_epochs"] == 0
    assert 0 < report["map_epochs"] <= 20
    assert report["map_epochs"] + report["open_loop_epochs"] == 20
    assert report["match_gate"] ** 2 == pytest.approx(7.815)
    assert (report["wheel_scale"], report["wheel_scale_sigma"]) == (1.0, 0.0)
    assert report["warnings"] == []


def test_an_outage_that_nothing_bridges_is_told(make_log: MakeLog, town: Town) -> None:
    log = make_log(2, duration_s=200, outages=[(80.0, 20.0)])
    options = {"inertial_turns": False}
    _, straight = run_drive(log, town.roads, None, method=NAME, options=options)
    assert straight.report["speed_epochs"] == 20
    assert any("20 epochs" in w and "nothing that feels turns" in w for w in straight.report["warnings"])
    _, blind = run_drive(replace(log, odometry=Odometry.empty()), town.roads, None, method=NAME)
    assert any("20 epochs" in w and "map alone" in w for w in blind.report["warnings"])
    assert np.isfinite(blind.track.lat_deg).all()
    lost = np.flatnonzero(~blind.track.has_gnss)
    assert blind.track.h_sigma_m[lost[-1]] > 50.0


def test_no_slope_is_drawn_where_nothing_measured_a_height(make_log: MakeLog, town: Town) -> None:
    log = make_log(2, duration_s=200, outages=[(80.0, 30.0)], wheels=WheelSet())
    network, result = run_drive(log, town.roads, None, method=NAME)
    track = result.track
    lost = ~track.has_gnss
    only_lost = set(track.segment[lost]) - set(track.segment[~lost]) - {-1}
    assert only_lost
    assert not only_lost & {s.segment for s in result.slopes}
    assert len(network) > 0


def test_slopes_are_less_sure_while_the_altitude_settles_after_an_outage(
    make_log: MakeLog, town: Town
) -> None:
    whole = make_log(6, duration_s=240, wheels=WheelSet())
    cut = make_log(6, duration_s=240, outages=[(100.0, 40.0)], wheels=WheelSet())
    end_s = cut.fix.time_s[np.argmax(np.diff(cut.fix.time_s)) + 1]
    sure, settling = (
        {
            s.segment: s
            for s in run_drive(log, town.roads, None, method=NAME, options={"policy": "always"})[1].slopes
        }
        for log in (whole, cut)
    )
    after = [k for k, s in settling.items() if k in sure and end_s <= s.first_time_s < end_s + 6.0]
    assert after
    for k in after:
        assert settling[k].slope_sigma_percent > 2 * sure[k].slope_sigma_percent
    late = [k for k, s in settling.items() if k in sure and s.first_time_s > end_s + 40.0]
    assert late
    for k in late:
        assert settling[k].slope_sigma_percent < 1.1 * sure[k].slope_sigma_percent


def test_terrain_gives_the_heights_that_a_log_lacks(make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    log = make_log(2, duration_s=300)
    unknown = np.full(len(log.fix), np.nan)
    flat = replace(
        log,
        fix=replace(log.fix, alt_msl_m=unknown, height_ell_m=unknown),
        velocity=GnssVelocity.empty(),
    )
    network, result = run_drive(flat, town.roads, town_dem, method=NAME)
    assert result.report["dem_used_share"] > 0.8
    truth = dict(zip(identities(town.roads), town.true_slope_percent, strict=True))
    keys = identities(network.table)
    error = np.array([s.slope_percent - truth[keys[s.segment]] for s in result.slopes])
    sigma = np.array([s.slope_sigma_percent for s in result.slopes])
    assert len(error) > 10
    assert np.mean(np.abs(error) <= 1.96 * sigma) > 0.85
    with_heights = run_drive(log, town.roads, town_dem, method=NAME)[1]
    assert with_heights.report["dem_used_share"] == 0.0


def test_what_is_not_given_follows_the_policy() -> None:
    paper, always = parse_options(NAME), parse_options(NAME, {"policy": "always"})
    assert (paper.doppler, paper.calibrate) == (False, False)  # type: ignore[attr-defined]
    assert (always.doppler, always.calibrate) == (True, True)  # type: ignore[attr-defined]
    given = parse_options(NAME, {"policy": "always", "doppler": False, "calibrate": "false"})
    assert (given.doppler, given.calibrate) == (False, False)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "wrong", [{"policy": "never"}, {"track_width_m": 0}, {"wheel_radius_left_m": -0.3}, {"map_step_m": 0}]
)
def test_senseless_options_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(BadOptionsError):
        parse_options(NAME, wrong)


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["paper", "always"])
@pytest.mark.parametrize("receiver", ["m8", "phone", "f9p"])
def test_slopes_are_as_good_as_their_sigmas_say(
    policy: str, receiver: str, town: Town, make_log: MakeLog
) -> None:
    truth = dict(zip(identities(town.roads), town.true_slope_percent, strict=True))
    inside = []
    for seed in (31, 32, 33):
        log = make_log(seed, duration_s=500, receiver=receiver, outages=[(200.0, 40.0)], wheels=WheelSet())
        network, result = run_drive(log, town.roads, None, method=NAME, options={"policy": policy})
        keys = identities(network.table)
        inside += [
            abs(s.slope_percent - truth[keys[s.segment]]) <= 1.96 * s.slope_sigma_percent
            for s in result.slopes
        ]
    assert len(inside) > 150
    assert np.mean(inside) > 0.9


@pytest.mark.slow
def test_a_recorded_road_with_its_gnss_cut(
    karlsruhe: Path, receiver_log: Callable[..., Path], tmp_path: Path
) -> None:
    """The log has a speed signal and a yaw; its positions are gone from 60 s to 100 s."""
    from app.cli.logs.fusing import Fusion  # noqa: PLC0415 - the command's own way of putting logs together
    from fusion.formats import read_log  # noqa: PLC0415
    from fusion.roads.osm import read_roads  # noqa: PLC0415

    whole = receiver_log("09", tmp_path / "whole.csv", seed=3)
    cut = receiver_log("09", tmp_path / "cut.csv", seed=3, cut=["60:40"])
    roads = read_roads(karlsruhe / "roads_09_10.osm")
    fusion = Fusion(NAME, parse_options(NAME), roads, None)
    fusion.add(cut)
    assert sum(f.slope_percent is not None for f in fusion.features()) > 10
    (_, reference), (_, bridged) = (
        run_drive(read_log(path), roads, None, method=NAME, options={"policy": "always"})
        for path in (whole, cut)
    )
    lost = ~bridged.track.has_gnss
    assert lost.sum() in (40, 41)
    apart = (
        111_320.0
        * np.hypot(
            np.interp(bridged.track.time_s, reference.track.time_s, reference.track.lat_deg)
            - bridged.track.lat_deg,
            np.cos(np.radians(49.0))
            * (
                np.interp(bridged.track.time_s, reference.track.time_s, reference.track.lon_deg)
                - bridged.track.lon_deg
            ),
        )[lost]
    )
    assert np.median(apart) < 5.0
    assert np.mean(apart <= 2.5 * bridged.track.h_sigma_m[lost]) > 0.9
