"""One drive that is there twice, uploaded again or in another format: one of them is heard, the others name it.

Who is heard follows from what is stored alone, not from who came first. What the drives say is in ``passes``; callers
own the network (``app.network.versions``).
"""

from __future__ import annotations

import uuid
from collections.abc import Collection, Mapping

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.network.passes import factors_of

SAME_MOMENT_S = 2.0
"""Two drives that come to a segment within this time of each other were there together."""

# By segment and time through an index, so that the cost is that of the drive itself. Half of the smaller drive counts.
_BESIDE = text(
    """
    SELECT other.drive_id
    FROM drive_segments AS mine JOIN drive_segments AS other
        ON other.segment_id = mine.segment_id AND other.drive_id <> mine.drive_id AND other.in_network
        AND other.first_at BETWEEN mine.first_at - make_interval(secs => :apart_s)
                               AND mine.first_at + make_interval(secs => :apart_s)
    WHERE mine.drive_id = :drive_id AND mine.in_network
    GROUP BY other.drive_id
    HAVING EXISTS (SELECT FROM drive_passes AS p WHERE p.drive_id = :drive_id)
        AND EXISTS (SELECT FROM drive_passes AS p WHERE p.drive_id = other.drive_id)
        AND 2 * count(*) > least(
        (SELECT count(*) FROM drive_segments AS m WHERE m.drive_id = :drive_id AND m.in_network),
        (SELECT count(*) FROM drive_segments AS o WHERE o.drive_id = other.drive_id AND o.in_network))
    """
)

_NAMED_BY = text("SELECT id FROM drives WHERE same_as = :drive_id")
_SAME_AS = text("SELECT id, same_as, sha256 FROM drives WHERE id = ANY(CAST(:ids AS uuid[]))")
_SET_SAME_AS = text("UPDATE drives SET same_as = :same_as WHERE id = :drive_id")
_SET_HEARD = text(
    "UPDATE drive_passes SET accepted = :heard WHERE drive_id = :drive_id AND accepted <> :heard"
)
_SEGMENTS = text("SELECT DISTINCT segment_id FROM drive_passes WHERE drive_id = ANY(CAST(:ids AS uuid[]))")


def drives_beside(session: Session, drive_id: uuid.UUID) -> set[uuid.UUID]:
    """Other drives with passes over the same segments at the same times, and those that name this one so far."""
    return {*_beside(session, drive_id), *session.execute(_NAMED_BY, {"drive_id": drive_id}).scalars()}


def choose_witnesses(session: Session, drive_ids: Collection[uuid.UUID]) -> set[int]:
    """Decide anew who is heard among these drives and those beside them; the segments of those that now are or no
    longer are."""
    beside = _together(session, drive_ids)
    drives = session.execute(_SAME_AS, {"ids": list(beside)}).all()
    wanted: Mapping[uuid.UUID, uuid.UUID | None] = dict.fromkeys(beside)
    if any(beside.values()):
        ranks = {row.id: (-_measurements(session, row.id), row.sha256) for row in drives}
        wanted = _witnesses(beside, ranks)
    changed = []
    for drive_id, former, _ in drives:
        witness = wanted[drive_id]
        if witness != former:
            session.execute(_SET_SAME_AS, {"drive_id": drive_id, "same_as": witness})
        if (
            witness is not None or former is not None
        ):  # also the new passes of one that is not heard either way
            session.execute(_SET_HEARD, {"drive_id": drive_id, "heard": witness is None})
        if (witness is None) != (former is None):
            changed.append(drive_id)
    return set(session.execute(_SEGMENTS, {"ids": changed}).scalars()) if changed else set()


def _together(session: Session, drive_ids: Collection[uuid.UUID]) -> dict[uuid.UUID, set[uuid.UUID]]:
    """These drives and all that are beside any of them, however many steps away: each with those beside it."""
    beside: dict[uuid.UUID, set[uuid.UUID]] = {}
    waiting = set(drive_ids)
    while waiting:
        drive_id = waiting.pop()
        beside[drive_id] = _beside(session, drive_id)
        named_by = session.execute(_NAMED_BY, {"drive_id": drive_id}).scalars()
        waiting |= {*beside[drive_id], *named_by} - beside.keys()
    return beside


def _beside(session: Session, drive_id: uuid.UUID) -> set[uuid.UUID]:
    values = {"drive_id": drive_id, "apart_s": SAME_MOMENT_S}
    return set(session.execute(_BESIDE, values).scalars())


def _witnesses(
    beside: Mapping[uuid.UUID, set[uuid.UUID]], ranks: Mapping[uuid.UUID, tuple[int, str]]
) -> dict[uuid.UUID, uuid.UUID | None]:
    """For each drive the one that is heard in its place, which has more measurements; None: it is heard itself.

    Of two that have as many, their bytes decide.
    """
    chosen: dict[uuid.UUID, uuid.UUID | None] = {}
    for drive_id in sorted(beside, key=lambda d: ranks[d]):
        chosen[drive_id] = next((w for w, of in chosen.items() if of is None and w in beside[drive_id]), None)
    return chosen


def _measurements(session: Session, drive_id: uuid.UUID) -> int:
    return sum(factor.rows for factor in factors_of(session, drive_id))
