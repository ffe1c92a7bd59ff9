"""Chooses what may be told, and tells it: from the live passes to those of the schema ``told``.

A segment is told when as many distinct owners as are needed contribute to what would change there; until then its
passes wait, and it stays as it was told. So whoever compares two editions sees what several owners did together. What
was removed since, or lies in a zone that was drawn since, is taken back at once; where too few owners are left, the
segment is unknown again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.network.marks import append_marks
from app.releases import choosing, store
from app.releases.condensing import condense_told
from app.releases.ends import ends_of_drive, hidden, near
from app.releases.places import Places
from app.releases.store import ToExamine
from fusion.types import Progress, no_progress

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
