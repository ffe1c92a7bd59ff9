"""The compiled Kalman filters against the textbook's functions, step by step over whole drives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fusion.pipeline import run_drive
from fusion.published.nine_state.run import DriveRun
from fusion.published.particle.method import KalmanRun, prepare
from fusion.published.particle.options import ParticleOptions
from fusion.roads.network import RoadNetwork
from fusion.simulate.scene.town import Town
from fusion.terrain.dem import Dem
from fusion.types import Attitude, DriveLog, GnssVelocity, no_progress
from reference_filters import ReferenceFilter

MakeLog = Callable[..., DriveLog]


def whole(log: DriveLog) -> DriveLog:
    return log


def wild_fixes(log: DriveLog) -> DriveLog:
    """One fix that is wrong, and later five in a row: the filter starts anew among them and again after them."""
    lat = log.fix.lat_deg.copy()
    lat[40] += 0.004
    lat[80:85] += 0.004
    return replace(log, fix=replace(log.fix, lat_deg=lat))


def paused(log: DriveLog) -> DriveLog:
    return replace(log, outages_s=log.fix.time_s[[60]] - 0.2)


def no_first_heights(log: DriveLog) -> DriveLog:
    alt, ell = log.fix.alt_msl_m.copy(), log.fix.height_ell_m.copy()
    alt[:30] = ell[:30] = np.nan
    return replace(log, fix=replace(log.fix, alt_msl_m=alt, height_ell_m=ell))


def no_first_heights_of_another_datum(log: DriveLog) -> DriveLog:
    """Ellipsoidal heights: the ground where the state begins must be raised to them."""
    fix = no_first_heights(log).fix
    unknown = np.full(len(fix), np.nan)
    return replace(log, fix=replace(fix, alt_msl_m=unknown, height_ell_m=fix.alt_msl_m + 48.0))


def positions_only(log: DriveLog) -> DriveLog:
    return DriveLog("gpx", log.fix)


def lonely_fix(log: DriveLog) -> DriveLog:
    """A position between two pauses, of which nobody knows the speed."""
    return DriveLog("gpx", log.fix, outages_s=log.fix.time_s[[60, 61]] - 0.2)


def no_attitude(log: DriveLog) -> DriveLog:
    return replace(log, attitude=Attitude.empty(), velocity=GnssVelocity.empty())


LOGS = [
    whole,
    wild_fixes,
    paused,
    no_first_heights,
    no_first_heights_of_another_datum,
    positions_only,
    lonely_fix,
    no_attitude,
]
CHOICES = [
    {},
    {"discretisation": "exact", "period_s": 1.0},
    {"variant": "ch2", "doppler": False},
    {"level_pitch": False, "dem_window": "full", "antenna_height_m": 3.0, "min_speed_mps": 4.0},
]


def both(log: DriveLog, town: Town, dem: Dem | None, options: ParticleOptions) -> tuple[KalmanRun, DriveRun]:
    """The compiled run and the same drive through the textbook's functions."""
    network = RoadNetwork.project(town.roads)
    run, _ = prepare(log, network, dem, options)
    assert isinstance(run, KalmanRun)
    engine = ReferenceFilter(options, linear=options.filter == "kf")
    slow = DriveRun(run.epochs, network, options, run.sensors, run.terrain, engine)
    run.run(no_progress)
    slow.run(no_progress)
    return run, slow


def assert_equal(run: KalmanRun, slow: DriveRun) -> None:
    one, other = run.track(), slow.track()
    assert run.report() == slow.report()
    assert np.array_equal(one.segment, other.segment)
    assert np.array_equal(one.after_outage, other.after_outage)
    # Metres and radians; a derivative by differences is good to about 1e-9.
    for name in (
        "alt_m",
        "h_sigma_m",
        "alt_sigma_m",
        "speed_mps",
        "pitch_rad",
        "pitch_sigma_rad",
        "distance_m",
    ):
        assert getattr(one, name) == pytest.approx(getattr(other, name), abs=1e-6, nan_ok=True), name
    for name in ("lat_deg", "lon_deg"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), abs=1e-11), name
    assert np.cos(one.heading_rad - other.heading_rad) == pytest.approx(1.0, abs=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("filter_name", ["ekf", "kf"])
@pytest.mark.parametrize("change", LOGS, ids=lambda f: f.__name__)
def test_the_compiled_run_is_the_textbook_filter(
    change: Callable[[DriveLog], DriveLog], filter_name: str, make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    log = change(make_log(4, duration_s=150, outages=[(100.0, 20.0)]))
    run, slow = both(log, town, town_dem, ParticleOptions(filter=filter_name))
    assert_equal(run, slow)
    assert run.rows.ground.any()
    if change is wild_fixes:
        assert run.rows.outlier.sum() >= 4
    if change in (wild_fixes, paused, lonely_fix):
        assert run.rows.start.sum() >= 2
    if change in (no_first_heights, no_first_heights_of_another_datum):
        assert not run.rows.outlier.any()


@pytest.mark.slow
@pytest.mark.parametrize("filter_name", ["ekf", "kf"])
@pytest.mark.parametrize("choice", CHOICES, ids=str)
@pytest.mark.parametrize("with_dem", [True, False])
def test_every_option_reaches_the_compiled_run(
    with_dem: bool, choice: dict[str, object], filter_name: str, make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    options = ParticleOptions(filter=filter_name, **choice)
    run, slow = both(make_log(4, duration_s=120), town, town_dem if with_dem else None, options)
    assert_equal(run, slow)


def test_an_outage_is_bridged_with_growing_sigma(make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    log = make_log(2, duration_s=300, outages=[(100.0, 40.0)])
    _, result = run_drive(log, town.roads, town_dem, method="particle", options={"filter": "ekf"})
    track = result.track
    gone = np.flatnonzero(~track.has_gnss)
    assert len(gone) >= 35
    assert np.ptp(track.time_s[gone]) < 41.0
    sigma = track.h_sigma_m
    assert sigma[gone[-1]] > 2 * sigma[gone[0]] > 0
    assert sigma[gone[-1] + 10] < sigma[gone[-1]] / 1.5
    assert track.alt_sigma_m[gone[-1]] > track.alt_sigma_m[gone[0]]


@pytest.mark.parametrize("filter_name", ["ekf", "kf"])
def test_slopes_lie_within_their_sigmas(
    filter_name: str, make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    inside: list[bool] = []
    truth = dict(zip(keys(town.roads), town.true_slope_percent, strict=True))
    for seed in (1, 2):
        log = make_log(seed, duration_s=300)
        network, result = run_drive(
            log, town.roads, town_dem, method="particle", options={"filter": filter_name}
        )
        own = keys(network.table)
        inside += [
            abs(s.slope_percent - truth[own[s.segment]]) <= 1.96 * s.slope_sigma_percent
            for s in result.slopes
        ]
        assert "particles" not in result.report
        assert "mean_n_eff" not in result.report
        assert ("mount_pitch_deg" in result.report) == (filter_name == "ekf")
    assert np.mean(inside) > 0.9


def keys(table: object) -> list[tuple[int, int, int]]:
    columns = (table.osm_way_id, table.from_node, table.to_node)  # type: ignore[attr-defined]
    return [tuple(row) for row in np.column_stack(columns).tolist()]
