"""The one-sided law of pseudorange errors: a reflected path is only ever longer (notes 6).

An error is (1 - p) N(0, s2) + p [N(0, s2) * Exp(mean)]: noise, and with probability p a delay besides. Its mode and
the weights of iterated least squares about it, for a receiver that sees p and s2 by C/N0. All but ``Law`` is compiled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fusion.compiled import compiled
from fusion.types import Floats

_STEP_DB = 3.0  # how fast p falls with C/N0
UNKNOWN_CN0_DBHZ = 35.0
"""What a signal is taken to have that comes without C/N0: neither clearly direct nor clearly reflected."""
_ROOT_2PI = math.sqrt(2 * math.pi)
_BISECTIONS = 30
_FAR = 25.0
"""Sigmas up to which the tail of the normal law is taken from erfc, which is 0 from 38 on."""


class Errors(NamedTuple):
    """The law for each row, (n,): share of reflected, variance of noise (m2), mean delay (m), mode (m)."""

    share: Floats
    variance_m2: Floats
    delay_m: Floats
    mode_m: Floats


@dataclass(frozen=True)
class Law:
    """How p and s2 follow from C/N0; the numbers are those of notes 6, fixed beforehand."""

    midpoint_dbhz: float = 40.0
    """Half of the signals with this C/N0 are reflected."""
    delay_m: float = 30.0
    noise: float = 1.0
    """What s is multiplied by."""

    def share(self, cn0_dbhz: Floats) -> Floats:
        """Probability of being reflected, (n,); unknown C/N0 counts as ``UNKNOWN_CN0_DBHZ``."""
        cn0 = np.where(np.isfinite(cn0_dbhz), cn0_dbhz, UNKNOWN_CN0_DBHZ)
        return np.asarray(1 / (1 + np.exp((cn0 - self.midpoint_dbhz) / _STEP_DB)))

    def variance(self, cn0_dbhz: Floats) -> Floats:
        """Variance of the noise, m2 (n,). It grows with what the receiver's best signals have more, as p does."""
        cn0 = np.where(np.isfinite(cn0_dbhz), cn0_dbhz, UNKNOWN_CN0_DBHZ)
        return np.asarray(self.noise**2 * (2.0**2 + 1.5**2 * 10 ** ((self.midpoint_dbhz + 5.0 - cn0) / 10)))

    def errors(self, cn0_dbhz: Floats) -> Errors:
        """The law of each row."""
        share, variance = self.share(cn0_dbhz), self.variance(cn0_dbhz)
        delay = np.full(len(share), self.delay_m)
        return Errors(share, variance, delay, modes(share, variance, delay))


@compiled
def densities(error_m: float, variance_m2: float, delay_m: float) -> tuple[float, float]:
    """Logarithms of the densities of noise alone and of noise with a delay, at an error (1/m)."""
    sigma = math.sqrt(variance_m2)
    clear = -0.5 * error_m * error_m / variance_m2 - math.log(sigma * _ROOT_2PI)
    z = (error_m - variance_m2 / delay_m) / sigma
    if z > -_FAR:
        tail = math.log(0.5 * math.erfc(-z / math.sqrt(2.0)))
    else:  # Mills' ratio, where erfc ends; what it leaves out is below 1e-7
        tail = -0.5 * z * z - math.log(-z * _ROOT_2PI) + math.log1p(-1 / z**2 + 3 / z**4)
    late = 0.5 * variance_m2 / delay_m**2 - error_m / delay_m + tail - math.log(delay_m)
    return clear, late


@compiled
def _log(share: float) -> float:
    return math.log(share) if share > 0.0 else -math.inf


@compiled
def _parts(
    error_m: float, share: float, variance_m2: float, delay_m: float
) -> tuple[float, float, float, float]:
    """The law's density (1/m) as its direct and its delayed part, and share times the density of noise, all three
    over the larger part; that one's logarithm.

    Shares are multiplied as logarithms: the smallest ones have too few digits for products, and late signals may be
    denser by any factor.
    """
    clear, late = densities(error_m, variance_m2, delay_m)
    direct, delayed = clear + _log(1 - share), late + _log(share)
    top = max(direct, delayed)
    return math.exp(direct - top), math.exp(delayed - top), math.exp(clear + _log(share) - top), top


@compiled
def log_density(error_m: float, share: float, variance_m2: float, delay_m: float) -> float:
    """Logarithm of the law's density (1/m)."""
    direct, delayed, _, top = _parts(error_m, share, variance_m2, delay_m)
    return top + math.log(direct + delayed)


@compiled
def reflected(error_m: float, share: float, variance_m2: float, delay_m: float) -> float:
    """Probability that a pseudorange with this error was reflected."""
    direct, delayed, _, _ = _parts(error_m, share, variance_m2, delay_m)
    return delayed / (direct + delayed)


@compiled
def pull(error_m: float, share: float, variance_m2: float, delay_m: float) -> float:
    """Minus the slope of the logarithm of the density (1/m): 0 at the mode, and 1/mean delay far on the late side."""
    direct, delayed, noise, _ = _parts(error_m, share, variance_m2, delay_m)
    # The delayed density's slope is (noise - itself) / mean delay.
    return (direct * error_m / variance_m2 + (delayed - noise) / delay_m) / (direct + delayed)


@compiled
def modes(share: Floats, variance_m2: Floats, delay_m: Floats) -> Floats:
    """Where each law is densest, m (n,): between 0 and a few sigmas, by bisection."""
    value = np.zeros(len(share))
    for i in range(len(share)):
        low, high = 0.0, 3 * math.sqrt(variance_m2[i]) + delay_m[i]
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            if pull(middle, share[i], variance_m2[i], delay_m[i]) > 0:
                high = middle
            else:
                low = middle
        value[i] = 0.5 * (low + high)
    return value


@compiled
def variance_at(error_m: float, errors: Errors, row: int) -> float:
    """Variance (m2) of the normal law about the mode that pulls as the law does at this error: for iterated weights."""
    share, variance, delay = errors.share[row], errors.variance_m2[row], errors.delay_m[row]
    off = error_m - errors.mode_m[row]
    least = 0.05 * math.sqrt(variance)
    if abs(off) < least:
        off = least
    return float(max(off / pull(errors.mode_m[row] + off, share, variance, delay), 0.25 * variance))
