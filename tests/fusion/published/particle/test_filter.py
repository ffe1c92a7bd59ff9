"""The compiled particle cloud against closed forms and against the same sums in double precision."""

from __future__ import annotations

import math

import numba
import numpy as np
import pytest

from fusion.published.nine_state import motion as k
from fusion.published.nine_state.protocol import Estimate, Measurement, PredictedMap
from fusion.published.particle import layout
from fusion.published.particle.filter import ParticleCloud
from fusion.published.particle.options import ParticleOptions
from weight_support import effective_number, entropy

NOTHING = Measurement(np.zeros(9), np.zeros(9))
MEAN = np.array([0.1, 9.0, 500.0, 0.2, -4.0, -300.0, 0.0, 0.3, 100.0])
SIGMA = np.array([0.1, 0.6, 3.0, 0.1, 0.5, 2.0, 0.1, 0.4, 1.0])


def particles(cloud: ParticleCloud) -> np.ndarray:
    """The states in the cloud, (9, n), before what was drawn again is copied."""
    rows = cloud._cloud.reshape(-1, layout.ROWS, layout.ROW)[:, : k.STATES, : layout.BLOCK]
    states = rows.transpose(1, 0, 2).reshape(k.STATES, -1)[:, : cloud.options.particles]
    return states.astype(float) + cloud._origin[:, None]


def kalman(options: ParticleOptions, mean: np.ndarray, var: np.ndarray, z: np.ndarray, inv_var: np.ndarray):  # type: ignore[no-untyped-def]
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
        proposal=proposal,  # type: ignore[arg-type]
        discretisation=discretisation,  # type: ignore[arg-type]
        resampling=resampling,
    )
    rng = np.random.default_rng(6)
    mean = np.array([0.0, 8.0, 4e5, 0.0, 2.0, 5e6, 0.0, 0.3, 100.0])
    sigma = np.full(9, 0.5)
    inv_var = np.array([0.5, np.inf, 2.0, 0.5, np.inf, 2.0, 0.5, 0.4, 2.5]) ** -2.0  # no horizontal velocity
    z = np.array([mean + np.array([0, 0, 8.0, 0, 0, 2.0, 0, 0, 0.3]) * e for e in range(6)])
    z += rng.normal(size=z.shape) * 0.5
    cloud = ParticleCloud(options)
    cloud.restart(mean, sigma)
    noise = 0.0
    for epoch, (x, p) in enumerate(kalman(options, mean, sigma**2, z, inv_var)):
        cloud.sense(1.0 if epoch else None, Measurement(z[epoch], inv_var))
        estimate = cloud.locate(None, False, None, 0.0)
        # What sampling adds at each epoch stays in the cloud: the standard errors of all epochs so far add up.
        noise += 1 / estimate.n_eff
        assert np.all(np.abs(estimate.state - x) < 6 * np.sqrt(noise * np.diag(p)))
        rel = 6 * math.sqrt(0.5 * noise)
        assert estimate.z_sigma_m == pytest.approx(math.sqrt(p[8, 8]), rel=rel)
        assert estimate.h_sigma_m == pytest.approx(math.sqrt(p[2, 2] + p[5, 5]), rel=rel)


def test_the_predicted_map_measurement_is_the_weighted_moments_of_the_cloud() -> None:
    """Zhat (2.26) and P (2.30) against a cloud whose distribution is known."""
    cloud = ParticleCloud(ParticleOptions(particles=400_000))
    mean = np.array([0, 10.0, 500.0, 0, -10.0, -300.0, 0, 0, 50.0])
    sigma = np.array([0.1, 0.5, 3.0, 0.1, 0.5, 2.0, 0.1, 0.2, 1.0])
    cloud.restart(mean, sigma)
    predicted = cloud.sense(None, NOTHING)
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


def corrected(count: int, heading_rad: float) -> tuple[ParticleCloud, PredictedMap, Estimate, np.ndarray]:
    """A cloud after all five corrections without motion, and its particles' weights as double precision has them."""
    options = ParticleOptions(particles=count, resampling_trigger="never", seed=3)
    mean = MEAN.copy()
    mean[[k.VX, k.VY]] = 8 * math.cos(heading_rad), 8 * math.sin(heading_rad)
    cloud = ParticleCloud(options)
    cloud.restart(mean, SIGMA)
    inv_var = np.array([4.0, 0, 0.2, 4.0, 0, 0.2, 4.0, 3.0, 0.1])
    pitch, inv_pitch, ground, inv_ground = 0.05, 0.02**-2, 97.0, 0.3
    road = (MEAN[k.X] + 2, MEAN[k.Y] - 1, heading_rad + 0.1)
    predicted = cloud.sense(None, Measurement(mean + 0.3, inv_var, pitch, inv_pitch))
    estimate = cloud.locate(road, True, ground, inv_ground)
    c = particles(cloud)
    tilt, turn = (
        np.arctan2(c[k.VZ], np.hypot(c[k.VX], c[k.VY])),
        np.arctan2(c[k.VY], c[k.VX]) - road[2],
    )
    logw = -0.5 * ((mean[:, None] + 0.3 - c) ** 2 * inv_var[:, None]).sum(axis=0)
    logw -= 0.5 * (pitch - tilt) ** 2 * inv_pitch
    logw -= 0.5 * ((c[k.X] - road[0]) ** 2 + (c[k.Y] - road[1]) ** 2) / options.map_sigma_m**2
    logw -= 0.5 * ((turn + np.pi) % (2 * np.pi) - np.pi) ** 2 / options.map_sigma_rad**2
    lift = options.antenna_height_m / np.cos(np.minimum(np.abs(tilt), k.STEEPEST_RAD))
    logw -= 0.5 * (ground - c[k.Z] + lift) ** 2 * inv_ground
    w = np.exp(logw - logw.max())
    return cloud, predicted, estimate, w / w.sum()


@pytest.mark.parametrize("count", [100, 2048, 30_001])
@pytest.mark.parametrize("heading_rad", [-0.4, 3.1])
def test_single_precision_gives_the_sums_of_double(count: int, heading_rad: float) -> None:
    """The same particles weighed and summed by the library in double: far closer than sampling errors are."""
    cloud, _, estimate, w = corrected(count, heading_rad)
    c = particles(cloud)
    assert estimate.state == pytest.approx(c @ w, abs=2e-5)
    spread = ((c - (c @ w)[:, None]) ** 2) @ w
    assert estimate.z_sigma_m == pytest.approx(math.sqrt(spread[k.Z]), rel=2e-5)
    assert estimate.h_sigma_m == pytest.approx(math.sqrt(spread[k.X] + spread[k.Y]), rel=2e-5)
    tilt, heading = np.arctan2(c[k.VZ], np.hypot(c[k.VX], c[k.VY])), np.arctan2(c[k.VY], c[k.VX])
    assert estimate.pitch_rad == pytest.approx(tilt @ w, abs=1e-6)
    assert estimate.pitch_sigma_rad == pytest.approx(math.sqrt((tilt - tilt @ w) ** 2 @ w), rel=1e-4)
    assert estimate.heading_rad == pytest.approx(
        math.atan2(np.sin(heading) @ w, np.cos(heading) @ w), abs=1e-6
    )
    assert estimate.n_eff == pytest.approx(effective_number(w), rel=2e-5)


def test_heading_and_covariance_of_the_prediction_do_not_jump_at_half_a_turn() -> None:
    _, predicted, _, _ = corrected(30_000, 3.1)
    assert abs(math.remainder(predicted.heading_rad - 3.1, 2 * math.pi)) < 0.1
    assert predicted.covariance[2, 2] < 0.1**2


@pytest.mark.parametrize("threshold, due", [(0.99, True), (1.01, False)])
def test_the_entropy_trigger_looks_at_the_entropy_of_the_weights(threshold: float, due: bool) -> None:
    _, _, _, w = corrected(5000, 0.3)
    disorder = entropy(w)
    options = ParticleOptions(
        particles=5000, seed=3, resampling_trigger="entropy", trigger_threshold=threshold * disorder
    )
    cloud = ParticleCloud(options)
    mean = MEAN.copy()
    mean[[k.VX, k.VY]] = 8 * math.cos(0.3), 8 * math.sin(0.3)
    cloud.restart(mean, SIGMA)
    inv_var = np.array([4.0, 0, 0.2, 4.0, 0, 0.2, 4.0, 3.0, 0.1])
    cloud.sense(None, Measurement(mean + 0.3, inv_var, 0.05, 0.02**-2))
    estimate = cloud.locate((MEAN[k.X] + 2, MEAN[k.Y] - 1, 0.4), True, 97.0, 0.3)
    assert estimate.resampled is due


def test_without_resampling_one_particle_takes_all_and_nothing_becomes_nan() -> None:
    """SIS: weights of all others fall to exactly 0, however long it goes on."""
    cloud = ParticleCloud(ParticleOptions(particles=3000, resampling_trigger="never"))
    cloud.restart(MEAN, SIGMA)
    inv_var = np.full(9, 25.0)
    state = MEAN.copy()
    for epoch in range(60):
        state[[k.X, k.Y, k.Z]] += state[[k.VX, k.VY, k.VZ]] * (epoch > 0)
        predicted = cloud.sense(1.0 if epoch else None, Measurement(state, inv_var, 0.03, 1e4))
        estimate = cloud.locate((state[k.X], state[k.Y], -0.4), True, 98.0, 1.0)
        assert np.isfinite([predicted.x_m, predicted.y_m, predicted.heading_rad]).all()
        assert np.isfinite(predicted.covariance).all()
        assert np.isfinite(estimate.state).all()
        assert not estimate.resampled
    assert estimate.n_eff == pytest.approx(1.0, abs=1e-3)
    assert estimate.h_sigma_m < 0.01
    # The optimal density goes on drawing the survivor towards what is measured.
    assert estimate.state == pytest.approx(state, abs=2.0)


def test_resampled_particles_are_copies_of_their_ancestors() -> None:
    cloud = ParticleCloud(ParticleOptions(particles=5000))
    cloud.restart(MEAN, SIGMA)
    cloud.sense(None, Measurement(MEAN, np.full(9, 4.0)))
    assert cloud.locate(None, False, None, 0.0).resampled
    before, ancestors = particles(cloud), cloud._ancestors.copy()
    assert len(set(ancestors)) < 4000
    cloud.sense(0.0, NOTHING)
    # The origin moves to the estimate, which costs at most the last bit of a position.
    assert particles(cloud) == pytest.approx(before[:, ancestors], abs=2e-6)
    estimate = cloud.locate(None, False, None, 0.0)
    assert estimate.n_eff == pytest.approx(5000)
    assert estimate.state == pytest.approx(before[:, ancestors].mean(axis=1), abs=2e-5)


def test_far_from_the_projections_origin_nothing_is_lost() -> None:
    """Positions of millions of metres, in single precision half a metre apart, count from a nearer origin."""
    ends = []
    for offset in (np.zeros(9), np.array([0, 0, 512_345.678, 0, 0, 5_512_345.678, 0, 0, 4321.123])):
        # Without resampling, in which rounding may tip the draw of an ancestor.
        cloud = ParticleCloud(
            ParticleOptions(particles=4000, seed=5, resampling_trigger="never", map_sigma_m=40)
        )
        cloud.restart(MEAN + offset, SIGMA)
        state = MEAN + offset
        for epoch in range(10):
            state[[k.X, k.Y, k.Z]] += state[[k.VX, k.VY, k.VZ]] * (epoch > 0)
            cloud.sense(1.0 if epoch else None, Measurement(state, np.full(9, 0.001)))
            road = (state[k.X], state[k.Y], -0.4)
            estimate = cloud.locate(road, False, state[k.Z] - 1.5, 0.001)
        assert estimate.n_eff > 30
        ends.append([*(estimate.state - offset), estimate.h_sigma_m, estimate.z_sigma_m])
    assert ends[0] == pytest.approx(ends[1], abs=1e-3)


@pytest.mark.parametrize("count", [999, 2048, 40_000])
def test_the_cloud_is_the_same_on_any_number_of_threads(count: int) -> None:
    before = numba.get_num_threads()
    ends = []
    try:
        for threads in (1, before):
            numba.set_num_threads(threads)
            cloud = ParticleCloud(ParticleOptions(particles=count, seed=2))
            cloud.restart(MEAN, SIGMA)
            for epoch in range(5):
                cloud.sense(1.0 if epoch else None, Measurement(MEAN, np.full(9, 1.0), 0.02, 1e3))
                estimate = cloud.locate((MEAN[k.X], MEAN[k.Y], -0.4), True, 98.0, 0.5)
            ends.append(estimate.state)
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(ends[0], ends[1])


def test_the_seed_decides_the_draws() -> None:
    def end(seed: int) -> np.ndarray:
        cloud = ParticleCloud(ParticleOptions(particles=500, seed=seed))
        cloud.restart(MEAN, SIGMA)
        cloud.sense(1.0, NOTHING)
        return cloud.locate(None, False, None, 0.0).state

    assert np.array_equal(end(1), end(1))
    assert not np.array_equal(end(1), end(2))
