"""What one pass of a drive over a segment says: a small Gaussian likelihood over the road and the drive's own errors.

Unknowns are the knots of the segment (``fusion.network.curve``) and what the drive carries along: constants, which
all of its passes share (``CONSTANTS``), and the errors of its height sensors where it enters and leaves
(``HEIGHT_SENSORS``), which walk at random. How a pass becomes a factor is the affair of the method that makes it; how
the passes of a drive hang together, ``fusion.network.unknowns``'.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from operator import attrgetter
from typing import Self

import numpy as np

from fusion.types import Bools, Floats, Ints

CONSTANTS = (
    "mount pitch", "force bias", "squat", "altimeter lag", "place east", "place north", "speed pressure",
)  # fmt: skip
"""Unknowns of a drive: grade, grade, grade per m/s^2, seconds; of a part of it, the error of its positions in units of
one sigma; and again of the drive, the share of the dynamic pressure that its barometer feels."""
USUAL_SPEED_PRESSURE = 0.15
"""That share for a sensor in or on a vehicle, of either sign. In a cabin it is 0.07: 100 km/h (4.6 hPa) make 0.3 hPa
there. In the wind it is more."""
CONSTANT_SIGMA = (0.3, 0.03, 0.005, 4.0, 1.0, 1.0, USUAL_SPEED_PRESSURE)
"""What is believed of each before the drive: nothing worth the name of the mount and the lag; a bias of 0.3 m/s^2 and
squat of half a degree a m/s^2 are large ones (spec 7)."""
PLACE_PART_S, PLACE_TAU_S = 30.0, 120.0
"""Parts of a drive over which the error of its positions is taken for one, independent from part to part, and how long
that error really lasts: as long as that of GNSS heights (spec 7). Parts that know of each other gave the same slopes
and made a change reach a mile."""
HEIGHT_SENSORS = ("altitude", "barometer")
"""Sensors of height whose errors walk at random, m: one unknown each where a pass begins and where it ends."""
MOUNT, BIAS, SQUAT, LAG, EAST, NORTH, SPEED_PRESSURE = range(7)
SETTINGS = {MOUNT: "mount", EAST: "place", NORTH: "place"}
"""Constants that hold for passes with equal numbers only, and the name of that number; the others for the drive."""
ENTRY = slice(7, 9)
EXIT = slice(9, 11)
NUISANCES = 11
"""The drive's unknowns behind the knots: the constants, then the height errors at entry, then those at exit."""

DRIVEN_BYTES = 96
"""So many of a stored factor's first bytes tell which part of the segment was driven, and when."""

_HEAD = 15
_FORMAT = -2.0
"""The first number of a stored factor; below 0, for formats before this one began with the number of the mount."""


@dataclass(frozen=True, eq=False, slots=True)
class PassFactor:
    """A likelihood exp(-(square - 2 vector' x + x' information x) / 2) over the knots of ``segment`` and ``NUISANCES``.

    ``rows`` is how many measurements it sums. ``sequence`` numbers the passes of a drive in the order of driving,
    ``mount`` its settings of the mount, ``place`` the parts of the drive over which the error of its positions is taken
    for one: passes with equal numbers share the unknown. ``walk_m2_per_s`` are the variances by which the errors of
    ``HEIGHT_SENSORS`` move in a second. ``start_m`` to ``end_m`` is the driven part, metres from from_node.
    ``roughness`` is the variance of the grade's change per metre that the drive learned (1/m).
    """

    segment: int
    sequence: int
    mount: int
    information: Floats
    vector: Floats
    square: float
    rows: int
    walk_m2_per_s: tuple[float, float]
    start_m: float
    end_m: float
    roughness: float
    observations: int
    first_time_s: float
    last_time_s: float
    place: int = 0
    lag_s: float = 0.0
    """How late the altimeter was taken for when its heights were put in their places"""
    grade_length_m: float = 0.0
    """Over how many metres the drive learned that grades go back to level; 0: it did not"""
    condensed: int = 0
    """How many passes of other drives it stands for (``fusion.network.condensed``); 0: it is one pass"""

    def over(self, segment: int) -> PassFactor:
        """The same pass, by another number of its segment: twice as fast as ``dataclasses.replace``."""
        return PassFactor(segment, *_BUT_SEGMENT(self))

    def widened(self, widening: float) -> PassFactor:
        """The same pass with all sigmas that it states ``widening`` times as large, those of its walks too."""
        if widening == 1.0:
            return self
        less, more = widening**-2.0, widening**2.0
        walk_a, walk_b = self.walk_m2_per_s
        return replace(
            self,
            information=less * self.information,
            vector=less * self.vector,
            square=less * self.square,
            walk_m2_per_s=(more * walk_a, more * walk_b),
        )

    @property
    def used(self) -> Bools:
        """Which of ``NUISANCES`` the factor speaks of, shape (``NUISANCES``,)."""
        return np.asarray(np.diagonal(self.information)[-NUISANCES:] > 0, np.bool_)

    def encode(self) -> bytes:
        """Everything but ``segment`` and ``sequence``, as little-endian doubles; unknowns without a word left out."""
        return self.encode_all([self])[0]

    @staticmethod
    def encode_all(factors: Sequence[PassFactor]) -> list[bytes]:
        """``encode`` of many: those of one shape at once, for a drive has hundreds."""
        alike: dict[int, list[int]] = {}
        for k, factor in enumerate(factors):
            alike.setdefault(len(factor.vector), []).append(k)
        out: dict[int, bytes] = {}
        for members in alike.values():
            out.update(zip(members, _packed([factors[k] for k in members]), strict=True))
        return [out[k] for k in range(len(factors))]

    @staticmethod
    def driven(stored: Sequence[bytes]) -> Floats:
        """Of encoded factors, or their first ``DRIVEN_BYTES``: start and end, m, first and last time, s; (n, 4)."""
        head = np.array([np.frombuffer(data, "<f8", DRIVEN_BYTES // 8) for data in stored]).reshape(
            -1, DRIVEN_BYTES // 8
        )
        former = (head[:, 0] != _FORMAT)[:, None]  # which began with the number of the mount
        return np.where(former, head[:, [5, 6, 9, 10]], head[:, [6, 7, 10, 11]])

    @classmethod
    def decode(cls, data: bytes, segment: int, sequence: int) -> Self:
        """The inverse of ``encode``, bit for bit."""
        return cls.decode_all([(data, segment, sequence)])[0]

    @classmethod
    def decode_all(cls, stored: Sequence[tuple[bytes, int, int]]) -> list[Self]:
        """``decode`` of many (data, segment, sequence): those of one shape at once, for a window has thousands."""
        alike: dict[tuple[int, bytes], list[int]] = {}
        read: list[bytes] = []
        for k, (told, _, _) in enumerate(stored):
            data = told if told[:8] == _FORMAT_BYTES else _of_version_1(told)
            read.append(data)
            alike.setdefault((len(data), data[8 * _HEAD : 8 * _HEAD + 8]), []).append(k)
        out: dict[int, Self] = {}
        for members in alike.values():
            numbers, vector, information = _unpacked([read[k] for k in members])
            for at, k in enumerate(members):
                (
                    _, mount, square, rows, walk_a, walk_b, start, end, roughness, observations, first, last, place,
                    lag, grade_length_m,
                ) = numbers[at]  # fmt: skip
                out[k] = cls(
                    stored[k][1], stored[k][2], int(mount), information[at], vector[at], square, int(rows),
                    (walk_a, walk_b), start, end, roughness, int(observations), first, last, int(place), lag,
                    grade_length_m,
                )  # fmt: skip
        return [out[k] for k in range(len(stored))]


@lru_cache(maxsize=256)
def _upper(size: int) -> tuple[Ints, Ints]:
    """Rows and columns of the upper triangle; passes have a few sizes."""
    return np.triu_indices(size)


_BITS = 1 << np.arange(NUISANCES)
_BUT_SEGMENT = attrgetter(*(f.name for f in fields(PassFactor)[1:]))


def _packed(factors: Sequence[PassFactor]) -> list[bytes]:
    """The inverse of ``_unpacked``, for factors whose vectors have one length."""
    head = [
        (
            _FORMAT, f.mount, f.square, f.rows, *f.walk_m2_per_s, f.start_m, f.end_m, f.roughness,
            f.observations, f.first_time_s, f.last_time_s, f.place, f.lag_s,
            f.grade_length_m,
        )
        for f in factors
    ]  # fmt: skip
    numbers, vector = np.array(head, float), np.array([f.vector for f in factors])
    information = np.array([f.information for f in factors])
    used = np.diagonal(information, axis1=1, axis2=2)[:, -NUISANCES:] > 0
    masks = used @ _BITS
    out = [b""] * len(factors)
    for mask in np.unique(masks):
        same = np.flatnonzero(masks == mask)
        columns = np.flatnonzero(np.append(np.ones(vector.shape[1] - NUISANCES, bool), used[same[0]]))
        row, column = _upper(len(columns))
        parts = (
            numbers[same],
            np.full((len(same), 1), mask, float),
            vector[np.ix_(same, columns)],
            information[same[:, None], columns[row], columns[column]],
        )
        for k, one in zip(same, np.concatenate(parts, axis=1).astype("<f8"), strict=True):
            out[k] = one.tobytes()
    return out


def _unpacked(data: Sequence[bytes]) -> tuple[list[list[float]], Floats, Floats]:
    """The leading numbers, the vectors and the information matrices of m stored factors of one shape."""
    values = np.frombuffer(b"".join(data), "<f8").astype(np.float64).reshape(len(data), -1)
    used = (int(values[0, _HEAD]) & _BITS) > 0
    left = values.shape[1] - _HEAD - 1
    count = int((np.sqrt(9 + 8 * left) - 3) / 2 + 0.5)  # count + count (count + 1) / 2 numbers are left
    columns = np.flatnonzero(np.concatenate([np.ones(count - int(used.sum()), bool), used]))
    size = count - int(used.sum()) + NUISANCES
    vector, information = np.zeros((len(data), size)), np.zeros((len(data), size, size))
    vector[:, columns] = values[:, _HEAD + 1 : _HEAD + 1 + count]
    row, column = (columns[v] for v in np.triu_indices(count))
    information[:, row, column] = information[:, column, row] = values[:, _HEAD + 1 + count :]
    return values[:, :_HEAD].tolist(), vector, information


_FORMAT_BYTES = np.array([_FORMAT], "<f8").tobytes()


def _of_version_1(data: bytes) -> bytes:
    """A factor that was stored before version 2, in which no pass knew of a speed pressure or of a grade's length."""
    old = np.frombuffer(data, "<f8")
    head, used, rest = old[:13], int(old[13]), old[14:]
    mask = (used & 0b111111) | (used & ~0b111111) << 1
    return np.concatenate([[_FORMAT], head, [0.0, mask], rest]).astype("<f8").tobytes()


def symmetric(upper: Floats, size: int) -> Floats:
    """The symmetric matrix (size, size) with this upper triangle, row by row."""
    out = np.zeros((size, size))
    out[np.triu_indices(size)] = upper
    return np.asarray(out + np.triu(out, 1).T)
