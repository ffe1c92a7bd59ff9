"""Laws that residuals are held against, and whether a sample follows one.

The laws are normal, Rayleigh, Laplace and mixtures of 2 to 10 normals; the tests are chi-square and Kolmogorov-Smirnov,
with quantile pairs, and which law wins window by window. Source: Viandier 2011, section 3.3.2 and annexes A and B.
Mixtures are fitted by the expectation-maximisation of the error models. Parameters are estimated from the sample that
is tested, so that Kolmogorov-Smirnov's critical values are on the lenient side, as in the thesis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.special import ndtr, ndtri

from fusion.errors import FusionError
from fusion.gnss.error_models.base import ErrorLaw
from fusion.messages import say
from fusion.published.positioning.gmm import FLOOR_M2, fit, start
from fusion.registry import unknown_name
from fusion.types import Floats

LEAST_SAMPLES = 20
"""Fewer say nothing about a law."""
MIXTURES = {f"{j} normals": j for j in range(2, 11)}
LAWS = ("normal", "rayleigh", "laplace", *MIXTURES)
"""What can be fitted, by name."""
LEVELS = (0.20, 0.10, 0.05, 0.01)
"""Levels of significance that critical values are given for."""
_KS_FACTORS = {0.20: 1.073, 0.10: 1.223, 0.05: 1.358, 0.01: 1.629}
"""Over the root of n, for more than 100 samples: annex A (0.20: the same series, Kolmogorov's law)."""
_KS_MANY = 100
LEAST_EXPECTED = 5.0
"""Bins in which a law expects fewer are joined with their neighbours (Cochran's rule)."""
_STEPS = 60
_LEAST_SIGMA_M = 1e-4
"""Residuals that are all alike still have a law."""


class TooFewSamplesError(FusionError):
    """A law was to be fitted to a handful of residuals."""


@dataclass(frozen=True)
class FittedLaw:
    """A law with its parameters estimated from a sample; ``parameters`` is how many were."""

    name: str
    parameters: int
    cdf: Callable[[Floats], Floats]
    quantile: Callable[[Floats], Floats]
    """Values (n,) below which a draw lies with probabilities (n,) strictly between 0 and 1."""


def fit_law(name: str, sample: Floats) -> FittedLaw:
    """Estimate a law of ``LAWS`` from a sample (n,), all finite.

    By moments, as the thesis does (its Laplace law of N(0, 1) draws has the rate 1.4 = sqrt 2 / sigma). A Rayleigh law
    knows no negative value. Raises ``UnknownNameError``, and ``TooFewSamplesError`` below 20 values.
    """
    if name not in LAWS:
        raise unknown_name("law", name, LAWS)
    if len(sample) < LEAST_SAMPLES:
        raise TooFewSamplesError(say("law.few", least=LEAST_SAMPLES, n=len(sample)))
    if name in MIXTURES:
        return _mixture(name, sample)
    return _CLOSED[name](float(np.mean(sample)), max(float(np.std(sample)), _LEAST_SIGMA_M))


def _normal(mean: float, sigma: float) -> FittedLaw:
    return FittedLaw(
        "normal",
        2,
        lambda x: np.asarray(ndtr((x - mean) / sigma)),
        lambda p: np.asarray(mean + sigma * ndtri(p)),
    )


def _laplace(mean: float, sigma: float) -> FittedLaw:
    scale = sigma / np.sqrt(2)

    def cdf(x: Floats) -> Floats:
        tail = 0.5 * np.exp(-np.abs(x - mean) / scale)
        return np.asarray(np.where(x < mean, tail, 1.0 - tail))

    def quantile(p: Floats) -> Floats:
        return np.asarray(mean - scale * np.sign(p - 0.5) * np.log1p(-2 * np.abs(p - 0.5)))

    return FittedLaw("laplace", 2, cdf, quantile)


def _rayleigh(mean: float, sigma: float) -> FittedLaw:
    square = mean**2 + sigma**2  # the mean square, which is twice the scale's
    return FittedLaw(
        "rayleigh",
        1,
        lambda x: -np.expm1(-(np.maximum(x, 0.0) ** 2) / square),
        lambda p: np.asarray(np.sqrt(-square * np.log1p(-p))),
    )


_CLOSED = {"normal": _normal, "laplace": _laplace, "rayleigh": _rayleigh}
"""Laws of a mean and a standard deviation. Written out: scipy's objects take longer to make than a window to test."""


def _mixture(name: str, sample: Floats) -> FittedLaw:
    components = MIXTURES[name]
    sample = np.ascontiguousarray(sample, np.float64)
    # The floor follows the sample's own scale, so that centimetres are fitted as well as tens of metres.
    floor = min(FLOOR_M2, 1e-3 * max(float(np.var(sample)), 1e-12))
    weight, mean, variance = start(sample, components, floor)
    fit(sample, weight, mean, variance, floor)
    law = ErrorLaw.of_normals(weight / weight.sum(), mean, variance)

    def quantile(probability: Floats) -> Floats:
        """By bisection between bounds outside of which nothing lies."""
        reach = 40.0 * float(np.sqrt(variance.max()))
        low = np.full(np.shape(probability), float(mean.min()) - reach)
        high = np.full(np.shape(probability), float(mean.max()) + reach)
        for _ in range(_STEPS):
            middle = 0.5 * (low + high)
            below = law.cdf(middle) < probability
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.asarray(0.5 * (low + high))

    return FittedLaw(name, 3 * components - 1, law.cdf, quantile)


@dataclass(frozen=True)
class LawTest:
    """How a law fits: the statistics, chi-square's degrees of freedom and p-value, and whether each test takes it.

    ``chi2``, ``chi2_p`` and ``chi2_taken`` are NaN, NaN and None where too few bins are left. ``ks_taken`` and
    ``chi2_taken`` are at the level 0.05.
    """

    law: str
    ks: float
    ks_critical: float
    ks_taken: bool
    chi2: float
    dof: int
    chi2_p: float
    chi2_taken: bool | None


def ks_statistic(sample: Floats, law: FittedLaw) -> float:
    """The greatest distance of the sample's distribution from the law's, (3.10)."""
    ordered = law.cdf(np.sort(sample))
    n = len(ordered)
    above = np.arange(1, n + 1) / n - ordered
    below = ordered - np.arange(n) / n
    return float(max(above.max(), below.max()))


def ks_critical(count: int, level: float) -> float:
    """The distance above which a law is refused: annex A's factors over 100 samples, Kolmogorov's exact law below."""
    if count > _KS_MANY:
        return float(_KS_FACTORS[level] / np.sqrt(count))
    return float(stats.kstwo.ppf(1 - level, count))


def chi_square(sample: Floats, law: FittedLaw, bins: int | None = None) -> tuple[float, int]:
    """Sum of (observed - expected)^2 / expected, and bins - (parameters + 1); NaN and 0 where that leaves none.

    ``bins`` of equal width cover the sample (default: 2 n^0.4, Moore 1986), the outer two reach to infinity.
    """
    n = len(sample)
    count = bins or max(int(np.ceil(2 * n**0.4)), 5)
    edges = np.linspace(sample.min(), sample.max(), count + 1)[1:-1]
    observed = np.diff(np.concatenate([[0], np.searchsorted(np.sort(sample), edges, side="right"), [n]]))
    expected = n * np.diff(np.concatenate([[0.0], law.cdf(edges), [1.0]]))
    observed, expected = _joined(observed, expected)
    dof = len(expected) - (law.parameters + 1)
    if dof < 1:
        return float("nan"), 0
    return float(np.sum((observed - expected) ** 2 / expected)), dof


def _joined(observed: Floats, expected: Floats) -> tuple[Floats, Floats]:
    """Bins joined from left to right until each expects enough; what is left over goes to the last."""
    groups, full = [], 0.0
    group = 0
    for value in expected:
        groups.append(group)
        full += float(value)
        if full >= LEAST_EXPECTED:
            group, full = group + 1, 0.0
    owner = np.minimum(groups, max(group - 1, 0))
    seen, wanted = (np.bincount(owner, weights=values).astype(float) for values in (observed, expected))
    return seen, wanted


def law_test(sample: Floats, name: str) -> LawTest:
    """Fit a law to a sample (n,) and test it. Raises ``TooFewSamplesError`` below 20 values."""
    law = fit_law(name, sample)
    distance, critical = ks_statistic(sample, law), ks_critical(len(sample), 0.05)
    statistic, dof = chi_square(sample, law)
    p = float(stats.chi2.sf(statistic, dof)) if dof else float("nan")
    return LawTest(
        law=name,
        ks=distance,
        ks_critical=critical,
        ks_taken=distance <= critical,
        chi2=statistic,
        dof=dof,
        chi2_p=p,
        chi2_taken=p >= 0.05 if dof else None,
    )


def law_tests(sample: Floats, names: tuple[str, ...] = LAWS) -> list[LawTest]:
    """All laws against one sample (n,), finite values only."""
    sample = np.asarray(sample, float)
    sample = sample[np.isfinite(sample)]
    return [law_test(sample, name) for name in names]


def quantile_pairs(sample: Floats, law: FittedLaw) -> tuple[Floats, Floats]:
    """The law's quantiles and the sample's (n,) each, in increasing order: a QQ plot's points."""
    n = len(sample)
    return law.quantile((np.arange(n) + 0.5) / n), np.sort(sample)


def window_distances(sample: Floats, window: int, names: tuple[str, ...], step: int = 1) -> Floats:
    """Kolmogorov-Smirnov's statistic of each law, fitted anew in each sliding window of the sample: (k, laws).

    Table 3.8 says in what share of the windows one law is nearer than another.
    """
    begins = range(0, len(sample) - window + 1, step)
    parts = [sample[k : k + window] for k in begins]
    statistics = [[ks_statistic(part, fit_law(name, part)) for name in names] for part in parts]
    return np.array(statistics, float).reshape(-1, len(names))
