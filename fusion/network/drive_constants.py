"""What the passes of a drive say of its constants, each on its own: added up, taken off, and integrated out.

In the solution of a part of a network, the constants of a drive stay unknowns. Its passes outside speak of them too:
each of them alone, over a road of which nothing is known but that grades are small, never the drive's own posterior.
What other drives know of the roads outside is left unsaid, so this is never too much. It is what the whole drive says
less what it says inside.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from fusion.filters.symmetric_entries import SymmetricEntries
from fusion.network.equations import Blocks
from fusion.network.pass_factor import CONSTANT_SIGMA, CONSTANTS, NUISANCES, SETTINGS, PassFactor, symmetric
from fusion.network.road_beliefs import GRADE_SIGMA
from fusion.network.unknowns import DriveUnknowns
from fusion.types import Floats, Ints, Progress, no_progress

FREE_INFORMATION = 1e-6
"""Heights, and errors of height sensors, are free: a sigma of a kilometre (1/m^2)."""
ROUNDING = 1e-9
"""Of sums from which all is taken off again, less than this share is left."""


PASSES_AT_ONCE = 1 << 14
"""What they say is made of so many passes at once."""
WHOLE_UP_TO = 300
"""Constants of so many keys, of an hour and more, are stored as a whole triangle, as those of all drives once were."""
_ENTRIES = -1.0
"""The first number of what is stored as entries; the count of keys is that of a whole triangle."""


@dataclass(frozen=True, eq=False)
class ConstantsInformation:
    """Information (n, n) and vector (n,) over constants of a drive: ``keys`` (n, 2), ascending, are (kind, setting).

    Most of the information is 0: constants of a part of the drive have nothing to do with those of another part, and a
    long drive has tens of thousands.

    ``kind`` is the number in ``CONSTANTS``; the setting is 0 for constants that have none (``SETTINGS``).
    """

    keys: Ints
    information: SymmetricEntries
    vector: Floats

    @classmethod
    def nothing(cls) -> Self:
        """Of no pass."""
        return cls(np.empty((0, 2), np.int64), SymmetricEntries.of_dense(np.zeros((0, 0))), np.zeros(0))

    @classmethod
    def of_passes(cls, passes: Sequence[PassFactor], progress: Progress = no_progress) -> Self:
        """What passes of one drive say, each on its own."""
        total = cls.nothing()
        for first in range(0, len(passes), PASSES_AT_ONCE):
            progress("saving", first / len(passes))
            # of a long drive they are decoded where they are asked for
            portion = list(passes[first : first + PASSES_AT_ONCE])
            total = total + cls.of_marginals(portion, *marginals_of(portion))
        return total

    @classmethod
    def of_marginals(cls, passes: Sequence[PassFactor], said: Floats, right: Floats) -> Self:
        """The same of what ``marginals_of`` makes of the passes."""
        if not passes:
            return cls.nothing()
        setting = settings_of(passes)
        every = np.stack([np.broadcast_to(np.arange(len(CONSTANTS)), setting.shape), setting], axis=2)
        keys, number = _unique_keys(every.reshape(-1, 2))
        number = number.reshape(setting.shape)
        vector = np.asarray(np.bincount(number.ravel(), right.ravel(), len(keys)), float)
        one, a, b = np.nonzero(said)
        spoken = SymmetricEntries.of(len(keys), number[one, a], number[one, b], said[one, a, b])
        return cls(keys, spoken, vector)._at(np.flatnonzero(spoken.diagonal() > 0))

    def _at(self, rows: Ints) -> Self:
        """Those of these rows, ascending."""
        return type(self)(self.keys[rows], self.information.within(rows), self.vector[rows])

    def __add__(self, other: Self) -> Self:
        return self._with(other, 1.0)

    def __sub__(self, other: Self) -> Self:
        left = self._with(other, -1.0)
        # Of what only the other spoke, rounding is left; it would tie together what has nothing to do with each other.
        mine = np.searchsorted(numbers_of(left.keys), numbers_of(self.keys))
        before = np.zeros(len(left.keys))
        before[mine] = self.information.diagonal()
        return left._at(np.flatnonzero(left.information.diagonal() > ROUNDING * before))

    def widened(self, widening: float) -> Self:
        """The same of passes whose sigmas are ``widening`` times as large (``PassFactor.widened``)."""
        less = widening**-2.0
        return (
            self
            if widening == 1.0
            else type(self)(self.keys, self.information.times(less), less * self.vector)
        )

    def _with(self, other: Self, sign: float) -> Self:
        keys, where = _unique_keys(np.concatenate([self.keys, other.keys]))
        mine, its = where[: len(self.keys)], where[len(self.keys) :]
        a, b = self.information, other.information
        information = SymmetricEntries.of(
            len(keys),
            np.concatenate([mine[a.row], its[b.row]]),
            np.concatenate([mine[a.column], its[b.column]]),
            np.concatenate([a.value, sign * b.value]),
        )
        vector = np.zeros(len(keys))
        vector[mine] += self.vector
        vector[its] += sign * other.vector
        return type(self)(keys, information, vector)

    def onto(self, keys: Sequence[tuple[int, int]]) -> tuple[Floats, Floats]:
        """Information and vector over these constants; the others are integrated out, with what is believed of each."""
        at = {(kind, setting): k for k, (kind, setting) in enumerate(self.keys.tolist())}
        known = np.array([key in at for key in keys], bool)
        shared = np.array([at[key] for key in keys if key in at], np.int64)
        others = np.ones(len(self.keys), bool)
        others[shared] = False
        gone = np.flatnonzero(others)
        prior = np.array(CONSTANT_SIGMA)[self.keys[gone, 0]] ** -2.0
        lost, lost_right = self.information.integrated(gone, prior, shared, self.vector)
        information, vector = np.zeros((len(keys), len(keys))), np.zeros(len(keys))
        information[np.ix_(known, known)] = self.information.dense(shared, shared) - lost
        vector[known] = self.vector[shared] - lost_right
        return information, vector

    def encode(self) -> bytes:
        """As little-endian doubles: how many keys, keys, vector, upper triangle; of many keys ``_ENTRIES``, how many
        keys and entries, keys, vector, and rows, columns and values of the upper triangle's entries."""
        n, parts = len(self.keys), self.information
        if n <= WHOLE_UP_TO:
            upper = parts.dense(np.arange(n), np.arange(n))[np.triu_indices(n)]
            numbers = [np.array([n]), self.keys.ravel(), self.vector, upper]
        else:
            told = parts.row <= parts.column
            numbers = [np.array([_ENTRIES, n, np.count_nonzero(told)]), self.keys.ravel(), self.vector]
            numbers += [one[told] for one in (parts.row, parts.column, parts.value)]
        return np.concatenate(numbers).astype("<f8").tobytes()

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """The inverse of ``encode``, bit for bit."""
        values = np.frombuffer(data, "<f8").astype(np.float64)
        if values[0] != _ENTRIES:
            n = int(values[0])
            keys, vector, upper = np.split(values[1:], [2 * n, 3 * n])
            whole = SymmetricEntries.of_dense(symmetric(upper, n))
            return cls(keys.astype(np.int64).reshape(n, 2), whole, vector.copy())
        n, count = map(int, values[1:3])
        keys, vector, row, column, value = np.split(values[3:], np.cumsum([2 * n, n, count, count]))
        row, column = row.astype(np.int64), column.astype(np.int64)
        off = row != column
        information = SymmetricEntries.of(
            n,
            np.concatenate([row, column[off]]),
            np.concatenate([column, row[off]]),
            np.concatenate([value, value[off]]),
        )
        return cls(keys.astype(np.int64).reshape(n, 2), information, vector.copy())


def numbers_of(keys: Ints) -> Ints:
    """One number for each key (n, 2), in the order of the keys."""
    return np.asarray((keys[:, 0] << 40) + keys[:, 1])


def _unique_keys(keys: Ints) -> tuple[Ints, Ints]:
    """The different keys in ascending order, and which of them each is, shape (n,)."""
    _, first, which = np.unique(numbers_of(keys), return_index=True, return_inverse=True)
    return keys[first], which.ravel()


def settings_of(passes: Sequence[PassFactor]) -> Ints:
    """The setting of each of the k ``CONSTANTS`` of each pass, shape (m, k); 0 of those that have none."""
    setting = np.zeros((len(passes), len(CONSTANTS)), np.int64)
    for kind, name in SETTINGS.items():
        setting[:, kind] = [getattr(p, name) for p in passes]
    return setting


def marginals_of(passes: Sequence[PassFactor]) -> tuple[Floats, Floats]:
    """Information (m, k, k) and vector (m, k) of each pass by itself over the k ``CONSTANTS``."""
    count = len(CONSTANTS)
    information, vector = np.empty((len(passes), count, count)), np.empty((len(passes), count))
    size = np.array([len(p.vector) for p in passes])
    for n in np.unique(size):
        mine = np.flatnonzero(size == n)
        information[mine], vector[mine] = _marginals([passes[k] for k in mine.tolist()])
    return information, vector


def _marginals(passes: Sequence[PassFactor]) -> tuple[Floats, Floats]:
    """``marginals_of`` passes over equally many knots."""
    said, right = np.array([p.information for p in passes]), np.array([p.vector for p in passes])
    n = said.shape[1]
    knots, count = n - NUISANCES, len(CONSTANTS)
    nuisances = np.arange(knots, knots + count)
    gone = np.concatenate([np.arange(knots), np.arange(knots + count, n)])
    prior = np.full(len(gone), FREE_INFORMATION)
    prior[1:knots:2] = GRADE_SIGMA**-2
    inside = said[:, gone[:, None], gone] + np.diag(prior)
    across = said[:, gone[:, None], nuisances]
    solved = np.linalg.solve(inside, np.concatenate([across, right[:, gone, None]], axis=2))
    back = across.transpose(0, 2, 1) @ solved
    information = said[:, nuisances[:, None], nuisances] - back[:, :, :-1]
    return 0.5 * (information + information.transpose(0, 2, 1)), right[:, nuisances] - back[:, :, -1]


def outside_blocks(
    said: Mapping[int, ConstantsInformation], unknowns: Mapping[int, DriveUnknowns]
) -> list[Blocks]:
    """The equations of all drives that have passes elsewhere."""
    out = []
    for name in sorted(set(said) & set(unknowns)):
        spoken = set(map(tuple, said[name].keys.tolist()))
        keys = [key for key in unknowns[name].keys if key in spoken]
        information, vector = said[name].onto(keys)
        variables = np.array([[unknowns[name].keys[key] for key in keys]], np.int64)
        out.append(Blocks(variables, information[None], vector[None], np.ones(1)))
    return [b for b in out if b.variables.size]
