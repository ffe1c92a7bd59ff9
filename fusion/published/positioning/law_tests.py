"""Whether a sample follows a law: chi-square, Kolmogorov-Smirnov, quantile pairs, and which law wins window by window.

Source: Viandier 2011, section 3.3.2 and annex A. Parameters are estimated from the sample that is tested, so that
Kolmogorov-Smirnov's critical values are on the lenient side, as in the thesis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from fusion.published.positioning.laws import LAWS, FittedLaw, fit_law
from fusion.types import Floats

LEVELS = (0.20, 0.10, 0.05, 0.01)
"""Levels of significance that critical values are given for."""
_KS_FACTORS = {0.20: 1.073, 0.10: 1.223, 0.05: 1.358, 0.01: 1.629}
"""Over the root of n, for more than 100 samples: annex A (0.20: the same series, Kolmogorov's law)."""
_KS_MANY = 100
LEAST_EXPECTED = 5.0
"""Bins in which a law expects fewer are joined with their neighbours (Cochran's rule)."""


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
