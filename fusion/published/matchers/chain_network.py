"""Roads between junctions for the matchers that follow them: the places near each position, and back to segments."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fusion.matching.candidates import Likelihoods, Seen, find_candidates
from fusion.matching.chains import ChainGraph, build_chains
from fusion.matching.lattice import Candidates
from fusion.published.matchers.base import PointMatches, Samples, placed, unmatched
from fusion.roads.grid import SegmentGrid
from fusion.roads.network import RoadNetwork
from fusion.types import Floats, Ints


class ChainNetwork(NamedTuple):
    """A network and its chains, with their index."""

    network: RoadNetwork
    graph: ChainGraph
    grid: SegmentGrid

    @classmethod
    def of(cls, network: RoadNetwork) -> ChainNetwork:
        """Contract a network that has segments."""
        return cls(network, *build_chains(network))

    def places(
        self, samples: Samples, radius_m: float, sigma_m: float, turn: float = 0.0, turn_cap: float = 1.0
    ) -> Candidates:
        """Where each sample may be: the nearest places of each road about it, in each direction of driving.

        All positions must be known. The cost of a place is d^2 / (2 sigma^2), and where ``turn`` is above 0 and
        the heading known turn (1 - cos a), softly bounded by ``turn_cap``, for its angle a to the direction.
        """
        reach = np.full(len(samples), sigma_m), np.full(len(samples), radius_m)
        seen = Seen(samples.x_m, samples.y_m, samples.heading_rad, *reach)
        return find_candidates(self.graph, self.grid, seen, Likelihoods(turn, turn_cap, 0.0, 0.0))

    def matches(self, n: int, rows: Ints, edge: Ints, at_m: Floats) -> PointMatches:
        """The matches of n samples, of which ``rows`` lie on directed chains ``edge`` (-1: none) at ``at_m``."""
        rows, edge, at_m = rows[edge >= 0], edge[edge >= 0], at_m[edge >= 0]
        if not len(rows):
            return unmatched(n)
        g = self.graph
        chain, onward = edge >> 1, edge % 2 == 0
        along = np.where(onward, at_m, g.length_m[chain] - at_m)
        # Distances begin anew on every chain: laid end to end they can be searched.
        before = np.concatenate([[0.0], np.cumsum(g.length_m)])
        rank = np.searchsorted(g.cum_m + before[g.chain], along + before[chain], side="right") - 1
        rank = np.clip(rank, g.first[chain], g.first[chain + 1] - 1)
        length = self.network.length_m[g.segment[rank]]
        share = np.clip((along - g.cum_m[rank]) / np.where(length > 0, length, 1.0), 0.0, 1.0)
        flipped = g.flipped[rank]
        segment, at, forward = np.full(n, -1, np.int64), np.full(n, np.nan), np.zeros(n, np.bool_)
        segment[rows], at[rows] = g.segment[rank], np.where(flipped, 1.0 - share, share)
        forward[rows] = onward != flipped
        return placed(self.network, segment, at, forward)
