"""Condenses what is told over each segment, pass by pass with the drive's own errors integrated out.

A solution of an edition reads these sums alone: that takes a tenth of the time of one that solves for every drive's
errors, and slopes differ by a quarter of a sigma. Heights are not carried from one segment to the next by drives, so
their sigmas are larger than those of the live map. What changes is condensed anew from all that is told there, so
nothing is ever taken off a sum.
"""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

from sqlalchemy.orm import Session

from app.network.condensed import append_condensed, drive_constants
from app.network.widenings import widenings_of
from app.releases import choosing
from fusion.network.condensed import CondensedPasses
from fusion.network.condensed_each import DrivePasses, condense_each
from fusion.network.curve import knot_length
from fusion.network.drive_constants import ConstantsInformation, marginals_of
from fusion.network.pass_factor import PassFactor
from fusion.types import Floats, Progress

DRIVES_AT_ONCE = 50


def condense_told(
    session: Session, drives: Sequence[uuid.UUID], segments: Sequence[int], progress: Progress
) -> None:
    """Condense anew what is told over ``segments``; of ``drives`` other passes are told than before.

    The session reads the tables of ``told``.
    """
    choosing.forget_sums(session, drives, segments)
    lengths_m = {k: float(knot_length(m)) for k, m in choosing.lengths_m(session, segments).items()}
    sums: dict[int, CondensedPasses] = {}
    every = sorted({*drives, *choosing.drives_over(session, segments)})
    for first in range(0, len(every), DRIVES_AT_ONCE):
        progress("telling", first / len(every))
        _add(session, every[first : first + DRIVES_AT_ONCE], set(drives), lengths_m, sums)
    append_condensed(session, dict(sorted(sums.items())))
    progress("telling", 1.0)


def _add(
    session: Session,
    drives: Sequence[uuid.UUID],
    anew: set[uuid.UUID],
    lengths_m: dict[int, float],
    sums: dict[int, CondensedPasses],
) -> None:
    """Add what these drives say over the segments of ``lengths_m`` to their sums, and store the constants of those of
    them that are ``anew``."""
    rows = choosing.told_passes(session, drives, anew, list(lengths_m))
    widening, known, made = widenings_of(session, drives), drive_constants(session, drives), {}
    decoded = iter(PassFactor.decode_all([tuple(row[1:]) for row in rows]))
    read = []
    for drive, of_drive in groupby(rows, key=lambda row: row[0]):
        times = widening.get(drive, 1.0)
        factors = [next(decoded).widened(times) for _ in of_drive]
        said = marginals_of(factors)
        if drive in anew:
            constants = ConstantsInformation.of_marginals(factors, *said)
            made[drive], known[drive] = (constants.encode(), len(factors)), (constants, len(factors))
        read.append(_over(factors, said, lengths_m, *known[drive]))
    for one, condensed in zip(read, condense_each(read), strict=True):
        _add_passes(one.passes, condensed, sums)
    if made:
        choosing.add_constants(session, made)


def _over(
    factors: Sequence[PassFactor],
    said: tuple[Floats, Floats],
    lengths_m: dict[int, float],
    constants: ConstantsInformation,
    count: int,
) -> DrivePasses:
    """Those of the passes that are over the segments of ``lengths_m``."""
    rows = [k for k, one in enumerate(factors) if one.segment in lengths_m]
    passes = [factors[k] for k in rows]
    information, vector = said
    lengths = [lengths_m[one.segment] for one in passes]
    return DrivePasses(passes, lengths, (information[rows], vector[rows]), constants, count)


def _add_passes(
    passes: Sequence[PassFactor], condensed: Sequence[CondensedPasses], sums: dict[int, CondensedPasses]
) -> None:
    over: set[int] = set()
    for factor, one in zip(passes, condensed, strict=True):
        # A drive that comes by twice is one drive.
        said = replace(one, drives=0) if factor.segment in over else one
        over.add(factor.segment)
        sums[factor.segment] = sums[factor.segment] + said if factor.segment in sums else said
