"""What the measurements on consecutive traversals say about the knots of their segments: information and vector.

The nuisances are integrated out: the vehicle's constants, and the two drifting height errors in the order of time. Does
not know which traversals belong together, nor what a pass is worth by itself (``factors``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fusion.compiled import compiled
from fusion.methods.profile.measurements import ALTITUDE, BARO, TERRAIN, Measurements
from fusion.methods.profile.model import (
    BIAS,
    DRIFT,
    JUMP_SIGMA,
    MOUNT,
    SQUAT,
    SmootherEpochs,
    decorrelated,
    design,
)
from fusion.methods.profile.noise import Learned
from fusion.methods.profile.path import DrivenPath
from fusion.network.curve import (
    grade_rows,
    grade_variance,
    height_rows,
    height_variance,
    knot_length,
    variable_count,
)
from fusion.types import Bools, Floats, Ints

CONSTANTS = (MOUNT, BIAS, SQUAT)
"""States that hardly change over a pass: unknowns of its likelihood, of which the whole drive's belief is the prior."""


@dataclass(frozen=True, eq=False)
class OnTraversals:
    """The m measurements on a drive's traversals in the order of driving, ready to be summed; columns of shape (m,).

    ``distance_m`` is measured from the segment's from_node; ``sign`` is -1 where the segment is driven backwards.
    ``constants`` (m, 3): what each measurement sees of ``CONSTANTS``; ``grade_share``: what it sees of the grade, 1 for
    heights. ``variance`` has robust weights in it. ``drift_variance`` (2, m): variance by which the errors of the GNSS
    height and of the barometer have moved since the log began (m^2). ``roughness``: the drive's, 1/m.
    """

    sensor: Ints
    traversal: Ints
    distance_m: Floats
    sign: Floats
    constants: Floats
    grade_share: Floats
    value: Floats
    variance: Floats
    time_s: Floats
    drift_variance: Floats
    first: Ints
    """Where each traversal's measurements begin, and where the last one's end"""
    roughness: float

    @property
    def is_height(self) -> Bools:
        """Which measure heights; the others measure grades."""
        return np.asarray((self.sensor == ALTITUDE) | (self.sensor == BARO))


def on_traversals(
    measured: Measurements, epochs: SmootherEpochs, learned: Learned, path: DrivenPath
) -> OnTraversals:
    """Bring a drive's measurements to its traversals; terrain heights stay out, as the network has the DEM itself."""
    clean, share = decorrelated(measured, learned.noise)
    traversal, distance = path.match.position_on(measured.along_m)
    seen = design(measured, share)
    keep = np.flatnonzero((measured.sensor != TERRAIN) & (traversal >= 0))
    keep = keep[np.lexsort((measured.time_s[keep], traversal[keep]))]
    heights = np.isin(measured.sensor, (ALTITUDE, BARO))
    grade_share = np.where(heights, 1.0, 1.0 - share)
    elapsed = measured.time_s - measured.time_s[0]
    drift_variance = np.outer([learned.noise.drift, learned.noise.baro_drift], elapsed)
    for k, state in learned.jumps:
        if state == DRIFT:
            jump = JUMP_SIGMA[DRIFT] ** 2
            drift_variance[0] += np.where(measured.time_s >= epochs.time_s[k], jump, 0.0)
    return OnTraversals(
        sensor=measured.sensor[keep],
        traversal=traversal[keep],
        distance_m=distance[keep],
        sign=np.where(path.match.forward[traversal[keep]], 1.0, -1.0),
        constants=seen[np.ix_(keep, np.array(CONSTANTS))],
        grade_share=grade_share[keep],
        value=clean.value[keep],
        variance=learned.variance[keep],
        time_s=measured.time_s[keep],
        drift_variance=drift_variance[:, keep],
        first=np.searchsorted(traversal[keep], np.arange(len(path.match) + 1)),
        roughness=learned.noise.roughness,
    )


@dataclass(frozen=True, eq=False)
class Chain:
    """Consecutive traversals, from number ``start`` on; columns of shape (n,), one entry a traversal.

    ``length_m``: what the knots assume; ``scale``: that length over the network's; ``forward``: from from_node on.
    """

    start: int
    length_m: Floats
    scale: Floats
    forward: Bools

    @classmethod
    def between(cls, path: DrivenPath, start: int, stop: int) -> Chain:
        """The traversals ``start`` to ``stop`` - 1."""
        segment = path.match.segment[start:stop]
        length = knot_length(path.network.table.length_m[segment])
        scale = length / np.maximum(path.network.length_m[segment], 1e-9)
        return cls(start, length, scale, path.match.forward[start:stop])

    def __len__(self) -> int:
        return len(self.length_m)

    def without_last(self) -> Chain:
        """The same without the last traversal."""
        return replace(self, length_m=self.length_m[:-1], scale=self.scale[:-1], forward=self.forward[:-1])


def likelihood(data: OnTraversals, chain: Chain, mean: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Information (k, k) and vector (k,) over the stacked knots of a chain.

    ``mean`` (3,) and ``covariance`` (3, 3) are the prior of ``CONSTANTS``; the levels of the drifting errors are free.
    """
    counts = variable_count(chain.length_m)
    size = int(counts.sum())
    blocks, offset, climbed = [], 0, np.zeros(size)
    for number in range(len(chain)):
        k = chain.start + number
        mine = slice(data.first[k], data.first[k + 1])
        ends = (offset, offset + int(counts[number]) - 2)
        entry, leave = ends if chain.forward[number] else ends[::-1]
        length, scale = float(chain.length_m[number]), float(chain.scale[number])
        rows, extra = _knot_rows(data, mine, offset, size, length, scale)
        # The road goes on from segment to segment: a height is the climb since the first entry. So the levels of the
        # segments, which the network leaves to each of them, don't matter.
        heights = data.is_height[mine]
        rows[heights] += climbed
        rows[heights, entry] -= 1.0
        climbed[leave] += 1.0
        climbed[entry] -= 1.0
        blocks.append((rows, extra))
        offset += int(counts[number])
    rows, extra = (np.concatenate(part) for part in zip(*blocks, strict=True))
    whole = slice(data.first[chain.start], data.first[chain.start + len(chain)])
    kind = np.select([data.sensor[whole] == ALTITUDE, data.sensor[whole] == BARO], [1, 2], 0)
    full = np.zeros((len(rows), size + 5))
    full[:, :size] = rows
    full[:, size : size + 3] = data.constants[whole]
    full[kind == 1, size + 3] = 1.0
    full[kind == 2, size + 4] = 1.0
    information, vector = np.zeros((size + 5, size + 5)), np.zeros(size + 5)
    known = np.linalg.inv(covariance)
    information[size : size + 3, size : size + 3] = known
    vector[size : size + 3] = known @ mean
    accumulate(
        information, vector, full, kind.astype(np.int64), data.value[whole], data.variance[whole] + extra,
        np.ascontiguousarray(data.drift_variance[:, whole]),
    )  # fmt: skip
    return information[:size, :size].copy(), vector[:size].copy()


def _knot_rows(
    data: OnTraversals, mine: slice, offset: int, size: int, length: float, scale: float
) -> tuple[Floats, Floats]:
    """Rows over the stacked knots for one traversal's measurements, and the variance that the knots leave open."""
    distance = data.distance_m[mine] * scale
    heights = data.is_height[mine]
    q = data.roughness
    out = np.zeros((len(distance), size))
    block = np.where(
        heights[:, None],
        height_rows(distance, length),
        (data.sign[mine] * data.grade_share[mine])[:, None] * grade_rows(distance, length),
    )
    out[:, offset : offset + block.shape[1]] = block
    extra = np.where(
        heights,
        height_variance(distance, length, q),
        data.grade_share[mine] ** 2 * grade_variance(distance, length, q),
    )
    return out, extra


@compiled
def accumulate(  # noqa: C901 (one loop nest)
    information: Floats,
    vector: Floats,
    design: Floats,
    kind: Ints,
    value: Floats,
    variance: Floats,
    drift_variance: Floats,
) -> None:
    """Add m measurements in the order of time, the last two unknowns drifting in between; marginalise the last five.

    ``design`` has shape (m, n), ``information`` (n, n) and ``vector`` (n,), which are changed in place and hold in
    their first n - 5 entries what is left. ``kind``, (m,), is 1 for measurements that see the first drifting unknown,
    2 for the second, 0 for neither; ``drift_variance`` (2, m) is the variance that each has moved by.
    """
    n = len(vector)
    last = np.full(2, np.nan)
    for i in range(len(value)):
        if kind[i] > 0:
            which = kind[i] - 1
            if np.isfinite(last[which]):
                _walk(information, vector, n - 2 + which, drift_variance[which, i] - last[which])
            last[which] = drift_variance[which, i]
        for a in range(n):
            if design[i, a] != 0.0:
                weight = design[i, a] / variance[i]
                vector[a] += weight * value[i]
                for b in range(n):
                    information[a, b] += weight * design[i, b]
    for gone in range(n - 1, n - 6, -1):
        pivot = information[gone, gone]
        if pivot > 0.0:
            for a in range(gone):
                share = information[a, gone] / pivot
                if share != 0.0:
                    vector[a] -= share * vector[gone]
                    for b in range(gone):
                        information[a, b] -= share * information[gone, b]


@compiled
def _walk(information: Floats, vector: Floats, e: int, variance: float) -> None:
    """Let unknown e take a random step: information about where it was before becomes weaker."""
    n = len(vector)
    pivot = information[e, e]
    left = 1.0 / (1.0 + variance * pivot)
    share = variance * left
    for a in range(n):
        if a != e and information[a, e] != 0.0:
            pull = share * information[a, e]
            vector[a] -= pull * vector[e]
            for b in range(n):
                if b != e:
                    information[a, b] -= pull * information[e, b]
    for a in range(n):
        if a != e:
            information[a, e] *= left
            information[e, a] = information[a, e]
    vector[e] *= left
    information[e, e] = pivot * left
