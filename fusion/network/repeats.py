"""What drives that repeat a segment say of each other's sigmas: statistics of pairs, and widenings by device class.

Two drives over one segment measure one slope, so z = (a - b) / hypot(sigma_a, sigma_b) of their own slopes has variance
1 where sigmas are what they say. Pairs of the same two drives share the errors of both drives, and pairs that have one
drive in common share its errors. So a pair of drives counts once, however many segments both went over, and variances
are those of dyads (Aronow, Samii & Assenova 2015, "Cluster-robust variance estimation for dyadic data").

The widening of a class is the number by which its sigmas are too small. Of a pair of two classes the squared difference
belongs to each in proportion to its variance: the score of maximum likelihood of variance components (Dempster, Laird &
Rubin 1977, section 4.4). Wrong matches have bounded influence (Huber 1981, "proposal 2").

Errors that both drives share cancel in a difference: those of the elevation model, of the map, of a device's mounting.
So repeats find sigmas that are too small, and never prove that they are large enough.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple, Self

import numpy as np

from fusion.types import Bools, Floats, Ints

INSIDE_SIGMAS = 1.96
SPEEDS_KMH = (0, 20, 50, 80)
LENGTHS_M = (0, 20, 50, 100, 200)
"""Where bands begin."""
SEASONS = ("Dec-Feb", "Mar-May", "Jun-Aug", "Sep-Nov")

BOUND_SIGMAS = 2.5
"""A pair that is farther apart counts as if it were that far apart."""
_BOUNDED_MEAN = (
    math.erf(BOUND_SIGMAS / math.sqrt(2))
    - BOUND_SIGMAS * math.sqrt(2 / math.pi) * math.exp(-(BOUND_SIGMAS**2) / 2)
    + BOUND_SIGMAS**2 * math.erfc(BOUND_SIGMAS / math.sqrt(2))
)
"""Mean of the square of a standard normal number that is bounded so."""
MOST_OF_SEGMENT = 100
"""Of a segment that more drives repeat, the newest pairs count."""
NEARLY_WHOLE = 0.9
"""A drive that drove less of a segment measured something else than its slope."""
PRIOR_COUNT = 2.0
"""Imaginary pairs of drives of each class whose sigmas are what they say."""
FEWEST_DRIVES = 10
"""A class of which fewer drives, or fewer pairs of drives, are repeated stays as it is."""
MOST_WIDENING = 5.0
_ROUNDS, _SETTLED = 300, 1e-5


class OwnSlopes(NamedTuple):
    """What each of m drives by itself says of a segment that it passed once, segment by segment, the newest last.

    Columns of shape (m,) but ``names``, of which ``kind`` is a number: device classes. ``way`` is 1 where it went as
    the segment is drawn, -1 the other way, 0 unknown.
    """

    names: tuple[str, ...]
    segment: Ints
    drive: Ints
    kind: Ints
    slope_percent: Floats
    sigma_percent: Floats
    length_m: Floats
    driven_m: Floats
    speed_mps: Floats
    way: Ints
    season: Ints


@dataclass(frozen=True, eq=False)
class RepeatPairs:
    """n pairs of drives over one segment each; columns have shape (n,) or, of both drives, (n, 2).

    ``classes`` are numbers in ``names``. ``direction`` is 1 where both went the same way, -1 the other way, 0 unknown.
    ``speed_mps`` is the mean of both. ``season`` is a number in ``SEASONS``, -1 unknown.
    """

    names: tuple[str, ...]
    segment: Ints
    drives: Ints
    classes: Ints
    slope_percent: Floats
    sigma_percent: Floats
    length_m: Floats
    speed_mps: Floats
    direction: Ints
    season: Ints

    @classmethod
    def of_neighbours(cls, own: OwnSlopes) -> Self:
        """Each drive that went over a segment nearly whole with the last that did so before it, and with the last of
        its own class."""
        whole = np.flatnonzero(own.driven_m >= NEARLY_WHOLE * own.length_m)
        of_class = whole[np.lexsort((whole, own.kind[whole], own.segment[whole]))]
        near = _neighbours(whole, own.segment, np.zeros_like(own.kind))
        both = np.unique(np.concatenate([near, _neighbours(of_class, own.segment, own.kind)]), axis=0)
        return cls(
            own.names,
            own.segment[both[:, 0]],
            own.drive[both],
            own.kind[both],
            own.slope_percent[both],
            own.sigma_percent[both],
            own.length_m[both[:, 0]],
            own.speed_mps[both].mean(axis=1),
            own.way[both].prod(axis=1),
            own.season[both],
        )

    @property
    def difference_percent(self) -> Floats:
        """First less second, (n,)."""
        return np.asarray(self.slope_percent[:, 0] - self.slope_percent[:, 1])

    def z(self) -> Floats:
        """Differences by the sigma that is stated of them, (n,)."""
        return np.asarray(self.difference_percent / np.hypot(*self.sigma_percent.T))

    def pair_of_drives(self) -> tuple[Ints, Ints]:
        """The different pairs of drives (p, 2), the smaller number first, and which of them each row is of (n,)."""
        ordered, row = np.unique(np.sort(self.drives, axis=1), axis=0, return_inverse=True)
        return ordered, row.ravel()


@dataclass(frozen=True)
class Widening:
    """By how much the sigmas of a class are too small, as its repeats show, and how well that is known (one sigma)."""

    name: str
    learned: float
    sigma: float
    pairs: int
    drive_pairs: int
    drives: int

    @property
    def applied(self) -> float:
        """What its sigmas are to be multiplied by: 1 unless ``learned`` is above 1 by more than its own sigma."""
        known = min(self.drive_pairs, self.drives) >= FEWEST_DRIVES
        return self.learned if known and self.learned - self.sigma > 1.0 else 1.0


def device_class(report: Mapping[str, Any]) -> str:
    """The strongest sensor that a drive used, by its report, and the format of its log.

    A method that does not tell its sensors is taken for one that knows the elevation model alone.
    """
    sensors = report.get("sensors", {})
    strongest = next((name for name in ("doppler", "barometer", "altitude") if name in sensors), "")
    if strongest == "altitude" and report.get("altimeter"):
        strongest = "altimeter"
    elif not strongest:
        strongest = "inertial" if {"pitch", "specific force"} & set(sensors) else "elevation model"
    return f"{strongest}, {report['format']}"


def repeat_statistics(pairs: RepeatPairs) -> list[dict[str, Any]]:
    """A row for all pairs and for each group of them; JSON-serialisable.

    ``rms_z_sigma`` is one sigma of ``rms_z``, by pairs of drives; None of a single one.
    """
    of_drives, row = pairs.pair_of_drives()
    z, apart = pairs.z(), np.abs(pairs.difference_percent)
    stated = np.sqrt(np.mean(np.square(pairs.sigma_percent), axis=1))
    out = []
    for kind, group, mine in _groups(pairs):
        count, mean = int(np.count_nonzero(mine)), float(np.mean(np.square(z[mine])))
        score = np.asarray(np.bincount(row[mine], (np.square(z[mine]) - mean) / count, len(of_drives)), float)
        drive_pairs = len(np.unique(row[mine]))
        sigma = math.sqrt(float(_dyadic(score[:, None], of_drives)[0, 0])) / (2 * math.sqrt(max(mean, 1e-12)))
        out.append(
            {
                "kind": kind,
                "group": group,
                "pairs": count,
                "drive_pairs": drive_pairs,
                "segments": len(np.unique(pairs.segment[mine])),
                "rms_z": math.sqrt(mean),
                "rms_z_sigma": sigma if drive_pairs > 1 else None,
                "inside_share": float(np.mean(np.abs(z[mine]) < INSIDE_SIGMAS)),
                "median_difference_percent": float(np.median(apart[mine])),
                "mean_sigma_percent": float(np.mean(stated[mine])),
            }
        )
    return out


def _groups(pairs: RepeatPairs) -> Iterator[tuple[str, str, Bools]]:
    """Kind of group, its name, and its rows (n,); none without any."""
    low, high = np.sort(pairs.classes, axis=1).T
    season = np.where(pairs.season[:, 0] == pairs.season[:, 1], pairs.season[:, 0], len(SEASONS))
    season[(pairs.season < 0).any(axis=1)] = -1
    columns: list[tuple[str, Ints, dict[int, str]]] = [
        ("all", np.zeros(len(low), np.int64), {0: "all"}),
        ("class", np.where(low == high, low, -1), dict(enumerate(pairs.names))),
        ("class", np.where(low == high, -1, 0), {0: "different classes"}),
        ("direction", pairs.direction, {1: "same", -1: "opposite"}),
        ("speed", np.digitize(3.6 * pairs.speed_mps, SPEEDS_KMH) - 1, _bands(SPEEDS_KMH, "km/h")),
        ("length", np.digitize(pairs.length_m, LENGTHS_M) - 1, _bands(LENGTHS_M, "m")),
        ("season", season, {**dict(enumerate(SEASONS)), len(SEASONS): "different seasons"}),
    ]
    for kind, number, names in columns:
        for k, name in names.items():
            if (mine := number == k).any():
                yield kind, name, mine


def _bands(starts: tuple[int, ...], unit: str) -> dict[int, str]:
    texts = [f"{a} to {b} {unit}" for a, b in pairwise(starts)]
    return dict(enumerate([*texts, f"from {starts[-1]} {unit}"]))


def learn_widenings(pairs: RepeatPairs) -> list[Widening]:
    """The widening of every class that any of the pairs is of, by name; within 1 / ``MOST_WIDENING`` and that."""
    if not len(pairs.segment):
        return []
    _, row = pairs.pair_of_drives()
    weight = 1 / np.bincount(row)[row]
    variance, square = np.square(pairs.sigma_percent), np.ones(len(pairs.names))
    total = np.bincount(pairs.classes.ravel(), np.repeat(weight, 2), len(square)) + PRIOR_COUNT
    for _ in range(_ROUNDS):
        part, ratio = _parts(pairs, variance, square)
        said = square[pairs.classes] * (1 + part * (ratio[:, None] - 1))
        told = np.bincount(pairs.classes.ravel(), (weight[:, None] * said).ravel(), len(square))
        former, square = square, np.clip((told + PRIOR_COUNT) / total, MOST_WIDENING**-2, MOST_WIDENING**2)
        if np.max(np.abs(np.log(square / former))) < _SETTLED:
            break
    sigma = _sigmas(pairs, variance, square, weight)
    out = []
    for k, name in enumerate(pairs.names):
        mine = (pairs.classes == k).any(axis=1)
        if mine.any():
            counts = int(np.count_nonzero(mine)), len(np.unique(row[mine]))
            drives = len(np.unique(pairs.drives[pairs.classes == k]))
            out.append(Widening(name, float(np.sqrt(square[k])), float(sigma[k]), *counts, drives))
    return out


def _parts(pairs: RepeatPairs, variance: Floats, square: Floats) -> tuple[Floats, Floats]:
    """The share of each drive in the variance of a difference (n, 2), and the bounded square of each difference by
    that variance, 1 in the mean (n,)."""
    own = variance * square[pairs.classes]
    total = own.sum(axis=1)
    ratio = np.minimum(np.square(pairs.difference_percent) / total, BOUND_SIGMAS**2) / _BOUNDED_MEAN
    return own / total[:, None], ratio


def _sigmas(pairs: RepeatPairs, variance: Floats, square: Floats, weight: Floats) -> Floats:
    """One sigma of the widenings (k,): the sandwich of dyads, the imaginary pairs counted among them."""
    part, ratio = _parts(pairs, variance, square)
    of_drives, row = pairs.pair_of_drives()
    share = np.zeros((len(ratio), len(square)))
    for side in range(2):
        np.add.at(share, (np.arange(len(ratio)), pairs.classes[:, side]), part[:, side])
    score = np.zeros((len(of_drives), len(square)))
    np.add.at(score, row, (weight * (ratio - 1))[:, None] * share)
    felt = weight * ratio * (ratio * _BOUNDED_MEAN < BOUND_SIGMAS**2)
    slope = (share * felt[:, None]).T @ share + np.diag(PRIOR_COUNT / square)
    spread = _dyadic(score, of_drives) + np.diag(2 * PRIOR_COUNT / square**2)
    inverse = np.linalg.inv(slope)
    return np.asarray(np.sqrt(square * np.diagonal(inverse @ spread @ inverse)) / 2)


def _dyadic(score: Floats, of_drives: Ints) -> Floats:
    """Variance (k, k) of the sum of scores (p, k) of pairs of drives (p, 2): those with a drive in common belong
    together. What these add is left out where it would take variance away."""
    drives, number = np.unique(of_drives, return_inverse=True)
    of_drive = np.zeros((len(drives), score.shape[1]))
    for side in range(2):
        np.add.at(of_drive, number.reshape(of_drives.shape)[:, side], score)
    alone = score.T @ score
    value, vector = np.linalg.eigh(of_drive.T @ of_drive - 2 * alone)
    return np.asarray(alone + (vector * np.maximum(value, 0)) @ vector.T)


def _neighbours(order: Ints, segment: Ints, kind: Ints) -> Ints:
    """Rows next to each other in this order (p, 2) that are of one segment and kind, the newest ``MOST_OF_SEGMENT`` of
    each; in the order rows of one segment and kind are together, the newest last."""
    before, after = order[:-1], order[1:]
    new = (segment[before] != segment[after]) | (kind[before] != kind[after])
    last = np.append(np.flatnonzero(new), len(new))
    behind = last[np.searchsorted(last, np.arange(len(new)))] - np.arange(len(new))
    return np.asarray(np.column_stack([before, after])[~new & (behind <= MOST_OF_SEGMENT)], np.int64)
