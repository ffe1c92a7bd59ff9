"""Condenses what is told over each segment, pass by pass with the drive's own errors integrated out.

A solution of an edition reads these sums alone: that takes a tenth of the time of one that solves for every drive's
errors, and slopes differ by a quarter of a sigma. Heights are not carried from one segment to the next by drives, so
their sigmas are larger than those of the live map. What changes is condensed anew from all that is told there, so
nothing is ever taken off a sum.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Sequence
from contextlib import closing, suppress

from sqlalchemy.orm import Session

from app.core.beside import Beside
from app.network.condensed import append_condensed, drive_constants
from app.network.widenings import widenings_of
from app.releases import choosing, condensing_process
from app.releases.condensed_drives import CondensedDrives, ToldDrives, condense
from fusion.network.condensed import CondensedPasses
from fusion.network.curve import knot_length
from fusion.types import Progress

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
    parts = [every[first : first + DRIVES_AT_ONCE] for first in range(0, len(every), DRIVES_AT_ONCE)]
    for done, condensed in enumerate(_condensed(session, parts, set(drives), lengths_m)):
        progress("telling", done / len(parts))
        for segment, said in condensed.sums.items():
            sums[segment] = sums[segment] + said if segment in sums else said
        if condensed.made:
            choosing.add_constants(session, condensed.made)
    append_condensed(session, dict(sorted(sums.items())))
    progress("telling", 1.0)


def _condensed(
    session: Session, parts: Sequence[Sequence[uuid.UUID]], anew: set[uuid.UUID], lengths_m: dict[int, float]
) -> Iterator[CondensedDrives]:
    """Part after part. Where there are several, every other one is condensed by a process beside this one."""
    if len(parts) < 2:
        yield from (condense(_read(session, part, anew, lengths_m)) for part in parts)
        return
    with closing(Beside(condensing_process)) as beside:
        for first in range(0, len(parts), 2):
            ours, *theirs = (_read(session, part, anew, lengths_m) for part in parts[first : first + 2])
            for told in theirs:
                with suppress(OSError):  # it has ended: the answer will say so
                    beside.pipe.send(told)
            yield condense(ours)
            yield from (_answer(beside, told) for told in theirs)


def _answer(beside: Beside, told: ToldDrives) -> CondensedDrives:
    try:
        answer: CondensedDrives = beside.pipe.recv()
    except (EOFError, OSError):  # it has ended, for lack of memory say
        return condense(told)
    return answer


def _read(
    session: Session, drives: Sequence[uuid.UUID], anew: set[uuid.UUID], lengths_m: dict[int, float]
) -> ToldDrives:
    passes = choosing.told_passes(session, drives, anew, list(lengths_m))
    return ToldDrives(passes, widenings_of(session, drives), drive_constants(session, drives), lengths_m)
