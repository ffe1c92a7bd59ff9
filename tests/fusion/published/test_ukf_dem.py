"""Method ``ukf-dem``: what it looks at and refuses, that it is worth its while, and its filter against others."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fusion.errors import BadOptionsError, MissingSensorError
from fusion.filters.unscented import Unscented
from fusion.methods.base import DriveResult
from fusion.pipeline import parse_options, run_drive
from fusion.published.nine_state.motion import VX, VY, VZ, X, Y, Z
from fusion.published.nine_state.protocol import EpochFilter, Estimate, Measurement, Road
from fusion.published.nine_state.run import DriveRun
from fusion.published.particle.filter import ParticleCloud
from fusion.published.particle.method import prepare
from fusion.published.particle.options import ParticleOptions
from fusion.published.ukf_dem import UnscentedFilter
from fusion.roads.network import RoadNetwork
from fusion.simulate.scene.town import Town
from fusion.terrain.dem import Dem
from fusion.terrain.windows import WINDOWS
from fusion.types import DriveLog, Floats, no_progress
from reference_filters import ReferenceFilter

MakeLog = Callable[..., DriveLog]
Errors = dict[tuple[int, int, int], tuple[float, float]]
NOTHING = Measurement(np.zeros(9), np.zeros(9))
SPREADS = [Unscented(1e-3), Unscented(1.0), Unscented(0.5, 0.0, 1.0)]


def run(log: DriveLog, town: Town, dem: Dem | None, **options: object) -> DriveResult:
    return run_drive(log, town.roads, dem, method="ukf-dem", options=options)[1]


def without_heights(log: DriveLog) -> DriveLog:
    unknown = np.full(len(log.fix), np.nan)
    return replace(log, fix=replace(log.fix, alt_msl_m=unknown, height_ell_m=unknown))


def test_without_a_dem_it_says_so(make_log: MakeLog, town: Town) -> None:
    with pytest.raises(MissingSensorError, match="Method 'ukf-dem' needs a DEM"):
        run(make_log(1, duration_s=240), town, None)


def test_only_positions_count(make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    """Without an outage the slopes are those of the bare positions, in every digit; with Doppler they are not."""
    log = make_log(1, duration_s=240)
    bare = DriveLog("gpx", log.fix)
    assert run(log, town, town_dem).slopes == run(bare, town, town_dem).slopes
    assert run(log, town, town_dem, doppler=True).slopes != run(bare, town, town_dem).slopes


def test_other_sensors_keep_time_through_an_outage(make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    log = make_log(2, duration_s=300, outages=[(100.0, 30.0)])
    track = run(log, town, town_dem).track
    gone = np.flatnonzero(~track.has_gnss)
    assert len(gone) >= 25
    assert track.h_sigma_m[gone[-1]] > 1.2 * track.h_sigma_m[gone[0]]  # the matched road holds it


def test_heights_may_come_from_the_terrain_alone(make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    log = make_log(1, duration_s=240)
    flat, full = run(without_heights(log), town, town_dem), run(log, town, town_dem)
    assert len(flat.slopes) > 5
    assert median_sigma(flat) > 1.5 * median_sigma(full)
    ground = town_dem.heights(flat.track.lon_deg, flat.track.lat_deg)
    assert np.nanstd(flat.track.alt_m - ground) < 5.0


def median_sigma(result: DriveResult) -> float:
    return float(np.median([s.slope_sigma_percent for s in result.slopes]))


@pytest.mark.parametrize("window", WINDOWS)
def test_every_window_is_taken(window: str, make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    result = run(make_log(1, duration_s=240), town, town_dem, dem_window=window)
    assert len(result.slopes) > 5
    assert result.report["options"]["dem_window"] == window
    assert 0.5 < result.report["dem_used_share"] <= 1.0


def test_the_spread_of_the_sigma_points_hardly_matters(make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    """Curvature is mild: parameters far apart give nearly the same slopes."""
    log = make_log(1, duration_s=240)
    close, wide = run(log, town, town_dem), run(log, town, town_dem, alpha=1.0, beta=0.0, kappa=-6.0)
    by_segment = {s.segment: s for s in wide.slopes}
    apart = [
        (s.slope_percent - by_segment[s.segment].slope_percent) / s.slope_sigma_percent
        for s in close.slopes
        if s.segment in by_segment
    ]
    assert len(apart) > 5
    assert close.slopes != wide.slopes
    assert np.sqrt(np.mean(np.square(apart))) < 0.3


@pytest.mark.parametrize("options", [{"alpha": 0.0}, {"kappa": -9.0}, {"beta": -1.0}, {"dem_window": "none"}])
def test_options_out_of_range_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(BadOptionsError, match=next(iter(options))):
        parse_options("ukf-dem", options)


@pytest.mark.slow
def test_it_beats_what_it_is_made_of(make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    """Pooled over drives of two receivers: better than the altitudes alone and than the terrain alone."""
    errors: dict[str, list[float]] = {"ukf-dem": [], "raw": [], "dem": []}
    inside: list[bool] = []
    truth = dict(zip(keys(town.roads), town.true_slope_percent, strict=True))
    for seed, receiver in ((1, "m8"), (2, "m8"), (3, "phone"), (4, "phone")):
        log = make_log(seed, duration_s=300, receiver=receiver)
        for method in errors:
            network, result = run_drive(log, town.roads, town_dem, method=method)
            own = keys(network.table)
            off = np.array([s.slope_percent - truth[own[s.segment]] for s in result.slopes])
            errors[method] += off.tolist()
            if method == "ukf-dem":
                sigma = np.array([s.slope_sigma_percent for s in result.slopes])
                inside += (np.abs(off) <= 1.96 * sigma).tolist()
    rms = {method: float(np.sqrt(np.mean(np.square(off)))) for method, off in errors.items()}
    assert rms["ukf-dem"] < 0.9 * min(rms["raw"], rms["dem"])
    assert 0.88 < np.mean(inside) <= 1.0


def keys(table: object) -> list[tuple[int, int, int]]:
    columns = (table.osm_way_id, table.from_node, table.to_node)  # type: ignore[attr-defined]
    return [tuple(row) for row in np.column_stack(columns).tolist()]


def after(
    engine: EpochFilter, mean: Floats, sigma: Floats, epochs: list[Measurement], road: Road
) -> Estimate:
    """The estimate after an epoch for each measurement, of which the last meets a road and the ground."""
    engine.restart(mean, sigma)
    for e, measured in enumerate(epochs[:-1]):
        engine.sense(0.8 if e else None, measured)
        engine.locate(None, False, None, 0.0)
    engine.sense(0.8, epochs[-1])
    return engine.locate(road, True, 100.5, 0.25)


@pytest.mark.parametrize("unscented", SPREADS, ids=str)
@pytest.mark.parametrize("discretisation", ["thesis", "exact"])
def test_the_linear_case_is_the_kalman_filter(discretisation: str, unscented: Unscented) -> None:
    options = ParticleOptions(discretisation=discretisation)
    rng = np.random.default_rng(6)
    mean = np.array([0.0, 8.0, 4e5, 0.0, 2.0, -3e5, 0.0, 0.3, 100.0])
    inv_var = np.array([0.5, np.inf, 2.0, 0.5, np.inf, 2.0, 0.5, 0.4, 2.5]) ** -2.0
    engine, exact = UnscentedFilter(options, unscented), ReferenceFilter(options, linear=True)
    for one in (engine, exact):
        one.restart(mean, np.full(9, 0.5))
    for epoch in range(20):
        z = mean + rng.normal(size=9) * 0.5
        dt = 0.7 if epoch else None
        predicted, other = (one.sense(dt, Measurement(z, inv_var)) for one in (engine, exact))
        assert (predicted.x_m, predicted.y_m) == pytest.approx((other.x_m, other.y_m), abs=1e-6)
        assert predicted.covariance[:2, :2] == pytest.approx(other.covariance[:2, :2], rel=1e-6)
        ours, theirs = (one.locate((4e5, -3e5, 0.2), False, None, 0.0) for one in (engine, exact))
        assert ours.state == pytest.approx(theirs.state, abs=1e-6)
        assert ours.z_sigma_m == pytest.approx(theirs.z_sigma_m, rel=1e-6)


def test_the_direction_of_a_road_is_compared_across_the_seam() -> None:
    """Heading 3.1 and a road at -3.1 rad are 0.08 rad apart, and the vehicle turns left to it."""
    mean = np.array([0, 10 * math.cos(3.1), 0, 0, 10 * math.sin(3.1), 0, 0, 0, 50.0])
    engine = UnscentedFilter(ParticleOptions(), Unscented())
    engine.restart(mean, np.full(9, 1.0))
    engine.sense(None, NOTHING)
    estimate = engine.locate((0.0, 0.0, -3.1), True, None, 0.0)
    assert abs(estimate.heading_rad) > 3.1
    assert estimate.state[VY] < mean[VY]
    assert estimate.state[VX] == pytest.approx(mean[VX], abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("unscented", SPREADS, ids=str)
def test_in_mild_curvature_all_filters_agree(unscented: Unscented) -> None:
    """At 12 m/s angles are nearly linear: the extended and the unscented filter lie within a cloud's sampling error."""
    options = ParticleOptions(particles=200_000, resampling="systematic")
    mean = np.array([0.1, 11.0, 0.0, -0.2, 5.0, 0.0, 0.0, 0.4, 100.0])
    sigma = np.array([0.1, 0.3, 2.0, 0.1, 0.3, 2.0, 0.1, 0.3, 2.0])
    inv_var = np.array([0.5, 0.3, 3.0, 0.5, 0.3, 3.0, 0.5, 0.4, 3.0]) ** -2.0
    epochs = [Measurement(mean + shift, inv_var, 0.04, 0.01**-2) for shift in (0.3, -0.2, 0.1)]
    road = (19.0, 9.5, 0.5)
    ours = after(UnscentedFilter(options, unscented), mean, sigma, epochs, road)
    extended = after(ReferenceFilter(options), mean, sigma, epochs, road)
    clouds = [
        after(ParticleCloud(options.model_copy(update={"seed": s})), mean, sigma, epochs, road)
        for s in range(12)
    ]
    states = np.array([c.state for c in clouds])
    # The spread of the clouds says what their mean is worth; curvature may add a thousandth of a sigma.
    error = 4 * states.std(axis=0, ddof=1) / math.sqrt(len(clouds)) + 0.004 * sigma
    pitch = np.array([c.pitch_rad for c in clouds])
    for estimate in (ours, extended):
        assert np.all(np.abs(estimate.state - states.mean(axis=0)) < error)
        assert abs(estimate.pitch_rad - pitch.mean()) < 4 * pitch.std(ddof=1) / math.sqrt(len(clouds))
        assert estimate.heading_rad == pytest.approx(np.mean([c.heading_rad for c in clouds]), abs=1e-3)
        assert estimate.pitch_sigma_rad == pytest.approx(
            np.mean([c.pitch_sigma_rad for c in clouds]), rel=0.02
        )
        assert estimate.h_sigma_m == pytest.approx(np.mean([c.h_sigma_m for c in clouds]), rel=0.02)
        assert estimate.z_sigma_m == pytest.approx(np.mean([c.z_sigma_m for c in clouds]), rel=0.02)
    assert ours.state == pytest.approx(extended.state, abs=2e-3)


def test_over_a_drive_the_unscented_filter_is_the_extended_one(
    make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    """With all sensors, while the vehicle moves: heights to 1 cm, places to 5 cm, pitch to 0.2 mrad."""
    options = ParticleOptions(filter="ekf")
    network = RoadNetwork.project(town.roads)
    run, _ = prepare(make_log(1, duration_s=200), network, town_dem, options)
    engine = UnscentedFilter(options, Unscented())
    other = DriveRun(run.epochs, network, options, run.sensors, run.terrain, engine)
    for one in (run, other):
        one.run(no_progress)
    moving = np.hypot(run.rows.state[:, VX], run.rows.state[:, VY]) > 2.0
    assert moving.sum() > 100
    difference = np.abs(run.rows.state - other.rows.state)[moving]
    assert difference[:, [X, Y]].max() < 0.05
    assert difference[:, Z].max() < 0.01
    assert difference[:, VZ].max() < 0.005
    assert np.abs(run.rows.pitch_rad - other.rows.pitch_rad)[moving].max() < 2e-4
    assert np.mean(run.rows.segment == other.rows.segment) > 0.99


@pytest.mark.slow
def test_over_a_drive_the_extended_filter_is_the_mean_of_clouds(
    make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    """Slopes of the mean of clouds come nearer to the extended filter's than those of one cloud to another's."""
    log = make_log(1, duration_s=120)
    network = RoadNetwork.project(town.roads)
    alone, _ = prepare(log, network, town_dem, ParticleOptions(filter="ekf"))
    alone.run(no_progress)
    heights = []
    for seed in range(4):
        run, _ = prepare(log, network, town_dem, ParticleOptions(particles=200_000, seed=seed))
        run.run(no_progress)
        heights.append(run.rows.state[:, Z])
    moving = np.hypot(alone.rows.state[:, VX], alone.rows.state[:, VY]) > 2.0
    scatter = np.std(heights, axis=0, ddof=1)[moving]
    off = (np.mean(heights, axis=0) - alone.rows.state[:, Z])[moving]
    assert np.sqrt(np.mean(off**2)) < 1.5 * np.sqrt(np.mean(scatter**2)) / math.sqrt(len(heights)) + 0.005
