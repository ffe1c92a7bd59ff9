"""Code differential corrections: by how much a base, a receiver whose place is known, finds pseudoranges too long.

It is taken off those of a receiver that drives near. The satellites' clocks and orbits and the air above are wrong
alike for both (relative positioning, Saadaoui 2011, 1.3.1: there the base's error of place is taken off,
``fusion.published.positioning.relative``). Reflections and noise at either antenna stay; the base's are averaged over a
minute to either side.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from fusion.arrays import nearest
from fusion.errors import MalformedLogError
from fusion.gnss.earth import elevation_azimuth
from fusion.gnss.measurements import Measurements
from fusion.messages import joined, say
from fusion.types import Bools, Floats, Ints

AVERAGED_S = 60.0
"""A correction is a straight line through the base's so far to either side: the air changes by decimetres meanwhile."""
OLDEST_S = 60.0
"""No correction is taken from a base that measured the satellite longer ago, or later."""
FEWEST = 4
"""Epochs with fewer corrected satellites stay as they were: corrected ones and others do not go together."""
MISPLACED_M = 300.0
"""A base whose own pseudoranges put it so far from where it is said to stand is not there."""
FAR_M = 100_000.0
"""Beyond, the air above the base is another's."""


@dataclass(frozen=True, eq=False)
class Corrections:
    """What is to be taken off pseudoranges, m: k rows, sorted by satellite (its place in ``names``), then by time.

    ``place_m`` (3,) is where the base stands, ECEF.
    """

    names: tuple[str, ...]
    satellite: Ints
    time_s: Floats
    value_m: Floats
    place_m: Floats

    def at(self, names: tuple[str, ...], satellite: Ints, time_s: Floats) -> Floats:
        """The corrections of rows (n,), whose satellites have numbers among ``names``; NaN where none is near."""
        out = np.full(len(time_s), np.nan)
        for number, name in enumerate(names):
            if name in self.names:
                rows, mine = satellite == number, self.satellite == self.names.index(name)
                out[rows] = _between(self.time_s[mine], self.value_m[mine], time_s[rows])
        return out


def corrections_of(base: Measurements, place_m: Floats | None) -> Corrections:
    """Of a base at ``place_m`` (3,), ECEF.

    Raises ``MalformedLogError`` where that is not known, and where its pseudoranges say nothing, or another place.
    """
    if place_m is None:
        raise MalformedLogError(say("gnss.base_placeless"), where="base")
    if not len(base.satellite):
        raise MalformedLogError(say("gnss.base_silent", why=joined(base.warnings)), where="base")
    apart_m = float(np.linalg.norm(base.rough_m - place_m))
    if apart_m > MISPLACED_M:
        raise MalformedLogError(say("gnss.base_elsewhere", km=apart_m / 1000), where="base")
    excess = base.pseudorange_m - np.linalg.norm(base.satellite_m - place_m, axis=1)
    epoch, weight = base.epoch, np.sin(elevation_azimuth(place_m, base.satellite_m)[0]) ** 2
    # Clocks of systems apart by a constant, then the base's own clock: the mean of all satellites, high ones foremost.
    for _ in range(2):
        excess = excess - _means(excess, weight, epoch)
        excess = excess - _means(excess, weight, base.group)
    excess = excess - _means(excess, weight, epoch)
    time_s = base.time_s[epoch]
    order = np.lexsort((time_s, base.satellite))
    satellite, time_s, excess = base.satellite[order], time_s[order], excess[order]
    new_arc = (np.diff(satellite) != 0) | (np.diff(time_s) > OLDEST_S)
    arcs = np.split(np.arange(len(order)), np.flatnonzero(new_arc) + 1)
    value = np.concatenate([_averaged(time_s[arc], excess[arc]) for arc in arcs])
    return Corrections(base.names, satellite, time_s, value, place_m)


def corrected(measured: Measurements, corrections: Corrections) -> Measurements:
    """The measurements with corrections taken off.

    Of an epoch in which ``FEWEST`` satellites or more are corrected the others are left out; another stays as it was.
    Both are counted.
    """
    off_m = corrections.at(measured.names, measured.satellite, measured.time_s[measured.epoch])
    known = np.isfinite(off_m)
    enough = np.bincount(measured.epoch[known], minlength=len(measured)) >= FEWEST
    by_base = enough[measured.epoch]
    counts = Counter(measured.counts)
    counts["corrected by the base"] = int(np.count_nonzero(by_base & known))
    counts["unknown to the base"] = int(np.count_nonzero(by_base & ~known))
    pseudorange_m = measured.pseudorange_m - np.where(by_base & known, off_m, 0.0)
    warnings = [*measured.warnings, *_warnings(measured, corrections, enough)]
    out = replace(
        measured,
        pseudorange_m=pseudorange_m,
        counts={k: n for k, n in counts.items() if n},
        warnings=tuple(warnings),
    )
    return out.take_rows(known | ~by_base)


def _warnings(measured: Measurements, corrections: Corrections, enough: Bools) -> list[str]:
    sentences: list[str] = []
    if len(measured) and not enough.all():
        sentences.append(say("gnss.base_missing", n=int(np.count_nonzero(~enough)), all=len(measured)))
    away_m = float(np.linalg.norm(measured.rough_m - corrections.place_m))
    if away_m > FAR_M:
        sentences.append(say("gnss.base_far", km=away_m / 1000))
    return sentences


def _means(values: Floats, weight: Floats, label: Ints) -> Floats:
    """The weighted mean of each row's label, (n,)."""
    total, weights = np.bincount(label, weight * values), np.bincount(label, weight)
    return np.asarray((total / np.maximum(weights, 1e-12))[label])


def _averaged(time_s: Floats, value: Floats) -> Floats:
    """A straight line through what is ``AVERAGED_S`` to either side of each moment, there; (k,), ascending times."""
    since = time_s - time_s[0]
    first = np.searchsorted(since, since - AVERAGED_S, side="left")
    last = np.searchsorted(since, since + AVERAGED_S, side="right")

    def sums(column: Floats) -> Floats:
        total = np.concatenate([[0.0], np.cumsum(column)])
        return np.asarray(total[last] - total[first])

    n, t, v = sums(np.ones(len(since))), sums(since), sums(value)
    spread = sums(since**2) - t**2 / n
    slope = np.divide(sums(since * value) - t * v / n, spread, out=np.zeros(len(n)), where=spread > 1.0)
    return np.asarray(v / n + slope * (since - t / n))


def _between(known_s: Floats, value: Floats, time_s: Floats) -> Floats:
    """Values at times, by proportion; NaN where none is within ``OLDEST_S``."""
    apart_s = np.abs(known_s[nearest(known_s, time_s)] - time_s)
    return np.where(apart_s <= OLDEST_S, np.interp(time_s, known_s, value), np.nan)
