"""Every pass of a drive condensed by itself, all of a drive at once.

As ``CondensedPasses.of_drive`` condenses one pass that counts once, to rounding; in a tenth of the time, for whoever
condenses all that there is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fusion.network.condensed import (
    PRIOR_MEAN,
    PRIOR_OF_NUISANCES,
    CondensedPasses,
    believed_share,
    covered_parts,
)
from fusion.network.drive_constants import ROUNDING, ConstantsInformation, marginals, numbers_of
from fusion.network.pass_factor import CONSTANT_SIGMA, CONSTANTS, EAST, NORTH, NUISANCES, SETTINGS, PassFactor
from fusion.types import Floats, Ints

_PRIOR = np.array(CONSTANT_SIGMA) ** -2.0
PARTS_KINDS = (EAST, NORTH)
"""Constants of a part of a drive; a drive of an hour has a hundred parts."""


@dataclass(frozen=True, eq=False)
class _Spoken:
    """What a drive says of the constants that one of its parts has, those of its other parts integrated out."""

    keys: Ints
    information: Floats
    vector: Floats
    before: Floats
    """The diagonal of what all passes say, nothing integrated out."""


class _Drive:
    """What a drive says of its constants, part by part: of a part's own constants only the passes in it speak."""

    def __init__(self, drive: ConstantsInformation) -> None:
        self._drive = drive
        of_part = np.isin(drive.keys[:, 0], PARTS_KINDS)
        self._common = np.flatnonzero(~of_part)
        self._rows = {
            int(part): np.flatnonzero(of_part & (drive.keys[:, 1] == part))
            for part in np.unique(drive.keys[of_part, 1])
        }
        self._out = {part: self._integrated(rows) for part, rows in self._rows.items()}
        size = len(self._common)
        nothing = np.zeros((size, size + 1))
        self._all_out = sum(self._out.values(), nothing)
        self._known: dict[int, _Spoken] = {}
        self._places: dict[tuple[int, int], Ints] = {}

    def _integrated(self, rows: Ints) -> Floats:
        """What goes of the common constants, and of their vector, when those of a part are integrated out."""
        d = self._drive
        inside = d.information[np.ix_(rows, rows)] + np.diag(_PRIOR[d.keys[rows, 0]])
        across = d.information[np.ix_(rows, self._common)]
        return np.asarray(across.T @ np.linalg.solve(inside, np.column_stack([across, d.vector[rows]])))

    def about(self, part: int) -> _Spoken:
        """What it says to a pass of this part."""
        if part not in self._known:
            d = self._drive
            rows = np.sort(np.concatenate([self._common, self._rows.get(part, np.empty(0, np.int64))]))
            common = np.flatnonzero(np.isin(rows, self._common))
            information, vector = d.information[np.ix_(rows, rows)].copy(), d.vector[rows].copy()
            out = self._all_out - self._out.get(part, 0.0)
            information[np.ix_(common, common)] -= out[:, :-1]
            vector[common] -= out[:, -1]
            before = np.diagonal(d.information)[rows]
            self._known[part] = _Spoken(d.keys[rows], information, vector, before)
        return self._known[part]

    def places(self, one: PassFactor) -> Ints:
        """Where among the keys of its part those of the pass are, shape (``CONSTANTS``,); -1 where they are not."""
        setting = (one.mount, one.place)
        if setting not in self._places:
            self._places[setting] = _places(one, self.about(one.place))
        return self._places[setting]


def condense_each(
    passes: Sequence[PassFactor], drive: ConstantsInformation, count: int, lengths_m: Sequence[float]
) -> list[CondensedPasses]:
    """What each of these passes of one drive says, in their order.

    ``drive`` is what all ``count`` passes of the drive, these among them, say of its constants; ``lengths_m`` are what
    the knots of each pass assume.
    """
    share, whole = believed_share(count), _Drive(drive)
    groups: dict[tuple[int, bytes, bytes], list[int]] = {}
    at = [whole.places(one) for one in passes]
    for k, one in enumerate(passes):
        groups.setdefault((len(one.vector), one.used.tobytes(), at[k].tobytes()), []).append(k)
    made: dict[int, CondensedPasses] = {}
    for rows in groups.values():
        alike = [passes[k] for k in rows]
        spoken = [whole.about(one.place) for one in alike]
        said, right = _condense(alike, spoken, share, at[rows[0]])
        for k, one, information, vector in zip(rows, alike, said, right, strict=True):
            rough, covered = float(np.log(one.roughness)), covered_parts(one, lengths_m[k])
            made[k] = CondensedPasses(
                information, vector, float(max(one.rows, 1)), rough, covered, 1, 1, one.observations
            )
    return [made[k] for k in range(len(passes))]


def _places(one: PassFactor, spoken: _Spoken) -> Ints:
    setting = [getattr(one, SETTINGS[kind]) if kind in SETTINGS else 0 for kind in range(len(CONSTANTS))]
    wanted = numbers_of(np.stack([np.arange(len(CONSTANTS)), np.array(setting, np.int64)], axis=1))
    known = numbers_of(spoken.keys)
    at = np.searchsorted(known, wanted)
    return np.where(np.append(known, -1)[at] == wanted, at, -1)


def _condense(
    alike: Sequence[PassFactor], spoken: Sequence[_Spoken], share: float, at: Ints
) -> tuple[Floats, Floats]:
    """Information (m, n, n) and vector (m, n) of m passes over n knots each, which use the same nuisances."""
    knots = len(alike[0].vector) - NUISANCES
    used = np.flatnonzero(alike[0].used)
    constants = used[used < len(CONSTANTS)]
    known, right = _elsewhere(alike, spoken, at, constants)
    gone, c = knots + used, len(constants)
    information = np.array([p.information for p in alike])
    vector = np.array([p.vector for p in alike])
    inside = information[:, gone[:, None], gone] + np.diag(PRIOR_OF_NUISANCES[used])
    value = vector[:, gone] + (PRIOR_OF_NUISANCES * PRIOR_MEAN)[used]
    inside[:, :c, :c] += share * known
    value[:, :c] += share * right
    across = information[:, gone[:, None], np.arange(knots)]
    taken = _taken(inside, across, value)
    said = information[:, :knots, :knots] - taken[:, :, :-1]
    return 0.5 * (said + said.transpose(0, 2, 1)), vector[:, :knots] - taken[:, :, -1]


def _elsewhere(
    alike: Sequence[PassFactor], spoken: Sequence[_Spoken], at: Ints, constants: Ints
) -> tuple[Floats, Floats]:
    """Information (m, c, c) and vector (m, c) over these constants of all passes of the drive but each one itself."""
    m, keys = len(alike), spoken[0].keys
    left = np.array([one.information for one in spoken])
    vector = np.array([one.vector for one in spoken])
    own, own_vector = marginals(alike, np.ones(m))
    mine = np.flatnonzero(at >= 0)
    left[:, at[mine][:, None], at[mine]] -= own[:, mine[:, None], mine]
    vector[:, at[mine]] -= own_vector[:, mine]
    # What only the pass itself spoke of is unknown elsewhere; rounding would tie it to the others.
    informed = np.einsum("mkk->mk", left) > ROUNDING * np.array([one.before for one in spoken])
    left *= informed[:, :, None] & informed[:, None, :]
    vector *= informed
    place = np.flatnonzero(at[constants] >= 0)
    shared = at[constants[place]]
    gone = np.setdiff1d(np.arange(len(keys)), shared)
    inside = left[:, gone[:, None], gone] + np.diag(_PRIOR[keys[gone, 0]])
    taken = _taken(inside, left[:, gone[:, None], shared], vector[:, gone])
    known, right = np.zeros((m, len(constants), len(constants))), np.zeros((m, len(constants)))
    known[:, place[:, None], place] = left[:, shared[:, None], shared] - taken[:, :, :-1]
    right[:, place] = vector[:, shared] - taken[:, :, -1]
    return known, right


def _taken(inside: Floats, across: Floats, value: Floats) -> Floats:
    """What goes of information and vector when the unknowns ``inside`` are integrated out."""
    solved = np.linalg.solve(inside, np.concatenate([across, value[:, :, None]], axis=2))
    return np.asarray(across.transpose(0, 2, 1) @ solved)
