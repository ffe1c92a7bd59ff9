"""What the attacker named beside what was: right names, each truth counted once, with intervals over owners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import maximum_bipartite_matching

from fusion.types import Bools, Floats, Ints

F1_LEAST = 0.7
"""A named drive is right from here on: twice what it has in common with the true one by both lengths."""
HOME_M = 200.0
DOOR_M = 50.0
"""A named home is right within so much of a true one; strictly, within ``DOOR_M``."""
DRAWS = 2000
LEVEL = (2.5, 97.5)


@dataclass(frozen=True)
class Share:
    """A share, and its interval of 95 %."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{100 * self.value:.1f} ({100 * self.low:.1f} to {100 * self.high:.1f})"


def f1_scores(named: Sequence[Ints], true: Sequence[Ints], length_m: Floats) -> sparse.csr_matrix:
    """F1 by length of each named set of rows with each true one, (n, m); 0 where they have nothing in common."""
    one, other = _members(named, len(length_m)), _members(true, len(length_m))
    common = (one.multiply(length_m[None, :]).tocsr() @ other.T).tocoo()
    total = (one @ length_m)[common.row] + (other @ length_m)[common.col]
    return sparse.csr_matrix((2 * common.data / total, (common.row, common.col)), shape=common.shape)


def right_drives(named: Sequence[Ints], true: Sequence[Ints], length_m: Floats) -> Bools:
    """Which of the true drives (m,) were named, where a name counts for one of them only."""
    scores = f1_scores(named, true, length_m)
    return _matched(scores, scores.data >= F1_LEAST)


def right_homes(named_m: Floats, true_m: Floats, within_m: float = HOME_M) -> Bools:
    """Which of the true homes (m, 2) were named by one of (n, 2), where a name counts for one of them only."""
    if not len(named_m):
        return np.zeros(len(true_m), bool)
    apart = np.linalg.norm(named_m[:, None] - true_m[None], axis=2)
    near = sparse.csr_matrix(apart <= within_m, dtype=float)
    return _matched(near, near.data > 0)


def share(right: Bools, owner: Ints, rng: np.random.Generator) -> Share:
    """The share that is right, drawn anew owner by owner."""
    drawn = _drawn([right.astype(float)], owner, rng)[0]
    return Share(float(right.mean()), *map(float, np.percentile(drawn, LEVEL)))


def difference(one: Bools, other: Bools, owner: Ints, rng: np.random.Generator) -> Share:
    """By how much more of ``one`` is right, of the same truths, drawn anew owner by owner."""
    mine, others = _drawn([one.astype(float), other.astype(float)], owner, rng)
    value = float(one.mean() - other.mean())
    return Share(value, *map(float, np.percentile(mine - others, LEVEL)))


def _members(sets: Sequence[Ints], size: int) -> sparse.csr_matrix:
    each = [np.unique(np.asarray(rows, np.int64)) for rows in sets]
    starts = np.concatenate([[0], np.cumsum([len(rows) for rows in each])])
    columns = np.concatenate([*each, np.empty(0, np.int64)])
    return sparse.csr_matrix((np.ones(len(columns)), columns, starts), shape=(len(each), size))


def _matched(pairs: sparse.csr_matrix, good: Bools) -> Bools:
    """Which columns are matched by a row of their own, of the pairs that are good."""
    kept = pairs.copy()
    kept.data = np.where(good, 1.0, 0.0)
    kept.eliminate_zeros()
    return np.asarray(maximum_bipartite_matching(kept, perm_type="row") >= 0)


def _drawn(values: Sequence[Floats], owner: Ints, rng: np.random.Generator) -> list[Floats]:
    """Means of values (m,) over owners drawn with replacement, (draws,) each."""
    people = int(owner.max()) + 1
    weight = rng.multinomial(people, np.full(people, 1 / people), DRAWS)
    count = np.bincount(owner, minlength=people)
    return [(weight @ np.bincount(owner, v, people)) / np.maximum(weight @ count, 1) for v in values]
