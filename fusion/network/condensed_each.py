"""Every pass of some drives condensed by itself, all at once.

As ``CondensedPasses.of_drive`` condenses one pass that counts once, to rounding; in a twentieth of the time, for
whoever condenses all that there is.
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
from fusion.network.drive_constants import ROUNDING, ConstantsInformation, numbers_of, settings_of
from fusion.network.pass_factor import CONSTANT_SIGMA, CONSTANTS, EAST, NORTH, NUISANCES, PassFactor
from fusion.types import Floats, Ints

_PRIOR = np.array(CONSTANT_SIGMA) ** -2.0
PARTS_KINDS = (EAST, NORTH)
"""Constants of a part of a drive; a drive of an hour has a hundred parts."""


@dataclass(frozen=True, eq=False)
class DrivePasses:
    """Some passes of a drive, and what is known of it."""

    passes: Sequence[PassFactor]
    lengths_m: Sequence[float]
    """What the knots of each pass assume."""
    said: tuple[Floats, Floats]
    """What each pass says of constants by itself (``marginals_of``)."""
    constants: ConstantsInformation
    """What all passes of the drive, these among them, say of its constants."""
    count: int
    """How many they are."""


@dataclass(frozen=True, eq=False)
class _Spoken:
    """What a drive says of the constants that one of its parts has, those of its other parts integrated out."""

    keys: Ints
    information: Floats
    vector: Floats
    before: Floats
    """The diagonal of what all passes say, nothing integrated out."""


@dataclass(frozen=True, eq=False)
class _Setting:
    """What a drive says to the passes in one setting, and where among its keys those of such a pass are."""

    spoken: _Spoken
    at: Ints
    """Shape (``CONSTANTS``,); -1 where a constant of the pass is not among them."""
    alike: bytes
    """The same for settings whose keys stand for the same, whichever drive they are of."""


@dataclass(frozen=True, eq=False)
class _Pass:
    """One pass to be condensed."""

    factor: PassFactor
    length_m: float
    said: Floats
    right: Floats
    setting: _Setting
    share: float

    @property
    def alike(self) -> tuple[int, bytes, bytes]:
        """The same for passes that are condensed together."""
        return len(self.factor.vector), self.factor.used.tobytes(), self.setting.alike


class _Drive:
    """What a drive says of its constants, part by part: of a part's own constants only the passes in it speak."""

    def __init__(self, drive: ConstantsInformation) -> None:
        self._drive, self._diagonal = drive, drive.information.diagonal()
        of_part = np.isin(drive.keys[:, 0], PARTS_KINDS)
        self._common = np.flatnonzero(~of_part)
        parts, own = np.flatnonzero(of_part), drive.keys[of_part, 1]
        order = np.argsort(own, kind="stable")
        names, first = np.unique(own[order], return_index=True)
        self._rows = dict(zip(names.tolist(), np.split(parts[order], first[1:]), strict=False))
        self._out = {part: self._integrated(rows) for part, rows in self._rows.items()}
        size = len(self._common)
        nothing = np.zeros((size, size + 1))
        self._all_out = sum(self._out.values(), nothing)
        self._known: dict[int, _Spoken] = {}
        self._settings: dict[tuple[int, int], _Setting] = {}

    def _integrated(self, rows: Ints) -> Floats:
        """What goes of the common constants, and of their vector, when those of a part are integrated out."""
        d = self._drive
        inside = d.information.dense(rows, rows) + np.diag(_PRIOR[d.keys[rows, 0]])
        across = d.information.dense(rows, self._common)
        return np.asarray(across.T @ np.linalg.solve(inside, np.column_stack([across, d.vector[rows]])))

    def _about(self, part: int) -> _Spoken:
        """What it says to a pass of this part."""
        if part not in self._known:
            d = self._drive
            rows = np.sort(np.concatenate([self._common, self._rows.get(part, np.empty(0, np.int64))]))
            common = np.flatnonzero(np.isin(rows, self._common))
            information, vector = d.information.dense(rows, rows), d.vector[rows].copy()
            out = self._all_out - self._out.get(part, 0.0)
            information[np.ix_(common, common)] -= out[:, :-1]
            vector[common] -= out[:, -1]
            before = self._diagonal[rows]
            self._known[part] = _Spoken(d.keys[rows], information, vector, before)
        return self._known[part]

    def setting(self, one: PassFactor) -> _Setting:
        """What it says to passes in the setting of this one."""
        name = (one.mount, one.place)
        if name not in self._settings:
            spoken = self._about(one.place)
            at = _places(one, spoken)
            alike = spoken.keys[:, 0].tobytes() + at.tobytes()
            self._settings[name] = _Setting(spoken, at, alike)
        return self._settings[name]


def condense_each(drives: Sequence[DrivePasses]) -> list[list[CondensedPasses]]:
    """What each pass of each drive says, in their order."""
    every = [one for drive in drives for one in _passes_of(drive)]
    groups: dict[tuple[int, bytes, bytes], list[int]] = {}
    for k, one in enumerate(every):
        groups.setdefault(one.alike, []).append(k)
    made: dict[int, CondensedPasses] = {}
    for rows in groups.values():
        alike = [every[k] for k in rows]
        factors = [one.factor for one in alike]
        covered = covered_parts(factors, [one.length_m for one in alike])
        for k, factor, *values in zip(rows, factors, *_condense(alike), covered, strict=True):
            made[k] = _condensed(factor, *values)
    numbers = iter(range(len(every)))
    return [[made[next(numbers)] for _ in drive.passes] for drive in drives]


def _passes_of(drive: DrivePasses) -> list[_Pass]:
    whole, share = _Drive(drive.constants), believed_share(drive.count)
    return [
        _Pass(factor, length_m, said, right, whole.setting(factor), share)
        for factor, length_m, said, right in zip(drive.passes, drive.lengths_m, *drive.said, strict=True)
    ]


def _condensed(one: PassFactor, information: Floats, vector: Floats, covered: Floats) -> CondensedPasses:
    rough = float(np.log(one.roughness))
    return CondensedPasses(
        information, vector, float(max(one.rows, 1)), rough, covered, 1, 1, one.observations
    )


def _places(one: PassFactor, spoken: _Spoken) -> Ints:
    wanted = numbers_of(np.stack([np.arange(len(CONSTANTS)), settings_of([one])[0]], axis=1))
    known = numbers_of(spoken.keys)
    at = np.searchsorted(known, wanted)
    return np.where(np.append(known, -1)[at] == wanted, at, -1)


def _condense(alike: Sequence[_Pass]) -> tuple[Floats, Floats]:
    """Information (m, n, n) and vector (m, n) of m passes over n knots each, which use the same nuisances."""
    first = alike[0].factor
    knots = len(first.vector) - NUISANCES
    used = np.flatnonzero(first.used)
    constants = used[used < len(CONSTANTS)]
    known, right = _elsewhere(alike, constants)
    gone, c = knots + used, len(constants)
    information = np.array([p.factor.information for p in alike])
    vector = np.array([p.factor.vector for p in alike])
    share = np.array([p.share for p in alike])[:, None]
    inside = information[:, gone[:, None], gone] + np.diag(PRIOR_OF_NUISANCES[used])
    value = vector[:, gone] + (PRIOR_OF_NUISANCES * PRIOR_MEAN)[used]
    inside[:, :c, :c] += share[:, :, None] * known
    value[:, :c] += share * right
    across = information[:, gone[:, None], np.arange(knots)]
    taken = _taken(inside, across, value)
    said = information[:, :knots, :knots] - taken[:, :, :-1]
    return 0.5 * (said + said.transpose(0, 2, 1)), vector[:, :knots] - taken[:, :, -1]


def _elsewhere(alike: Sequence[_Pass], constants: Ints) -> tuple[Floats, Floats]:
    """Information (m, c, c) and vector (m, c) over these constants of all passes of the drive but each one itself."""
    m, keys, at = len(alike), alike[0].setting.spoken.keys, alike[0].setting.at
    left = np.array([p.setting.spoken.information for p in alike])
    vector = np.array([p.setting.spoken.vector for p in alike])
    mine = np.flatnonzero(at >= 0)
    left[:, at[mine][:, None], at[mine]] -= np.array([p.said for p in alike])[:, mine[:, None], mine]
    vector[:, at[mine]] -= np.array([p.right for p in alike])[:, mine]
    # What only the pass itself spoke of is unknown elsewhere; rounding would tie it to the others.
    informed = np.einsum("mkk->mk", left) > ROUNDING * np.array([p.setting.spoken.before for p in alike])
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
