"""All passes over a segment condensed into one: sums of factors, and which passes are accepted.

A sum of likelihoods does not depend on the order of arrival. A pass that contradicts the others is left out by a rule
that looks at all passes of the segment at once, so that who is rejected does not depend on the order either.
Other segments are not known here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from fusion.network.pass_factor import PassFactor, decode_many, symmetric
from fusion.types import Bools, Floats, Ints

REJECT_SIGMAS = 4.0
"""A pass farther than this from the consensus of at least ``CONSENSUS_PASSES`` passes is rejected."""
CONSENSUS_PASSES = 3
"""Of two passes that contradict each other nobody knows which is wrong."""
COMMON_SIGMA_PERCENT = 0.25
"""What even faultless passes differ by: the lane, the place on the segment, the state of the springs."""

_PASS = np.dtype(
    [
        ("key", "<i8"),
        ("slope", "<f8"),
        ("sigma", "<f8"),
        ("start", "<f8"),
        ("end", "<f8"),
        ("log_roughness", "<f8"),
        ("observations", "<i4"),
        ("accepted", "?"),
    ]
)

Group = tuple[Floats, Floats]
"""Sum of information and of vectors over the passes with the same history."""


def passes_by_segment(factors: Iterable[PassFactor]) -> dict[int, list[tuple[int, PassFactor]]]:
    """The factors under running keys, by the segment that each passed: what ``SegmentEvidence.build`` takes."""
    passes: dict[int, list[tuple[int, PassFactor]]] = {}
    for key, factor in enumerate(factors):
        passes.setdefault(factor.segments[-1], []).append((key, factor))
    return passes


@dataclass(frozen=True, eq=False)
class SegmentEvidence:
    """The passes over one segment; ``groups``: ``PassFactor.segments`` to the sum over those that are accepted."""

    passes: NDArray[np.void]
    groups: Mapping[tuple[int, ...], Group]

    @classmethod
    def build(cls, passes: Sequence[tuple[int, PassFactor]]) -> Self:
        """Condense (key, factor) pairs; the same pairs in any order give the same bits. Keys must differ."""
        return cls.build_encoded([(key, factor.segments, factor.encode()) for key, factor in passes])

    @classmethod
    def build_encoded(cls, passes: Sequence[tuple[int, tuple[int, ...], bytes]]) -> Self:
        """``build`` from (key, segments, encoded factor), as they are stored: thousands at a time."""
        ordered = sorted(passes, key=lambda item: item[0])
        rows_of: dict[tuple[int, ...], list[int]] = {}
        for row, (_, history, _) in enumerate(ordered):
            rows_of.setdefault(history, []).append(row)
        table = np.zeros(len(ordered), _PASS)
        table["key"] = [key for key, _, _ in ordered]
        stacks = {h: decode_many([ordered[row][2] for row in rows]) for h, rows in rows_of.items()}
        for history, rows in rows_of.items():
            _fill(table, rows, stacks[history][0])
        table = _with_rejections(table)
        groups = {}
        for history, rows in rows_of.items():
            accepted, (_, vectors, uppers) = table["accepted"][rows], stacks[history]
            if accepted.any():
                upper, vector = uppers[accepted].sum(axis=0), vectors[accepted].sum(axis=0)
                groups[history] = (symmetric(upper, len(vector)), vector)
        return cls(table, groups)

    def missing_for(self, added: Sequence[tuple[int, PassFactor]]) -> list[int]:
        """Keys of passes that ``added`` makes accepted or rejected, unlike now: ``with_passes`` needs their factors."""
        return [int(key) for key in self._flipped(self._joined(added))]

    def with_passes(
        self, added: Sequence[tuple[int, PassFactor]], flipped: Mapping[int, PassFactor] | None = None
    ) -> Self:
        """The evidence with further passes; equal to ``build`` from all to rounding.

        ``flipped`` holds the factors that ``missing_for`` asks for. Raises ``KeyError`` where one is missing.
        """
        table = self._joined(added)
        accepted = dict(zip(table["key"].tolist(), table["accepted"].tolist(), strict=True))
        groups = dict(self.groups)
        for key, factor in added:
            if accepted[key]:
                _add(groups, factor, 1.0)
        for key in self._flipped(table).tolist():
            _add(groups, (flipped or {})[key], 1.0 if accepted[key] else -1.0)
        return type(self)(table, groups)

    def _joined(self, added: Sequence[tuple[int, PassFactor]]) -> NDArray[np.void]:
        new = np.zeros(len(added), _PASS)
        new["key"] = [key for key, _ in added]
        for row, (_, factor) in enumerate(added):
            _fill(new, [row], decode_many([factor.encode()])[0])
        table = np.concatenate([self.passes, new])
        return _with_rejections(table[np.argsort(table["key"], kind="stable")])

    def _flipped(self, joined: NDArray[np.void]) -> Ints:
        """Keys of the passes that are accepted here but not in ``joined``, which holds them all, or the reverse."""
        now = joined["accepted"][np.searchsorted(joined["key"], self.keys)]
        return np.asarray(self.keys[now != self.accepted])

    @property
    def keys(self) -> Ints:
        """Keys of the passes, ascending."""
        return np.asarray(self.passes["key"], np.int64)

    @property
    def accepted(self) -> Bools:
        """Whether each pass is accepted."""
        return np.asarray(self.passes["accepted"], np.bool_)

    @property
    def slope_percent(self) -> Floats:
        """What each pass says by itself."""
        return np.asarray(self.passes["slope"], np.float64)

    @property
    def slope_sigma_percent(self) -> Floats:
        """One standard deviation of each."""
        return np.asarray(self.passes["sigma"], np.float64)

    @property
    def observations(self) -> int:
        """Measurements behind the accepted passes."""
        return int(self.passes["observations"][self.accepted].sum())

    @property
    def driven(self) -> tuple[float, float]:
        """The part that the accepted passes cover together, metres from from_node."""
        accepted = self.passes[self.accepted]
        return float(accepted["start"].min()), float(accepted["end"].max())

    @property
    def roughness(self) -> float:
        """What the passes learned about the grade's change (geometric mean), 1/m."""
        return float(np.exp(self.passes["log_roughness"][self.accepted].mean()))

    @property
    def birge_ratio(self) -> float:
        """How much the accepted passes scatter beyond their sigmas: a factor on the slope's sigma, at least 1.

        A few passes scatter by chance, so the ratio is drawn to 1 by ``CONSENSUS_PASSES`` imaginary well-behaved ones.
        """
        accepted = self.passes[self.accepted]
        if len(accepted) < 2:
            return 1.0
        variance = accepted["sigma"] ** 2 + COMMON_SIGMA_PERCENT**2
        mean = np.sum(accepted["slope"] / variance) / np.sum(1 / variance)
        chi2 = float(np.sum((accepted["slope"] - mean) ** 2 / variance))
        return float(np.sqrt(max(1.0, (chi2 + CONSENSUS_PASSES) / (len(accepted) - 1 + CONSENSUS_PASSES))))

    def encode(self) -> bytes:
        """All of it as bytes: a cache, which ``build`` can make again."""
        parts = [np.array([len(self.passes), len(self.groups)], "<i8").tobytes(), self.passes.tobytes()]
        for history in sorted(self.groups):
            information, vector = self.groups[history]
            upper = information[np.triu_indices(len(vector))]
            parts.append(np.array([len(history), len(vector), *history], "<i8").tobytes())
            parts.append(np.concatenate([vector, upper]).astype("<f8").tobytes())
        return b"".join(parts)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """The inverse of ``encode``, bit for bit."""
        count, groups = (int(v) for v in np.frombuffer(data, "<i8", 2))
        passes = np.frombuffer(data, _PASS, count, 16)
        at, found = 16 + count * _PASS.itemsize, {}
        for _ in range(groups):
            depth, size = (int(v) for v in np.frombuffer(data, "<i8", 2, at))
            history = tuple(np.frombuffer(data, "<i8", depth, at + 16).tolist())
            at += 16 + 8 * depth
            numbers = np.frombuffer(data, "<f8", size + size * (size + 1) // 2, at)
            found[history] = (symmetric(numbers[size:], size), numbers[:size].copy())
            at += numbers.nbytes
        return cls(passes.copy(), found)


def _fill(table: NDArray[np.void], rows: list[int], numbers: Floats) -> None:
    """Set rows of the table of passes from the numbers of their factors (``decode_many``)."""
    for column, name in enumerate(("slope", "sigma", "start", "end")):
        table[name][rows] = numbers[:, column]
    table["log_roughness"][rows] = np.log(numbers[:, 4])
    table["observations"][rows] = numbers[:, 5]


def _with_rejections(table: NDArray[np.void]) -> NDArray[np.void]:
    """The table with the passes near the median of all marked as accepted; never more than half are rejected."""
    variance = table["sigma"] ** 2 + COMMON_SIGMA_PERCENT**2
    table["accepted"] = True
    if len(table) < CONSENSUS_PASSES:
        return table
    consensus = float(np.median(table["slope"]))
    spread = 1.25 * np.sqrt(np.median(variance) / len(table))
    far = np.abs(table["slope"] - consensus) > REJECT_SIGMAS * np.sqrt(variance + spread**2)
    if far.sum() * 2 < len(table):
        table["accepted"] = ~far
    return table


def _add(groups: dict[tuple[int, ...], Group], factor: PassFactor, sign: float) -> None:
    information, vector = groups.get(factor.segments, (0.0, 0.0))
    groups[factor.segments] = (information + sign * factor.information, vector + sign * factor.vector)
