"""How drives are named from roads of which it is known only that somebody drove there: attacker and guesser name by the
same method, they only know different things.

Ends of chains, places along them and homes near by are taken for ends of drives. The quickest ways between them are
candidates. One after the other that is named which explains most of what is not yet explained, and claims least that
is not to be seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from fusion.types import Floats, Ints
from privacy.city import City
from privacy.homes import behind_tips

DETOUR = 4.0
"""A road that nobody is known to have driven costs so much more."""
UNSEEN = 1.0
"""What a named metre that is not to be seen costs, in metres that are explained."""
MOST_ENDS = 140
APART_M = 120.0
"""Ends nearer to each other are one."""
SHORTEST_M = 1_000.0
AGAIN = 0.3
"""What a metre is worth that is explained already, by each time that it is."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is known of one time: on which rows how many drives there were at least, ``demand`` (rows,)."""

    demand: Floats
    drives: int
    """So many are to be named."""


@dataclass(frozen=True, eq=False)
class Known:
    """All that somebody goes by who names drives: evidence of one or several times."""

    evidence: Sequence[Evidence]
    trimmed: bool
    """Whether ends of drives are left out in it."""

    @property
    def demand(self) -> Floats:
        """Of all times together."""
        return np.asarray(np.sum([one.demand for one in self.evidence], axis=0))


def name_drives(city: City, known: Known, rng: np.random.Generator) -> list[Ints]:
    """As many sets of rows as there were drives."""
    paths = candidates(city, known, rng)
    return [rows for one in known.evidence for rows in _explain(city.length_m, one, paths)]


def candidates(city: City, known: Known, rng: np.random.Generator) -> list[Ints]:
    """Quickest ways between plausible ends, as rows in ascending order."""
    ends = _ends(city, known, rng)
    ways = city.ways(city.seconds * np.where(known.demand > 0, 1.0, DETOUR))
    found = [rows for one in ends.tolist() for rows in ways.fan(one, ends)]
    return [np.unique(rows) for rows in found if len(rows) and city.metres(rows) >= SHORTEST_M]


def _ends(city: City, known: Known, rng: np.random.Generator) -> Ints:
    """Nodes in which drives may begin or end: homes behind tips, the tips, and places along what is seen."""
    seen = np.flatnonzero(known.demand)
    mass = behind_tips(city, [known.demand > 0], trimmed=known.trimmed)
    homes = np.argsort(-mass, kind="stable")[: np.count_nonzero(mass)]
    tips = rng.permutation([tip for tip, _ in city.tips(seen.tolist())])
    along = rng.choice(city.end[seen], min(len(seen), MOST_ENDS), replace=False)
    kept: list[int] = []
    for nodes, most in ((homes, MOST_ENDS // 2), (tips, 3 * MOST_ENDS // 4), (along, MOST_ENDS)):
        for node in nodes:
            apart = np.linalg.norm(city.place[kept] - city.place[node], axis=1)
            if len(kept) < most and (apart > APART_M).all():
                kept.append(int(node))
    return np.array(kept, np.int64)


def _explain(length_m: Floats, evidence: Evidence, paths: Sequence[Ints]) -> list[Ints]:
    """Choose among paths, one after the other; where all is explained, it is explained once more."""
    starts = np.concatenate([[0], np.cumsum([len(p) for p in paths])])
    columns = np.concatenate([*paths, np.empty(0, np.int64)])
    shape = (len(paths), len(length_m))
    members = sparse.csr_matrix((np.ones(starts[-1], np.float32), columns, starts), shape=shape)
    length = length_m.astype(np.float32)
    unseen = UNSEEN * (members @ np.where(evidence.demand > 0, 0, length))
    left, free = evidence.demand.copy(), np.ones(len(paths), bool)
    named: list[Ints] = []
    for _ in range(min(evidence.drives, len(paths))):
        wanted = np.where(evidence.demand > 0, AGAIN ** np.maximum(1 - left, 0), 0)
        worth = np.where(free, members @ (length * wanted.astype(np.float32)) - unseen, -np.inf)
        best = int(np.argmax(worth))
        named.append(paths[best])
        left[paths[best]] -= 1
        free[best] = False
    return named
