"""The filter and smoother against one dense Gaussian over all states and measurements at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.filters import smoother
from fusion.filters.smoother import LinearModel, Smoothed
from smoothing import smoothed_with_covariances


@dataclass(frozen=True, eq=False)
class Matrices:
    """A ``LinearModel`` whose ``transition`` and ``noise`` are whole matrices, (n, d, d)."""

    transition: np.ndarray
    noise: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    step: np.ndarray
    design: np.ndarray
    value: np.ndarray
    variance: np.ndarray

    def model(self) -> LinearModel:
        return LinearModel(
            len(self.transition), entries_of(self.transition), lower_entries_of(self.noise), self.mean,
            self.covariance, self.step, self.design, self.value, self.variance,
        )  # fmt: skip

    def smooth(self) -> Smoothed:
        return self.model().smooth()


def entries_of(matrices: np.ndarray) -> dict[tuple[int, int], np.ndarray]:
    """Those that are not 0 in every step."""
    return {(int(a), int(b)): matrices[:, a, b] for a, b in np.argwhere(np.any(matrices != 0, axis=0))}


def lower_entries_of(matrices: np.ndarray) -> dict[tuple[int, int], np.ndarray]:
    return {(a, b): entry for (a, b), entry in entries_of(matrices).items() if a >= b}


def random_model(seed: int, steps: int, states: int, constants: int = 0, rows: int | None = None) -> Matrices:
    """A model with well-behaved random matrices; the first ``constants`` states never change."""
    rng = np.random.default_rng(seed)
    transition = np.eye(states) + 0.3 * rng.normal(size=(steps, states, states))
    root = rng.normal(size=(steps, states, states))
    transition[:, :constants] = np.eye(states)[:constants]
    root[:, :constants] = 0.0
    start = rng.normal(size=(states, states))
    measured = int(rng.integers(1, 3 * steps + 1)) if rows is None else rows
    return Matrices(
        transition=transition,
        noise=root @ root.transpose(0, 2, 1),
        mean=rng.normal(size=states),
        covariance=start @ start.T + 0.1 * np.eye(states),
        step=np.sort(rng.integers(0, steps, measured)),
        design=rng.normal(size=(measured, states)),
        value=3 * rng.normal(size=measured),
        variance=rng.uniform(0.1, 2.0, measured),
    )


class Dense:
    """The joint Gaussian of all states, stacked, and of the measurements, by its definition."""

    def __init__(self, model: Matrices) -> None:
        n, d = model.transition.shape[:2]
        self.shape = (n, d)
        sources = np.zeros((n * d, n * d))  # what each step's innovation adds to the states
        covariance = np.zeros((n * d, n * d))
        mean = np.zeros((n, d))
        for k in range(n):
            here = slice(k * d, (k + 1) * d)
            covariance[here, here] = model.noise[k] if k else model.covariance
            mean[k] = model.transition[k] @ mean[k - 1] if k else model.mean
            if k:
                sources[here] = model.transition[k] @ sources[(k - 1) * d : k * d]
            sources[here, here] = np.eye(d)
        self.mean, self.sources = mean.ravel(), sources
        self.covariance = sources @ covariance @ sources.T
        self.design = np.zeros((len(model.step), n * d))
        for i, k in enumerate(model.step):
            self.design[i, k * d : (k + 1) * d] = model.design[i]
        self.residual = model.value - self.design @ self.mean
        self.seen = self.design @ self.covariance @ self.design.T + np.diag(model.variance)

    def posterior(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (n, d) and covariance (n, d, d) of each step's states given all measurements."""
        n, d = self.shape
        gain = np.linalg.solve(self.seen, self.design @ self.covariance).T
        mean = (self.mean + gain @ self.residual).reshape(n, d)
        covariance = self.covariance - gain @ self.design @ self.covariance
        return mean, np.array([covariance[k * d : (k + 1) * d, k * d : (k + 1) * d] for k in range(n)])

    def left_out(self, i: int) -> tuple[float, float]:
        """Residual and its variance of measurement i against what the others say."""
        others = np.arange(len(self.residual)) != i
        across = self.seen[i, others]
        weights = np.linalg.solve(self.seen[np.ix_(others, others)], across)
        return float(self.residual[i] - weights @ self.residual[others]), float(
            self.seen[i, i] - weights @ across
        )

    def log_likelihood(self) -> float:
        """Without the constant m / 2 log 2 pi."""
        return float(
            -0.5
            * (np.linalg.slogdet(self.seen)[1] + self.residual @ np.linalg.solve(self.seen, self.residual))
        )

    def break_score(self, k: int, a: int) -> float:
        """How many sigmas a sudden change of state a on the way to step k is away from 0, were it allowed."""
        effect = self.design @ self.sources[:, k * self.shape[1] + a]
        weights = np.linalg.solve(self.seen, effect)
        return float(weights @ self.residual / np.sqrt(weights @ effect))


def check(model: Matrices) -> None:
    """Everything that ``smooth`` says, against the dense solution."""
    dense, (smoothed, found) = Dense(model), smoothed_with_covariances(model.model())
    mean, covariance = dense.posterior()
    assert smoothed.mean == pytest.approx(mean, rel=1e-7, abs=1e-7)
    assert found == pytest.approx(covariance, rel=1e-7, abs=1e-7)
    assert np.array_equal(found, found.transpose(0, 2, 1))
    assert np.array_equal(smoothed.variance, np.diagonal(found, axis1=1, axis2=2))
    expected = np.array([dense.left_out(i) for i in range(len(model.step))]).reshape(-1, 2).T
    assert smoothed.residual == pytest.approx(expected[0], rel=1e-6, abs=1e-7)
    assert smoothed.residual_variance == pytest.approx(expected[1], rel=1e-6)
    assert smoothed.log_likelihood == pytest.approx(dense.log_likelihood(), rel=1e-8, abs=1e-8)


@given(
    seed=st.integers(0, 2**31), steps=st.integers(1, 8), states=st.integers(1, 4), constants=st.integers(0, 2)
)
def test_everything_is_what_one_dense_gaussian_says(
    seed: int, steps: int, states: int, constants: int
) -> None:
    check(random_model(seed, steps, states, min(constants, states)))


def test_without_measurements_the_states_only_move() -> None:
    model = random_model(1, 5, 3, rows=0)
    check(model)
    assert model.smooth().log_likelihood == 0.0


def test_many_measurements_in_the_last_step_and_none_before() -> None:
    model = random_model(2, 6, 3, rows=7)
    check(replace(model, step=np.full(7, 5)))
    check(replace(model, step=np.zeros(7, np.int64)))


def constant(value: np.ndarray, start_variance: float, variance: float) -> Matrices:
    """An unknown constant, around 0 at first, that is measured once a step."""
    n = len(value)
    return Matrices(
        transition=np.ones((n, 1, 1)),
        noise=np.zeros((n, 1, 1)),
        mean=np.zeros(1),
        covariance=np.full((1, 1), start_variance),
        step=np.arange(n),
        design=np.ones((n, 1)),
        value=value,
        variance=np.full(n, variance),
    )


def test_a_constant_that_is_measured_again_and_again_is_averaged() -> None:
    """The textbook's case: no noise, an unknown constant, n measurements of it."""
    n, value = 40, np.random.default_rng(3).normal(7.0, 2.0, 40)
    smoothed = constant(value, 1e4, 4.0).smooth()
    precision = n / 4.0 + 1e-4
    assert smoothed.mean == pytest.approx(np.full((n, 1), value.sum() / 4.0 / precision))
    assert smoothed.variance == pytest.approx(np.full((n, 1), 1 / precision), rel=1e-5)
    # The residual against the mean of the others is n / (n - 1) times that against the mean of all.
    assert smoothed.residual == pytest.approx((value - value.mean()) * n / (n - 1), abs=0.01)


def test_a_vague_start_costs_no_digits() -> None:
    """A height known to a kilometre at first and then to a centimetre: the first variance is as good as the last."""
    smoothed = constant(np.full(40, 7.0), 1e6, 1e-4).smooth()
    assert smoothed.variance.ravel() == pytest.approx(np.full(40, 1 / (40 / 1e-4 + 1e-6)), rel=0.01)


def test_a_state_that_nobody_measures_keeps_what_was_known_of_it() -> None:
    model = random_model(4, 6, 3, constants=1, rows=9)
    blind = replace(model, design=model.design * [0.0, 1.0, 1.0])
    blind.transition[:, 1:, 0] = 0.0
    blind.covariance[0, 1:] = blind.covariance[1:, 0] = 0.0
    smoothed = blind.smooth()
    assert smoothed.mean[:, 0] == pytest.approx(np.full(6, blind.mean[0]))
    assert smoothed.variance[:, 0] == pytest.approx(np.full(6, blind.covariance[0, 0]))
    check(blind)


@given(seed=st.integers(0, 2**31), steps=st.integers(1, 6), states=st.integers(1, 3))
def test_the_break_score_is_the_size_of_a_sudden_change_in_sigmas(seed: int, steps: int, states: int) -> None:
    model = random_model(seed, steps, states)
    dense, smoothed = Dense(model), model.smooth()
    for k in range(int(model.step[-1]) + 1):  # later changes are seen by no measurement
        for a in range(states):
            assert smoothed.break_score(a)[k] == pytest.approx(dense.break_score(k, a), rel=1e-5, abs=1e-6)


def test_smoothing_leaves_the_model_as_it_was() -> None:
    model = random_model(5, 4, 2, rows=6)
    before = {name: np.copy(getattr(model, name)) for name in model.__dataclass_fields__}
    first, again = model.smooth(), model.smooth()
    assert np.array_equal(first.mean, again.mean)
    assert all(np.array_equal(getattr(model, name), value) for name, value in before.items())


def test_only_the_states_asked_for_are_kept() -> None:
    model = random_model(5, 4, 3, rows=6).model()
    whole, part = model.smooth(), model.smooth(states=(2,))
    assert np.array_equal(part.mean, whole.mean * [0, 0, 1])
    assert np.array_equal(part.variance, whole.variance * [0, 0, 1])
    assert np.array_equal(part.residual, whole.residual)


@given(seed=st.integers(0, 2**31), steps=st.integers(2, 6), states=st.integers(1, 4))
def test_the_level_scores_are_the_slopes_of_the_likelihood(seed: int, steps: int, states: int) -> None:
    """Of every measurement alone, by the log of its variance."""
    model = random_model(seed, steps, states)
    score = model.smooth().level_score(model.variance)
    assert score.shape == (len(model.step),)
    for i, found in enumerate(score.tolist()):
        up, down = (
            replace(model, variance=model.variance * np.where(np.arange(len(score)) == i, np.exp(h), 1.0))
            for h in (1e-4, -1e-4)
        )
        slope = (Dense(up).log_likelihood() - Dense(down).log_likelihood()) / 2e-4
        assert found == pytest.approx(slope, rel=1e-4, abs=1e-5)


@given(seed=st.integers(0, 2**31), steps=st.integers(2, 6), states=st.integers(1, 4))
def test_the_noise_score_is_the_slope_of_the_likelihood(seed: int, steps: int, states: int) -> None:
    """By a factor on any part of the steps' noise; that of the first step is not used."""
    model = random_model(seed, steps, states)
    root = np.random.default_rng(seed).normal(size=model.noise.shape)
    part = root @ root.transpose(0, 2, 1)
    part[0] *= 1e6
    found = model.smooth().noise_score(lower_entries_of(part))
    up, down = (Dense(replace(model, noise=model.noise + h * part)).log_likelihood() for h in (1e-5, -1e-5))
    assert found == pytest.approx((up - down) / 2e-5, rel=1e-3, abs=1e-4 * (1 + abs(found)))


@given(seed=st.integers(0, 2**31), steps=st.integers(1, 8), states=st.integers(1, 4))
def test_scores_alone_are_those_of_the_smoother(seed: int, steps: int, states: int) -> None:
    model = random_model(seed, steps, states)
    smoothed, scores = model.smooth(), model.model().scores()
    for name in ("residual", "residual_variance", "log_likelihood"):
        np.testing.assert_array_equal(getattr(scores, name), getattr(smoothed, name))
    np.testing.assert_equal(scores.pull, smoothed.pull)
    np.testing.assert_equal(scores.pull_precision, smoothed.pull_precision)


@given(seed=st.integers(0, 2**31), steps=st.integers(2, 6), states=st.integers(1, 5))
def test_the_carry_score_is_the_slope_of_the_likelihood(seed: int, steps: int, states: int) -> None:
    """By any part of the transitions' column that is followed; that of the first step is not used."""
    model = random_model(seed, steps, states)
    rng = np.random.default_rng(seed)
    column, part = int(rng.integers(states)), rng.normal(size=(steps, states))
    part[0] *= 1e6
    whole = np.zeros_like(model.transition)
    whole[:, :, column] = part
    found = model.model().scores(column).carry_score({(a, column): part[:, a] for a in range(states)})
    up, down = (
        Dense(replace(model, transition=model.transition + h * whole)).log_likelihood() for h in (1e-5, -1e-5)
    )
    assert found == pytest.approx((up - down) / 2e-5, rel=1e-3, abs=1e-4 * (1 + abs(found)))


def test_a_model_at_other_levels_is_the_model_with_these_levels() -> None:
    model = random_model(4, 7, 3, rows=9)
    noise, variance = 2 * model.noise, 0.5 * model.variance
    transition = model.transition.copy()
    transition[:, 0, 1] *= 0.9
    there = model.model().at_levels(lower_entries_of(noise), {(0, 1): transition[:, 0, 1]}, variance)
    expected = replace(model, noise=noise, variance=variance, transition=transition)
    np.testing.assert_array_equal(there.smooth().mean, expected.smooth().mean)
    assert there.scores().log_likelihood == expected.smooth().log_likelihood


@pytest.mark.parametrize("rows", [0, 40])
def test_a_long_model_in_pieces_is_the_same(rows: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit for bit, but for the sum of the pieces' likelihoods; a state that nobody sees included."""
    model = random_model(5, 23, 4, rows=rows)
    model.transition[:, 0, 1:] = model.transition[:, 1:, 0] = 0.0
    model.noise[:, 0, 1:] = model.noise[:, 1:, 0] = 0.0
    model.covariance[0, 1:] = model.covariance[1:, 0] = 0.0
    model.design[:, 0] = 0.0
    whole, covariance = smoothed_with_covariances(model.model())
    scores = model.model().scores(2)
    monkeypatch.setattr(smoother, "PIECE_STEPS", 5)
    pieces, again = smoothed_with_covariances(model.model())
    np.testing.assert_array_equal(again, covariance)
    for name in ("mean", "variance", "residual", "residual_variance"):
        np.testing.assert_array_equal(getattr(pieces, name), getattr(whole, name))
    assert pieces.log_likelihood == pytest.approx(whole.log_likelihood, rel=1e-12)
    there = model.model().scores(2)
    for name in ("pull", "pull_precision", "carry_pull"):
        here = getattr(scores, name)
        assert here.keys() == getattr(there, name).keys()
        for entry, column in getattr(there, name).items():
            np.testing.assert_array_equal(column[1:], here[entry][1:])
