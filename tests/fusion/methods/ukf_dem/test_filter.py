"""The unscented filter over the nine states against closed forms, the extended filter and a great cloud."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from reference_filters import ReferenceFilter

from fusion.filters.unscented import Unscented
from fusion.methods.nine_state.motion import VX, VY, VZ, X, Y, Z
from fusion.methods.nine_state.protocol import EpochFilter, Estimate, Measurement, Road
from fusion.methods.nine_state.run import DriveRun
from fusion.methods.particle.filter import ParticleCloud
from fusion.methods.particle.method import prepare
from fusion.methods.particle.options import ParticleOptions
from fusion.methods.ukf_dem import UnscentedFilter
from fusion.roads.network import RoadNetwork
from fusion.simulate.scene.town import Town
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, Floats, no_progress

MakeLog = Callable[..., DriveLog]
NOTHING = Measurement(np.zeros(9), np.zeros(9))
SPREADS = [Unscented(1e-3), Unscented(1.0), Unscented(0.5, 0.0, 1.0)]


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
    other = DriveRun(run.epochs, network, engine, options, run.sensors, run.terrain)
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
