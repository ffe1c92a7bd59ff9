"""The generic particle filter: Algorithms SIS and SIR against the exact posterior, for every scheme and trigger."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from fusion.filters import kalman
from fusion.filters.particle import Cloud, Estimate, ParticleFilter
from fusion.filters.resampling import RESAMPLERS
from fusion.filters.triggers import TRIGGERS

PARTICLES = 20_000
TRANSITION = np.array([[1.0, 1.0], [0.0, 0.9]])
PROCESS = np.array([[0.6, 0.2], [0.2, 0.4]])
DESIGN = np.array([[1.0, 0.0], [0.5, 1.0]])
NOISE = np.diag([10.0, 6.0])
START = np.array([3.0, -1.0]), np.array([[4.0, 1.0], [1.0, 1.0]])


def measurements(steps: int) -> np.ndarray:
    rng = np.random.default_rng(1)
    x, values = rng.multivariate_normal(*START), []
    for _ in range(steps):
        x = TRANSITION @ x + rng.multivariate_normal([0, 0], PROCESS)
        values.append(DESIGN @ x + rng.multivariate_normal([0, 0], NOISE))
    return np.array(values)


def exact(values: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    x, p = START
    for z in values:
        x, p = kalman.predict(x, p, TRANSITION, PROCESS)
        x, p = kalman.correct(x, p, z - DESIGN @ x, DESIGN, NOISE)
        yield x, p


def move(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return points @ TRANSITION.T + rng.multivariate_normal([0, 0], PROCESS, len(points))


def log_gaussian(away: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    return -0.5 * np.einsum("ki,ij,kj->k", away, np.linalg.inv(covariance), away)


def run(particle_filter: ParticleFilter, values: np.ndarray) -> list[Estimate]:
    """The textbook's choice: points move by the transition, and weigh what the measurements say of them."""
    cloud = Cloud.of(np.random.default_rng(2).multivariate_normal(*START, PARTICLES))
    estimates = []
    for step, z in enumerate(values):
        estimate = particle_filter.step(
            cloud, step, move, lambda points, z=z: log_gaussian(points @ DESIGN.T - z, NOISE)
        )
        cloud = estimate.cloud
        estimates.append(estimate)
    return estimates


def assert_near(
    estimates: list[Estimate], values: np.ndarray, mean_error: float, spread_error: float
) -> None:
    """Means within so many standard deviations, and standard deviations within that share."""
    for estimate, (mean, covariance) in zip(estimates, exact(values), strict=True):
        sigma = np.sqrt(np.diag(covariance))
        assert estimate.mean / sigma == pytest.approx(mean / sigma, abs=mean_error)
        assert np.sqrt(np.diag(estimate.covariance)) == pytest.approx(sigma, rel=spread_error)
        apart = (estimate.covariance - covariance)[0, 1] / sigma.prod()
        assert abs(apart) < 2 * spread_error


@pytest.mark.slow
@pytest.mark.parametrize("trigger", [name for name in TRIGGERS if name != "never"])
@pytest.mark.parametrize("resampling", list(RESAMPLERS))
def test_resampled_it_stays_at_the_exact_posterior(resampling: str, trigger: str) -> None:
    values = measurements(25)
    estimates = run(ParticleFilter(resampling, trigger), values)
    # A mean over N effective draws scatters by sigma / sqrt(N); N_eff is some thousands here.
    assert_near(estimates, values, 0.06, 0.05)
    assert any(e.resampled for e in estimates)
    assert not all(e.resampled for e in estimates)


def test_never_resampled_it_is_exact_too_but_wears_out() -> None:
    values = measurements(25)
    estimates = run(ParticleFilter(trigger="never"), values)
    assert_near(estimates[:3], values[:3], 0.06, 0.05)
    assert not any(e.resampled for e in estimates)
    assert estimates[-1].n_eff < 0.01 * estimates[0].n_eff
    assert estimates[-1].entropy > estimates[0].entropy


def test_points_from_another_importance_density_are_put_right_by_the_ratio() -> None:
    """Drawn by the transition and the measurement together, the optimal choice for a linear model."""
    values = measurements(15)
    gain = PROCESS @ DESIGN.T @ np.linalg.inv(DESIGN @ PROCESS @ DESIGN.T + NOISE)
    left = (np.eye(2) - gain @ DESIGN) @ PROCESS
    cloud, estimates, plain = (
        Cloud.of(np.random.default_rng(3).multivariate_normal(*START, PARTICLES)),
        [],
        [],
    )
    for step, z in enumerate(values):

        def aim(points: np.ndarray, z: np.ndarray = z) -> np.ndarray:
            return points @ TRANSITION.T + (z - points @ TRANSITION.T @ DESIGN.T) @ gain.T

        def draw(points: np.ndarray, rng: np.random.Generator, aim=aim) -> np.ndarray:  # type: ignore[no-untyped-def]
            return aim(points) + rng.multivariate_normal([0, 0], left, len(points))

        def ratio(points: np.ndarray, before: np.ndarray, aim=aim) -> np.ndarray:  # type: ignore[no-untyped-def]
            return log_gaussian(points - before @ TRANSITION.T, PROCESS) - log_gaussian(
                points - aim(before), left
            )

        def likelihood(points: np.ndarray, z: np.ndarray = z) -> np.ndarray:
            return log_gaussian(points @ DESIGN.T - z, NOISE)

        plain.append(ParticleFilter().step(cloud, step, draw, likelihood))
        estimates.append(ParticleFilter().step(cloud, step, draw, likelihood, ratio))
        cloud = estimates[-1].cloud
    assert_near(estimates, values, 0.06, 0.05)
    with pytest.raises(AssertionError):  # measurements counted twice
        assert_near(plain, values, 0.06, 0.05)


def test_the_seed_decides_everything() -> None:
    values = measurements(6)
    first, again, other = (run(ParticleFilter(seed=s), values)[-1] for s in (4, 4, 5))
    assert np.array_equal(first.cloud.points, again.cloud.points)
    assert not np.array_equal(first.cloud.points, other.cloud.points)


def test_the_estimate_is_made_before_resampling_and_the_cloud_after() -> None:
    points = np.arange(4.0)[:, None]
    estimate = ParticleFilter("systematic", threshold=1.0).step(
        Cloud.of(points), 0, lambda points, _: points, lambda points: np.log([0.1, 0.2, 0.3, 0.4])
    )
    assert estimate.mean == pytest.approx([2.0])
    assert estimate.covariance == pytest.approx(np.array([[1.0]]))
    assert estimate.n_eff == pytest.approx(1 / 0.3)
    assert estimate.resampled
    assert np.isin(estimate.cloud.points, points).all()
    assert estimate.cloud.weights == pytest.approx(np.full(4, 0.25))


def test_what_the_measurements_exclude_is_left_out_unless_it_is_everything() -> None:
    cloud, stay = Cloud.of(np.arange(10.0)[:, None]), ParticleFilter("residual", threshold=1.0)

    def only_below(limit: float) -> Estimate:
        return stay.step(
            cloud, 1, lambda points, _: points, lambda points: np.where(points[:, 0] < limit, 0.0, -np.inf)
        )

    assert only_below(2.0).cloud.points.ravel().tolist() == [0.0] * 5 + [1.0] * 5
    with pytest.raises(ValueError, match="finite log weight"):
        only_below(-1.0)
