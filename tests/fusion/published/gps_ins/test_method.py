"""The three GPS/INS methods on whole drives: accuracy, calibration, policies, outages, options, report."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fusion.catalogue import METHODS
from fusion.errors import BadOptionsError, MissingSensorError
from fusion.formats import read_log
from fusion.methods.base import DriveResult
from fusion.pipeline import parse_options, run_drive
from fusion.roads.osm import read_roads
from fusion.roads.table import RoadTable
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town
from fusion.terrain.dem import Dem
from fusion.types import Attitude, DriveLog, GnssVelocity, Odometry
from profile_support import identities

MakeLog = Callable[..., DriveLog]
ALL = ("gps-ins-kf", "gps-ins-ekf", "gps-ins-ukf")
THIRD = ALL[1:]
Errors = tuple[np.ndarray, np.ndarray]


def errors(
    log: DriveLog, town: Town, dem: Dem | None, method: str, options: dict[str, object] | None = None
) -> Errors:
    """Errors and sigmas of a drive's slopes, percent."""
    network, result = run_drive(log, town.roads, dem, method=method, options=options)
    truth = dict(zip(identities(town.roads), town.true_slope_percent, strict=True))
    keys = identities(network.table)
    pairs = [(s.slope_percent - truth[keys[s.segment]], s.slope_sigma_percent) for s in result.slopes]
    error, sigma = np.array(pairs).T
    return error, sigma


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def run(log: DriveLog, town: Town, method: str, **options: object) -> DriveResult:
    return run_drive(log, town.roads, None, method=method, options=options)[1]


def off_track(result: DriveResult, town: Town, log: DriveLog, seed: int, **drive: object) -> np.ndarray:
    """Distance of the track from where the vehicle really was, m."""
    simulated = simulate_drive(town, seed, **drive)  # type: ignore[arg-type]
    lon, lat = town.projection.to_lonlat(simulated.truth.x_m, simulated.truth.y_m)
    track = result.track
    lon, lat = (np.interp(track.time_s, simulated.time_s, value) for value in (lon, lat))
    east = (track.lon_deg - lon) * math.cos(math.radians(float(lat[0])))
    distance: np.ndarray = 111_320.0 * np.hypot(east, track.lat_deg - lat)
    return distance


@pytest.mark.slow
def test_slopes_beat_both_baselines_and_are_calibrated(make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    """Pooled over drives of two receiver classes; the margin is wide, the benchmark holds the figures."""
    found: dict[str, list[Errors]] = {name: [] for name in (*ALL, "raw", "dem")}
    for seed, receiver in ((1, "m8"), (2, "m8"), (3, "phone")):
        log = make_log(seed, duration_s=300, receiver=receiver)
        for name, pairs in found.items():
            pairs.append(errors(log, town, town_dem, name))
    pooled = {name: np.concatenate(pairs, axis=1) for name, pairs in found.items()}
    for name in ALL:
        error, sigma = pooled[name]
        assert rms(error) < 0.5 * min(rms(pooled["raw"][0]), rms(pooled["dem"][0]))
        assert np.mean(np.abs(error) <= 1.96 * sigma) > 0.9
    # The three differ by far less than they err.
    assert abs(rms(pooled[ALL[0]][0]) - rms(pooled[ALL[2]][0])) < 0.2 * rms(pooled[ALL[0]][0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "policy"),
    [(name, policy) for name in THIRD for policy in ("command", "overwrite", "measurement")],
)
def test_every_heading_policy_bridges_an_outage(
    method: str, policy: str, make_log: MakeLog, town: Town
) -> None:
    drive = {"duration_s": 240, "outages": [(100.0, 40.0)]}
    log = make_log(2, **drive)
    result = run(log, town, method, heading=policy)
    off, lost = off_track(result, town, log, 2, **drive), ~result.track.has_gnss
    assert lost.sum() >= 39
    # 40 s by a perfect yaw and an odometer that is off by a percent.
    assert off[lost].max() < 15.0
    assert result.track.h_sigma_m[lost].max() > 2 * result.track.h_sigma_m[~lost].max()
    assert result.report["heading_policy"] == policy
    assert result.report["filter_starts"] == 1


def test_as_a_command_the_heading_makes_one_method_of_the_three(make_log: MakeLog, town: Town) -> None:
    log = make_log(1, duration_s=240)
    plain = run(log, town, "gps-ins-kf")
    for method in THIRD:
        other = run(log, town, method, heading="command")
        assert np.allclose(other.track.lat_deg, plain.track.lat_deg, rtol=0, atol=1e-11)
        assert [s.segment for s in other.slopes] == [s.segment for s in plain.slopes]


def test_an_outage_without_an_odometer_ends_in_ignorance_and_not_on_a_wrong_road(
    make_log: MakeLog, town: Town
) -> None:
    drive = {"duration_s": 240, "outages": [(100.0, 60.0)]}
    log = replace(make_log(2, **drive), odometry=Odometry.empty())
    result = run(log, town, "gps-ins-ekf")
    track, lost = result.track, ~result.track.has_gnss
    off = off_track(result, town, log, 2, **drive)
    end = np.flatnonzero(lost)[-1]
    assert off[end] < 2 * track.h_sigma_m[end]
    assert track.segment[end] == -1
    # The first fixes afterwards bring it back.
    assert off[end + 5 :].max() < 10.0


def test_the_report_says_what_was_done(make_log: MakeLog, town: Town) -> None:
    log = make_log(2, duration_s=240, outages=[(100.0, 40.0)])
    wild = log.fix.lat_deg.copy()
    wild[[20, 50]] += 0.005
    report = run(replace(log, fix=replace(log.fix, lat_deg=wild)), town, "gps-ins-ukf").report
    assert report["gated_fixes"] == 2
    assert report["outage_share"] == pytest.approx(40 / 240, abs=0.02)
    assert 0 < report["mean_nis"] < 1e6
    assert report["heading_sources"]["yaw"] == 1.0
    assert report["heading_policy"] == "measurement"
    assert abs(report["heading_offset_deg"]) < 2.0
    assert 0.5 < report["matched_share"] <= 1.0


def test_altitudes_or_terrain_measure_the_height(make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    log = make_log(1, duration_s=240)
    unknown = np.full(len(log.fix), np.nan)
    flat = replace(log, fix=replace(log.fix, alt_msl_m=unknown, height_ell_m=unknown))
    for source, options in ((flat, {}), (log, {"height": "dem"})):
        error, sigma = errors(source, town, town_dem, "gps-ins-ekf", options)
        assert rms(error) < 1.5
        assert np.mean(np.abs(error) <= 1.96 * sigma) > 0.85
        with pytest.raises(MissingSensorError, match=r"DEM.*altitudes"):
            run(source, town, "gps-ins-ekf", **options)


def test_without_pitch_and_vertical_velocity_the_altitudes_are_followed(
    make_log: MakeLog, town: Town
) -> None:
    log = make_log(1, duration_s=240)
    level = replace(log.velocity, vel_d_mps=np.full(len(log.velocity), np.nan))
    bare = DriveLog("csv", log.fix, velocity=level)
    error, sigma = errors(bare, town, None, "gps-ins-kf")
    raw, _ = errors(bare, town, None, "raw")
    assert rms(error) < 1.25 * rms(raw)
    assert np.mean(np.abs(error) <= 1.96 * sigma) > 0.85


def test_a_wrongly_mounted_yaw_sensor_is_turned_unless_told_not_to(make_log: MakeLog, town: Town) -> None:
    log = make_log(1, duration_s=240)
    misaligned = replace(log, attitude=replace(log.attitude, yaw_rad=log.attitude.yaw_rad + 1.0))
    aligned = run(misaligned, town, "gps-ins-ekf")
    assert aligned.report["heading_offset_deg"] == pytest.approx(math.degrees(1.0), abs=2.0)
    assert aligned.report["matched_share"] > 0.9
    left = run(misaligned, town, "gps-ins-ekf", align_heading=False)
    assert left.report["heading_offset_deg"] == 0.0
    assert left.report["mean_nis"] > 10 * aligned.report["mean_nis"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "options"),
    [
        ("gps-ins-kf", {"command_form": "printed"}),
        ("gps-ins-ekf", {"innovation": "printed", "heading": "overwrite"}),
        ("gps-ins-ekf", {"jacobian": "printed", "heading_sigma_rad": 3.0}),
        ("gps-ins-ekf", {"heading": "overwrite", "heading_reset": False}),
        ("gps-ins-ukf", {"alpha": 1e3, "heading_sigma_rad": 3.0}),
        ("gps-ins-ukf", {"redraw": False}),
        ("gps-ins-ukf", {"heading": "overwrite", "heading_reset": False}),
    ],
)
@pytest.mark.parametrize("gate", [0.999, 1.0])
def test_printed_forms_run_and_stay_finite(
    method: str, options: dict[str, object], gate: float, make_log: MakeLog, town: Town
) -> None:
    """What they do to the estimate stands in test_models; here they must not break a drive."""
    log = make_log(1, duration_s=240)
    track = run(log, town, method, **options, gate_probability=gate).track
    assert np.isfinite(track.lat_deg).all()
    assert np.isfinite(track.h_sigma_m).all()
    corrected = run(log, town, method).track
    assert not np.array_equal(track.lat_deg, corrected.lat_deg)


@pytest.mark.parametrize(
    ("method", "option", "value"),
    [
        ("gps-ins-kf", "heading", "measurement"),
        ("gps-ins-kf", "alpha", 1e-3),
        ("gps-ins-kf", "heading_walk_rad", 0.1),
        ("gps-ins-kf", "command_form", "literal"),
        ("gps-ins-ekf", "heading", "ignored"),
        ("gps-ins-ekf", "innovation", "wrong"),
        ("gps-ins-ekf", "jacobian", 1),
        ("gps-ins-ekf", "kappa", 0),
        ("gps-ins-ukf", "alpha", 0),
        ("gps-ins-ukf", "alpha", 1e4),
        ("gps-ins-ukf", "beta", -1),
        ("gps-ins-ukf", "kappa", -2),
        ("gps-ins-ukf", "redraw", "maybe"),
        *((name, option, value) for name in ALL for option, value in (
            ("period_s", 0), ("command_at", "end"), ("gnss_sigma_m", 0), ("fix_correlation_s", -1),
            ("process_sigma_m", 0), ("drift_share", -0.1), ("heading_sigma_rad", 0), ("hold_s", -1),
            ("gate_probability", 0), ("gate_probability", 1.1), ("restart_after", 0), ("min_speed_mps", -1),
            ("height", "barometer"), ("climb", "steep"), ("min_epochs", 1), ("map_sigma_m", 0),
        )),
    ],
)  # fmt: skip
def test_options_out_of_range_are_refused(method: str, option: str, value: object) -> None:
    with pytest.raises(BadOptionsError, match=option) as refusal:
        parse_options(method, {option: value})
    assert refusal.value.where == option


@pytest.mark.parametrize("method", ALL)
def test_every_option_says_its_unit_or_its_values(method: str) -> None:
    model = METHODS[method].options_model
    schema = model.model_json_schema()["properties"]
    for name, field in model.model_fields.items():
        numeric = schema[name].get("type") in ("number", "integer")
        unit = name.rpartition("_")[2]
        if numeric and unit in ("m", "s", "rad", "mps"):
            assert {"m": " m", "s": " s", "rad": " rad", "mps": "m/s"}[unit] in (field.description or "")


def subset(log: DriveLog) -> DriveLog:
    """An odometer and a yaw sensor, no Doppler velocity."""
    return replace(log, velocity=GnssVelocity.empty())


def gyroscope(log: DriveLog) -> DriveLog:
    return replace(log, attitude=Attitude.empty())


@pytest.mark.slow
@pytest.mark.parametrize("method", ALL)
@pytest.mark.parametrize("edit", [subset, gyroscope], ids=["no Doppler", "no attitude"])
def test_other_sensors_stand_in(
    method: str, edit: Callable[[DriveLog], DriveLog], make_log: MakeLog, town: Town
) -> None:
    log = make_log(3, duration_s=300)
    error, sigma = errors(edit(log), town, None, method)
    assert rms(error) < 1.5
    assert np.mean(np.abs(error) <= 1.96 * sigma) > 0.85


ROADS = {"00": "roads_00.osm", "09": "roads_09_10.osm", "10": "roads_09_10.osm"}


def true_slopes(path: Path) -> dict[tuple[int, int, int], float]:
    table = np.genfromtxt(path, delimiter=",", names=True)
    keys = zip(
        *(table[name].astype(int).tolist() for name in ("osm_way_id", "from_node", "to_node")), strict=True
    )
    return dict(zip(keys, table["slope_percent"].tolist(), strict=True))


def scored(log: DriveLog, roads: RoadTable, truth: dict[tuple[int, int, int], float], method: str) -> Errors:
    network, result = run_drive(log, roads, None, method=method)
    keys = identities(network.table)
    pairs = [
        (s.slope_percent - truth[keys[s.segment]], s.slope_sigma_percent)
        for s in result.slopes
        if keys[s.segment] in truth
    ]
    error, sigma = np.array(pairs).T
    return error, sigma


@pytest.mark.slow
@pytest.mark.parametrize("cut", [None, ["60:40"]], ids=["whole", "cut"])
@pytest.mark.parametrize("method", ALL)
def test_karlsruhe(
    method: str, cut: list[str] | None, karlsruhe: Path, receiver_log: Callable[..., Path], tmp_path: Path
) -> None:
    found = []
    for name, roads in ROADS.items():
        log = read_log(receiver_log(name, tmp_path / f"{name}.csv", cut=cut))
        truth = true_slopes(karlsruhe / f"truth_{name}.csv")
        found.append(scored(log, read_roads(karlsruhe / roads), truth, method))
    error, sigma = np.concatenate(found, axis=1)
    assert len(error) > 60
    assert rms(error) < 1.0
    assert np.mean(np.abs(error) <= 1.96 * sigma) > 0.88
