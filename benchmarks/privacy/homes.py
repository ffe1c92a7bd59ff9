"""How homes are named: places are chosen that are within reach of as many likely homes as can be.

Everybody knows where houses are, so every quiet place may be one. Where chains of driven roads end, somebody is the
likelier to live: there, or behind it, where ends of drives are left out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from fusion.types import Bools, Floats
from privacy.city import City
from privacy.scoring import HOME_M

END_CUT_M = (150.0, 400.0)
"""What the service leaves out around ends of drives, as its documents say."""
BEHIND = 0.3
"""Homes to be expected behind an end of what is left: many ends are where a road has too few drivers."""
BUSY = 0.1
"""What the end of a chain on a busy road is worth, beside one in a quiet street: shops and work are there."""


def behind_tips(city: City, seen: Sequence[Bools], *, trimmed: bool) -> Floats:
    """How many homes the ends of chains in these sets of rows suggest at each node, (nodes,)."""
    total = np.zeros(len(city.place))
    quiet = np.zeros(len(total), bool)
    quiet[city.quiet] = True
    ways = city.ways(city.length_m)
    for rows in seen:
        mass = np.zeros(len(total))
        mine = np.flatnonzero(rows)
        driven = np.zeros(len(total), bool)
        driven[city.start[mine]] = driven[city.end[mine]] = True
        for tip, _ in city.tips(mine.tolist()):
            if not trimmed:
                mass[tip] += 1.0 if quiet[tip] else BUSY
                continue
            away = ways.tree(tip, END_CUT_M[1])[0]
            behind = np.flatnonzero((away >= END_CUT_M[0]) & (away <= END_CUT_M[1]) & quiet & ~driven)
            mass[behind] += BEHIND / max(len(behind), 1)
        # The same end in several sets is one home.
        total = np.maximum(total, mass)
    return total


def name_homes(city: City, mass: Floats, count: int, reach_m: float = HOME_M) -> Floats:
    """So many places (n, 2), m: each next one has most homes within reach that no former one has."""
    nodes = np.union1d(city.quiet, np.flatnonzero(mass))
    usual = np.where(np.isin(nodes, city.quiet), count / len(city.quiet), 0.0)
    left = usual + mass[nodes]
    tree = cKDTree(city.place[nodes])
    reach = tree.sparse_distance_matrix(tree, reach_m, output_type="coo_matrix").tocoo()
    shape = (len(nodes), len(nodes))
    near = sparse.csr_matrix((np.ones(reach.nnz, np.float32), (reach.row, reach.col)), shape=shape)
    near = (near + sparse.eye(len(nodes), format="csr", dtype=np.float32)).tocsr()
    named = []
    for _ in range(count):
        best = int(np.argmax(near @ left))
        named.append(city.place[nodes[best]])
        # A name counts for one home only: the likeliest within reach is taken for it.
        within = near.indices[near.indptr[best] : near.indptr[best + 1]]
        left[within] *= max(0.0, 1.0 - 1.0 / max(float(left[within].sum()), 1.0))
    return np.array(named).reshape(-1, 2)
