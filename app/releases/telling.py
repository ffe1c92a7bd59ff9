"""Chooses what may be told, and tells it: from the live passes to those of the schema ``told``.

A segment is told when as many distinct owners as are needed contribute to what would change there; until then its
passes wait, and it stays as it was told. So whoever compares two editions sees what several owners did together. What
was removed since, or lies in a zone that was drawn since, is taken back at once; where too few owners are left, the
segment is unknown again.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import groupby

from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.network.condensed import append_condensed, drive_constants
from app.network.marks import append_marks
from app.network.widenings import widenings_of
from app.releases import choosing, store
from app.releases.ends import ends_of_drive, hidden, near
from app.releases.places import Places
from app.releases.store import ToExamine
from fusion.network.condensed import CondensedPasses
from fusion.network.condensed_each import DrivePasses, condense_each
from fusion.network.curve import knot_length
from fusion.network.drive_constants import ConstantsInformation, marginals_of
from fusion.network.pass_factor import PassFactor
from fusion.types import Floats, Progress, no_progress

DRIVES_AT_ONCE = 50


class Junctions:
    """How many segments meet at nodes, as far as that was asked for."""

    def __init__(self) -> None:
        self._seen: set[int] = set()
        self._roads_at: dict[int, int] = {}

    def at(self, session: Session, segment_ids: set[int]) -> dict[int, int]:
        """At all nodes of these segments and of former ones."""
        if new := segment_ids - self._seen:
            self._seen |= new
            self._roads_at |= store.roads_at(session, sorted(new))
        return self._roads_at


def examine(sessions: Sessions, progress: Progress = no_progress) -> int:
    """Find which passes of new and changed drives lie at ends of trips or in zones; how many drives were looked at."""
    with sessions() as session:
        waiting = store.to_examine(session)
    junctions = Junctions()
    for first in range(0, len(waiting), DRIVES_AT_ONCE):
        progress("ends of trips", first / len(waiting))
        with sessions.begin() as session:
            _examine_some(session, waiting[first : first + DRIVES_AT_ONCE], junctions)
    progress("ends of trips", 1.0)
    return len(waiting)


def _examine_some(session: Session, drives: Sequence[ToExamine], junctions: Junctions) -> None:
    places = Places(session, partial(store.add_place, session))
    ids = [one.drive_id for one in drives]
    tracks, driven = store.tracks(session, ids), store.driven(session, ids)
    circles = {
        one.drive_id: places.around(
            one.owner_id, ends_of_drive(tracks.get(one.drive_id), driven[one.drive_id])
        )
        for one in drives
        if one.drive_id in driven
    }
    about = {segment for name, around in circles.items() for segment in near(driven[name], around)}
    roads_at = junctions.at(session, about)
    for one in drives:
        if one.drive_id in circles:
            out = hidden(driven[one.drive_id], circles[one.drive_id], roads_at)
            store.note_examined(session, one, out.tolist())


def tell(
    sessions: Sessions,
    owners_needed: int,
    progress: Progress = no_progress,
    begin: Callable[[Session], None] = lambda _: None,
) -> list[int]:
    """Bring what is told up to date and mark it to be solved, in one transaction; the segments that changed.

    ``begin`` is called as the transaction begins, and may refuse it by raising.
    """
    with sessions.begin() as session:
        begin(session)
        progress("choosing", 0.0)
        drives, segments = choosing.choose(session, owners_needed)
        condense_told(session, drives, segments, progress)
        choosing.forget_drives(session)
        append_marks(session, segments)
    return segments


def condense_told(
    session: Session, drives: Sequence[uuid.UUID], segments: Sequence[int], progress: Progress
) -> None:
    """Condense anew what is told over ``segments``; of ``drives`` other passes are told than before.

    The session reads the tables of ``told``.

    A solution of an edition reads these sums alone: that takes a tenth of the time of one that solves for every drive's
    errors, and slopes differ by a quarter of a sigma. Heights are not carried from one segment to the next by drives,
    so their sigmas are larger than those of the live map. What changes is condensed anew from all that is told there,
    so nothing is ever taken off a sum.
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
