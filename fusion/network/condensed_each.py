"""Every pass of a drive condensed by itself, all of a drive at once.

As ``CondensedPasses.of_drive`` condenses one pass that counts once, to rounding; in a tenth of the time, for whoever
condenses all that there is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fusion.network.condensed import (
    PRIOR_MEAN,
    PRIOR_OF_NUISANCES,
    CondensedPasses,
    believed_share,
    covered_parts,
)
from fusion.network.drive_constants import ROUNDING, ConstantsInformation, marginals, numbers_of
from fusion.network.pass_factor import CONSTANT_SIGMA, CONSTANTS, NUISANCES, SETTINGS, PassFactor
from fusion.types import Floats, Ints


def condense_each(
    passes: Sequence[PassFactor], drive: ConstantsInformation, count: int, lengths_m: Sequence[float]
) -> list[CondensedPasses]:
    """What each of these passes of one drive says, in their order.

    ``drive`` is what all ``count`` passes of the drive, these among them, say of its constants; ``lengths_m`` are what
    the knots of each pass assume.
    """
    share, at = believed_share(count), _places(passes, drive)
    groups: dict[tuple[int, bytes, bytes], list[int]] = {}
    for k, one in enumerate(passes):
        groups.setdefault((len(one.vector), one.used.tobytes(), (at[k] >= 0).tobytes()), []).append(k)
    made: dict[int, CondensedPasses] = {}
    for rows in groups.values():
        alike = [passes[k] for k in rows]
        for k, one, said, right in zip(rows, alike, *_condense(alike, drive, share, at[rows]), strict=True):
            rough, covered = float(np.log(one.roughness)), covered_parts(one, lengths_m[k])
            made[k] = CondensedPasses(
                said, right, float(max(one.rows, 1)), rough, covered, 1, 1, one.observations
            )
    return [made[k] for k in range(len(passes))]


def _places(passes: Sequence[PassFactor], drive: ConstantsInformation) -> Ints:
    """Where among the drive's keys those of each pass are, shape (m, ``CONSTANTS``); -1 where they are not."""
    keys = np.zeros((len(passes), len(CONSTANTS), 2), np.int64)
    keys[:, :, 0] = np.arange(len(CONSTANTS))
    for kind, name in SETTINGS.items():
        keys[:, kind, 1] = [getattr(p, name) for p in passes]
    known, wanted = numbers_of(drive.keys), numbers_of(keys.reshape(-1, 2))
    at = np.searchsorted(known, wanted)
    there = np.append(known, -1)[at] == wanted
    return np.where(there, at, -1).reshape(len(passes), len(CONSTANTS))


def _condense(
    alike: Sequence[PassFactor], drive: ConstantsInformation, share: float, at: Ints
) -> tuple[Floats, Floats]:
    """Information (m, n, n) and vector (m, n) of m passes over n knots each, which use the same nuisances."""
    knots = len(alike[0].vector) - NUISANCES
    used = np.flatnonzero(alike[0].used)
    constants = used[used < len(CONSTANTS)]
    known, right = _elsewhere(alike, drive, at, constants)
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
    alike: Sequence[PassFactor], drive: ConstantsInformation, at: Ints, constants: Ints
) -> tuple[Floats, Floats]:
    """Information (m, c, c) and vector (m, c) over these constants of all passes of the drive but each one itself."""
    m, size, each = len(alike), len(drive.keys), np.arange(len(alike))
    left = np.repeat(drive.information[None], m, axis=0)
    vector = np.repeat(drive.vector[None], m, axis=0)
    own, own_vector = marginals(alike, np.ones(m))
    spoken = np.flatnonzero(at[0] >= 0)
    rows = at[:, spoken]
    left[each[:, None, None], rows[:, :, None], rows[:, None, :]] -= own[:, spoken[:, None], spoken]
    vector[each[:, None], rows] -= own_vector[:, spoken]
    # What only the pass itself spoke of is unknown elsewhere; rounding would tie it to the others.
    informed = np.einsum("mkk->mk", left) > ROUNDING * np.diagonal(drive.information)
    left *= informed[:, :, None] & informed[:, None, :]
    vector *= informed
    place = np.flatnonzero(at[0, constants] >= 0)
    shared = at[:, constants[place]]
    others = np.ones((m, size), bool)
    others[each[:, None], shared] = False
    gone = np.nonzero(others)[1].reshape(m, size - len(place))
    inside = left[each[:, None, None], gone[:, :, None], gone[:, None, :]]
    prior = np.array(CONSTANT_SIGMA)[drive.keys[gone, 0]] ** -2.0
    inside += prior[:, :, None] * np.eye(gone.shape[1])
    across = left[each[:, None, None], gone[:, :, None], shared[:, None, :]]
    taken = _taken(inside, across, vector[each[:, None], gone])
    known, right = np.zeros((m, len(constants), len(constants))), np.zeros((m, len(constants)))
    both = left[each[:, None, None], shared[:, :, None], shared[:, None, :]]
    known[:, place[:, None], place] = both - taken[:, :, :-1]
    right[:, place] = vector[each[:, None], shared] - taken[:, :, -1]
    return known, right


def _taken(inside: Floats, across: Floats, value: Floats) -> Floats:
    """What goes of information and vector when the unknowns ``inside`` are integrated out."""
    solved = np.linalg.solve(inside, np.concatenate([across, value[:, :, None]], axis=2))
    return np.asarray(across.transpose(0, 2, 1) @ solved)
