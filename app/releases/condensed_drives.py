"""What is told of some drives condensed: here, or in a process beside. It knows no database, and loads none."""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

from fusion.network.condensed import CondensedPasses
from fusion.network.condensed_each import DrivePasses, condense_each
from fusion.network.drive_constants import ConstantsInformation, marginals_of
from fusion.network.pass_factor import PassFactor
from fusion.types import Floats

Known = tuple[ConstantsInformation, int]
"""What all passes of a drive say of its constants, and how many they are."""


@dataclass(frozen=True, eq=False)
class ToldDrives:
    """What is told of some drives."""

    passes: Sequence[tuple[uuid.UUID, bytes, int, int]]
    """Drive, factor, segment, number, drive after drive; all of those whose constants are not known."""
    widening: Mapping[uuid.UUID, float]
    """Of drives whose sigmas count wider."""
    known: Mapping[uuid.UUID, Known]
    lengths_m: Mapping[int, float]
    """Of the segments that are condensed, as their knots assume."""


@dataclass(frozen=True, eq=False)
class CondensedDrives:
    """What they say together over each segment, and the constants of those whose were not known."""

    sums: Mapping[int, CondensedPasses]
    made: Mapping[uuid.UUID, Known]


def condense(told: ToldDrives) -> CondensedDrives:
    """Condense each pass, and add up those over each segment."""
    decoded = iter(PassFactor.decode_all([row[1:] for row in told.passes]))
    read, made = [], dict[uuid.UUID, Known]()
    for drive, of_drive in groupby(told.passes, key=lambda row: row[0]):
        times = told.widening.get(drive, 1.0)
        factors = [next(decoded).widened(times) for _ in of_drive]
        said = marginals_of(factors)
        if drive not in told.known:
            made[drive] = ConstantsInformation.of_marginals(factors, *said), len(factors)
        constants, count = told.known.get(drive) or made[drive]
        read.append(_over(factors, said, told.lengths_m, constants, count))
    sums: dict[int, CondensedPasses] = {}
    for one, condensed in zip(read, condense_each(read), strict=True):
        _add(one.passes, condensed, sums)
    return CondensedDrives(sums, made)


def _over(
    factors: Sequence[PassFactor],
    said: tuple[Floats, Floats],
    lengths_m: Mapping[int, float],
    constants: ConstantsInformation,
    count: int,
) -> DrivePasses:
    """Those of the passes that are over the segments of ``lengths_m``."""
    rows = [k for k, one in enumerate(factors) if one.segment in lengths_m]
    passes = [factors[k] for k in rows]
    information, vector = said
    lengths = [lengths_m[one.segment] for one in passes]
    return DrivePasses(passes, lengths, (information[rows], vector[rows]), constants, count)


def _add(
    passes: Sequence[PassFactor], condensed: Sequence[CondensedPasses], sums: dict[int, CondensedPasses]
) -> None:
    over: set[int] = set()
    for factor, one in zip(passes, condensed, strict=True):
        # A drive that comes by twice is one drive.
        said = replace(one, drives=0) if factor.segment in over else one
        over.add(factor.segment)
        sums[factor.segment] = sums[factor.segment] + said if factor.segment in sums else said
