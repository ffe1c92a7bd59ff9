"""A mixture of endlessly many normals, drawn from a Polya urn (Viandier 2011, 3.3.4.2 to 3.3.5).

Each particle keeps what it drew for a satellite: pairs of mean and variance. The next pair is one of these again, each
equally likely, or with weight alpha a new one of the base measure, which the reception state chooses. ``Urns`` serves
the error model here and the filter in ``fusion.published.positioning.rbpf_dpm``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fusion.compiled import compiled
from fusion.filters.resampling import normalised, systematic
from fusion.gnss.error_models.base import ErrorLaw, Series
from fusion.gnss.reception import LOS
from fusion.types import Bools, Floats, Ints


class BaseMeasure(NamedTuple):
    """G0 and alpha of (3.23), (3.24): variance = ``scale_m2`` / chi-square(``dof``), mean ~ N(m0, variance / ``k``).

    m0 is the residual at hand where ``follows``, else 0.
    """

    alpha: float
    k: float
    dof: float
    scale_m2: float
    follows: bool


LOS_SIMULATED = BaseMeasure(500.0, 2.0, 3.0, 1.0, False)
"""Table 3.9."""
NLOS_BASE = BaseMeasure(3000.0, 1.0, 5.0, 10.0, True)
"""Table 3.9, for simulated and for real data."""
LOS_REAL = BaseMeasure(500.0, 0.1, 10.0, 1.0, False)
"""Table 3.11, but about 0. The print centres it on the residual: each satellite then explains its own
innovation, and the filter runs free."""

_VARIANCES_M2 = (1e-4, 1e4)  # an inverse chi-square of three degrees of freedom has no variance of its own


class Urns(NamedTuple):
    """What particles drew for satellites, in a ring of the last rows (epochs): ``mean_m``, ``variance_m2`` (k, s, n).

    ``line`` (k, n) names for each particle the place that its ancestor had in a row, so that resampling copies one
    table of numbers and no draws. ``queue`` (s, k), ``head`` and ``seen`` (s,): the rows that have a satellite, oldest
    first, where they begin and how many they are.
    """

    mean_m: Floats
    variance_m2: Floats
    line: Ints
    queue: Ints
    head: Ints
    seen: Ints

    @classmethod
    def empty(cls, rows: int, satellites: int, particles: int) -> Urns:
        """Before the first draw; ``rows`` epochs are remembered."""
        return cls(
            mean_m=np.zeros((rows, satellites, particles)),
            variance_m2=np.zeros((rows, satellites, particles)),
            line=np.zeros((rows, particles), np.int64),
            queue=np.zeros((satellites, rows), np.int64),
            head=np.zeros(satellites, np.int64),
            seen=np.zeros(satellites, np.int64),
        )

    def resample(self, ancestors: Ints) -> None:
        """Let each particle go on with the draws of its ancestor, (n,)."""
        self.line[:] = self.line[:, ancestors]


@compiled
def open_row(urns: Urns, row: int) -> None:
    """Forget what a row held, and begin it anew."""
    rows = urns.queue.shape[1]
    for s in range(len(urns.seen)):
        if urns.seen[s] and urns.queue[s, urns.head[s]] == row:
            urns.head[s] = (urns.head[s] + 1) % rows
            urns.seen[s] -= 1
    urns.line[row] = np.arange(urns.line.shape[1])


@compiled
def draw_pairs(
    urns: Urns, row: int, satellite: int, base: BaseMeasure, centre_m: Floats, rng: np.random.Generator
) -> None:
    """Draw each particle's pair for a satellite by (3.19) into a row that ``open_row`` began.

    ``centre_m`` (n,) are the residuals that a base measure follows.
    """
    count, rows = urns.seen[satellite], urns.queue.shape[1]
    for i in range(urns.line.shape[1]):
        ball = int(rng.random() * (base.alpha + count))
        if ball < count:
            past = urns.queue[satellite, (urns.head[satellite] + ball) % rows]
            of = urns.line[past, i]
            mean, variance = urns.mean_m[past, satellite, of], urns.variance_m2[past, satellite, of]
        else:
            variance = base.scale_m2 / max(rng.chisquare(base.dof), 1e-12)
            variance = min(max(variance, _VARIANCES_M2[0]), _VARIANCES_M2[1])
            mean = math.sqrt(variance / base.k) * rng.standard_normal()
            if base.follows:
                mean += centre_m[i]
        urns.mean_m[row, satellite, i] = mean
        urns.variance_m2[row, satellite, i] = variance
    urns.queue[satellite, (urns.head[satellite] + count) % rows] = row
    urns.seen[satellite] += 1


@compiled
def draw_all(
    urns: Urns,
    row: int,
    satellites: Ints,
    direct: Bools,
    los: BaseMeasure,
    nlos: BaseMeasure,
    centre_m: Floats,
    rng: np.random.Generator,
) -> tuple[Floats, Floats]:
    """Means and variances (n, r) that each particle draws for the satellites (r,) of an epoch.

    ``direct`` (r,) says which are in line of sight; ``centre_m`` (n, r) are the residuals.
    """
    shape = (urns.line.shape[1], len(satellites))
    mean, variance = np.full(shape, np.nan), np.full(shape, np.nan)
    for j in range(len(satellites)):
        if not np.isfinite(centre_m[0, j]):
            continue
        # Two calls: the base measures are chosen by branches that numba can tell apart.
        if direct[j]:
            draw_pairs(urns, row, satellites[j], los, centre_m[:, j], rng)
        else:
            draw_pairs(urns, row, satellites[j], nlos, centre_m[:, j], rng)
        mean[:, j] = urns.mean_m[row, satellites[j]]
        variance[:, j] = urns.variance_m2[row, satellites[j]]
    return mean, variance


@dataclass(frozen=True)
class DpmModel:
    """``particles`` as for Table 3.10; resampled where fewer than ``eta`` x particles count; ``memory`` in epochs.

    The thesis remembers all of its 594 epochs.
    """

    los: BaseMeasure = LOS_SIMULATED
    nlos: BaseMeasure = NLOS_BASE
    particles: int = 50
    eta: float = 0.7
    memory: int = 600
    name = "dpm"
    source = "Viandier 2011, 3.3.4.2, 3.3.5, (3.19), (3.23), (3.24)"
    description = "Normals drawn from a Polya urn, whose base measure the reception state chooses."

    def law(self, series: Series, seed: int) -> ErrorLaw:
        """The mixture of the epochs' normals, all equally likely."""
        mean, variance = self.track(series, seed)
        return ErrorLaw.of_normals(np.full(len(series), 1.0 / len(series)), mean, variance)

    def track(self, series: Series, seed: int) -> tuple[Floats, Floats]:
        """Moments of the particles' mixture, weighed by how well each explains the residuals."""
        rng = np.random.default_rng(seed)
        n = self.particles
        urns = Urns.empty(min(self.memory, len(series)), 1, n)
        log_weights = np.zeros(n)
        mean, variance = np.empty(len(series)), np.empty(len(series))
        for t, (error_m, state) in enumerate(zip(series.error_m, series.state, strict=True)):
            row = t % len(urns.line)
            open_row(urns, row)
            draw_pairs(urns, row, 0, self.los if state == LOS else self.nlos, np.full(n, error_m), rng)
            means, spread = urns.mean_m[row, 0], urns.variance_m2[row, 0]
            log_weights -= 0.5 * ((error_m - means) ** 2 / spread + np.log(spread))
            weights = normalised(log_weights)
            mean[t] = weights @ means
            variance[t] = weights @ (spread + (means - mean[t]) ** 2)
            if 1.0 / (weights @ weights) < self.eta * n:
                urns.resample(systematic(weights, seed, t))
                log_weights[:] = 0.0
        return mean, variance
