"""How the grade goes on where road segments meet: for the smoother of a drive and for the network, by one rule."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.roads.table import RoadTable
from fusion.types import Floats, Ints

PLAIN_SIGMA = 0.001
"""Change of grade at a node where a road merely goes on, straight ahead (1 = 100 %)."""
JUNCTION_SIGMA = 0.003
"""The same at a junction: the camber of the crossing road."""
TURN_SIGMA, JUNCTION_TURN_SIGMA = 0.02, 0.06
"""What a turn by 90 degrees adds, on one road and from road to road."""
STRUCTURE_SIGMA = 0.03
"""What the beginning or end of a bridge or tunnel adds: ramps and abutments."""
MAX_ARMS = 8
"""Ends at a node that are coupled each with each; of more, each with the seven after it."""


@dataclass(frozen=True, eq=False)
class Couplings:
    """Pairs of segment ends that meet: rows, whether it is the row's to_node, and one sigma of the change of grade."""

    row_a: Ints
    end_a: NDArray[np.bool_]
    row_b: Ints
    end_b: NDArray[np.bool_]
    sigma: Floats


def grade_change_sigma(cosine: Floats, arms: Ints, structure_ends: NDArray[np.bool_]) -> Floats:
    """One sigma of the change of grade at nodes of so many arms; ``cosine`` of the turn, 1 straight ahead.

    ``structure_ends``: whether a bridge or tunnel begins or ends there.
    """
    plain = arms <= 2
    straight = np.where(plain, PLAIN_SIGMA, JUNCTION_SIGMA)
    turn = np.where(plain, TURN_SIGMA, JUNCTION_TURN_SIGMA) * (1 - cosine)
    structure = np.where(structure_ends, STRUCTURE_SIGMA, 0.0)
    return np.asarray(np.sqrt(straight**2 + turn**2 + structure**2))


def couplings(network: RoadTable) -> Couplings:
    """All pairs of ends at each node; of arms at most ``MAX_ARMS`` - 1 apart in the list."""
    n = len(network)
    node = np.concatenate([network.from_node, network.to_node])
    row = np.concatenate([np.arange(n), np.arange(n)])
    at_end = np.repeat([False, True], n)
    order = np.argsort(node, kind="stable")
    node, row, at_end = node[order], row[order], at_end[order]
    _, begin, arms = np.unique(node, return_index=True, return_counts=True)
    degree = np.repeat(arms, arms)
    place = np.arange(2 * n) - np.repeat(begin, arms)
    first, second = [], []
    for offset in range(1, min(int(arms.max(initial=0)), MAX_ARMS)):
        i = np.flatnonzero(place + offset < degree)
        first.append(i)
        second.append(i + offset)
    a = np.concatenate([np.empty(0, np.int64), *first])
    b = np.concatenate([np.empty(0, np.int64), *second])
    east, north = _outward(network, row, at_end)
    cosine = -(east[a] * east[b] + north[a] * north[b])
    kind = 2 * network.bridge.astype(int) + network.tunnel
    sigma = grade_change_sigma(cosine, degree[a], kind[row[a]] != kind[row[b]])
    return Couplings(row[a], at_end[a], row[b], at_end[b], sigma)


def _outward(network: RoadTable, row: Ints, at_end: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Unit vectors away from the node, along the segment."""
    north = network.lat1_deg - network.lat0_deg
    east = (network.lon1_deg - network.lon0_deg) * np.cos(
        np.radians(0.5 * (network.lat0_deg + network.lat1_deg))
    )
    size = np.maximum(np.hypot(east, north), 1e-300)
    sign = np.where(at_end, -1.0, 1.0)
    return sign * (east / size)[row], sign * (north / size)[row]
