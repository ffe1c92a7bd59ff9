"""The particle filter against closed forms, and its promises."""

from __future__ import annotations

import math
from collections.abc import Callable

import numba
import numpy as np
import pytest

from fusion.errors import BadOptionsError
from fusion.methods import kinematics as k
from fusion.methods.epoch_filter import Measurement
from fusion.methods.particle_filter import ParticleCloud
from fusion.methods.particle_options import ParticleOptions
from fusion.pipeline import parse_options, run_drive
from fusion.simulate import Town
from fusion.terrain.dem import Dem
from fusion.types import DriveLog

MakeLog = Callable[..., DriveLog]


def kalman(options: ParticleOptions, mean: np.ndarray, var: np.ndarray, z: np.ndarray, inv_var: np.ndarray):
    """The exact posterior of the linear part, by a textbook Kalman filter; yields (mean, covariance) per epoch."""
    o = options
    horizontal = np.array([o.sigma_acc_mps2, o.sigma_vel_mps, o.sigma_pos_m]) ** 2
    vertical = np.array([o.sigma_acc_up_mps2, o.sigma_vel_up_mps, o.sigma_pos_up_m]) ** 2
    q = np.diag(np.concatenate([horizontal, horizontal, vertical]))
    half = 0.5 if o.discretisation == "exact" else 0.0
    f = np.kron(np.eye(3), np.array([[1, 0, 0], [1, 1, 0], [half, 1, 1]]))
    x, p = mean.copy(), np.diag(var)
    seen = inv_var > 0
    h, r = np.eye(9)[seen], np.diag(1 / inv_var[seen])
    for epoch in range(len(z)):
        if epoch:
            x, p = f @ x, f @ p @ f.T + q
        gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + r)
        x, p = x + gain @ (z[epoch][seen] - h @ x), (np.eye(9) - gain @ h) @ p
        yield x, p


@pytest.mark.parametrize("proposal", ["optimal", "transition"])
@pytest.mark.parametrize("discretisation", ["thesis", "exact"])
@pytest.mark.parametrize("resampling", ["multinomial", "systematic"])
def test_the_linear_case_is_the_kalman_filter(proposal: str, discretisation: str, resampling: str) -> None:
    """With linear sensors only, the cloud's mean and spread must be the exact posterior's, to sampling error."""
    options = ParticleOptions(
        particles=200_000,
        proposal=proposal,
        discretisation=discretisation,
        resampling=resampling,  # type: ignore[arg-type]
    )
    rng = np.random.default_rng(6)
    mean = np.array([0.0, 8.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.3, 100.0])
    sigma = np.full(9, 0.5)
    inv_var = np.array([0.5, np.inf, 2.0, 0.5, np.inf, 2.0, 0.5, 0.4, 2.5]) ** -2.0  # no horizontal velocity
    z = np.array([mean + np.array([0, 0, 8.0, 0, 0, 2.0, 0, 0, 0.3]) * e for e in range(6)])
    z += rng.normal(size=z.shape) * 0.5
    cloud = ParticleCloud(options)
    cloud.restart(mean, sigma)
    noise = np.zeros(9)
    for epoch, (x, p) in enumerate(kalman(options, mean, sigma**2, z, inv_var)):
        cloud.sense(1.0 if epoch else None, Measurement(z[epoch], inv_var))
        estimate = cloud.locate(None, False, None, 0.0)
        # What sampling adds at each epoch stays in the cloud: the standard errors of all epochs so far add up.
        noise += np.diag(p) / estimate.n_eff
        assert np.all(np.abs(estimate.state - x) < 6 * np.sqrt(noise))
        assert estimate.z_sigma_m == pytest.approx(math.sqrt(p[8, 8]), rel=0.05)
        assert estimate.h_sigma_m == pytest.approx(math.sqrt(p[2, 2] + p[5, 5]), rel=0.05)


def test_the_predicted_map_measurement_is_the_weighted_moments_of_the_cloud() -> None:
    """Zhat (2.26) and P (2.30) against a cloud whose distribution is known."""
    cloud = ParticleCloud(ParticleOptions(particles=400_000))
    mean = np.array([0, 10.0, 500.0, 0, -10.0, -300.0, 0, 0, 50.0])
    sigma = np.array([0.1, 0.5, 3.0, 0.1, 0.5, 2.0, 0.1, 0.2, 1.0])
    cloud.restart(mean, sigma)
    predicted = cloud.sense(None, Measurement(np.zeros(9), np.zeros(9)))
    assert predicted.x_m == pytest.approx(500, abs=0.05)
    assert predicted.y_m == pytest.approx(-300, abs=0.05)
    assert predicted.heading_rad == pytest.approx(-math.pi / 4, abs=0.002)
    assert np.diag(predicted.covariance)[:2] == pytest.approx([9, 4], rel=0.02)
    # Isotropic velocity noise turns the heading by sigma / speed.
    assert predicted.covariance[2, 2] == pytest.approx((0.5 / math.hypot(10, 10)) ** 2, rel=0.03)


def test_pitch_map_and_terrain_pull_towards_themselves() -> None:
    options = ParticleOptions(particles=100_000)
    mean = np.array([0, 10.0, 0.0, 0, 0.0, 0.0, 0, 0.0, 100.0])
    sigma = np.array([0.1, 0.3, 2.0, 0.1, 0.3, 2.0, 0.1, 1.0, 3.0])
    cloud = ParticleCloud(options)
    cloud.restart(mean, sigma)
    cloud.sense(None, Measurement(np.zeros(9), np.zeros(9), 0.06, 0.01**-2))
    estimate = cloud.locate((0.0, 3.0, 0.1), True, 96.0, 1.0)
    assert estimate.pitch_rad == pytest.approx(0.06 * 100 / 101, abs=0.002)  # prior sd 0.1 rad against 0.01
    assert 0.3 < estimate.state[k.Y] < 1.5  # pulled by 3 m with weights 1/4 and 1/16
    assert estimate.state[k.Y] == pytest.approx(3.0 * 4 / (4 + options.map_sigma_m**2), abs=0.1)
    ground = 96.0 + options.antenna_height_m
    assert estimate.state[k.Z] == pytest.approx(100 + (ground - 100) * 9 / 10, abs=0.1)


@pytest.mark.slow
def test_the_result_does_not_depend_on_the_number_of_threads(
    make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    log = make_log(1, duration_s=60)
    before = numba.get_num_threads()
    results = []
    try:
        for threads in {1, before}:
            numba.set_num_threads(threads)
            results.append(
                run_drive(log, town.roads, town_dem, method="particle", options={"particles": 40_000})[1]
            )
    finally:
        numba.set_num_threads(before)
    first, last = results[0], results[-1]
    assert first.slopes == last.slopes
    assert np.array_equal(first.track.alt_m, last.track.alt_m)


@pytest.mark.slow
def test_another_seed_changes_the_result_within_its_sigma(
    make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    log = make_log(1, duration_s=240)
    one, two = (
        run_drive(log, town.roads, town_dem, method="particle", options={"particles": 20_000, "seed": seed})[
            1
        ].slopes
        for seed in (1, 2)
    )
    assert one != two
    by_segment = {s.segment: s for s in two}
    apart = [
        (s.slope_percent - by_segment[s.segment].slope_percent) / s.slope_sigma_percent
        for s in one
        if s.segment in by_segment
    ]
    assert np.sqrt(np.mean(np.square(apart))) < 0.7


def test_a_mount_that_is_askew_is_levelled_and_reported(make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    log = make_log(3, duration_s=300)
    options = {"particles": 5000}
    _, plain = run_drive(log, town.roads, town_dem, method="particle", options=options)
    _, off = run_drive(
        log, town.roads, town_dem, method="particle", options={**options, "level_pitch": False}
    )
    assert plain.report["mount_pitch_sigma_deg"] < 0.5
    assert off.report["mount_pitch_deg"] is None
    assert plain.slopes != off.slopes


@pytest.mark.slow
def test_slopes_of_the_simulated_town_beat_both_baselines(
    make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    """Pooled over drives of two receiver classes; the margin is wide, the benchmark holds the figures."""
    errors: dict[str, list[float]] = {"particle": [], "raw": [], "dem": []}
    inside: list[bool] = []
    for seed, receiver in ((1, "m8"), (2, "m8"), (3, "phone")):
        log = make_log(seed, duration_s=300, receiver=receiver)
        for method, found in errors.items():
            options = {"particles": 10_000} if method == "particle" else None
            network, result = run_drive(log, town.roads, town_dem, method=method, options=options)
            truth = dict(zip(map(tuple, _keys(town.roads)), town.true_slope_percent, strict=True))
            keys = _keys(network.table)
            if method == "particle":
                inside += [
                    abs(s.slope_percent - truth[tuple(keys[s.segment])]) <= 1.96 * s.slope_sigma_percent
                    for s in result.slopes
                ]
            found += [s.slope_percent - truth[tuple(keys[s.segment])] for s in result.slopes]
    assert np.mean(inside) > 0.85
    rms = {method: float(np.sqrt(np.mean(np.square(e)))) for method, e in errors.items()}
    assert rms["particle"] < rms["raw"]
    assert rms["particle"] < rms["dem"]


def _keys(table: object) -> list[list[int]]:
    columns = (table.osm_way_id, table.from_node, table.to_node)  # type: ignore[attr-defined]
    return np.column_stack(columns).tolist()


@pytest.mark.parametrize(
    "options", [{"particles": 10}, {"particles": "many"}, {"trigger_threshold": 0}, {"discretisation": "euler"}]
)
def test_options_out_of_range_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(BadOptionsError, match=next(iter(options))):
        parse_options("particle", options)
