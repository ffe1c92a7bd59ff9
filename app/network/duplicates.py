"""One drive that is there twice, uploaded again or in another format: one of them is heard, the others name it.

Who is heard follows from what is stored alone, not from who came first, and by the rule that holds without a service
too (``fusion.network.duplicates``). What the drives say is in ``passes``; callers own the hours of the drive
(``app.network.locks``), so that of two that come at once one sees the other.
"""

from __future__ import annotations

import uuid
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from sqlalchemy import Row, text
from sqlalchemy.orm import Session

from app.core.db import fetch_binary
from app.network.condensed import OF_DRIVE, drive_partitions, of_drive, uncondense_drive
from fusion.network.duplicates import LONGEST_ENTRY_S, SAME_SHARE, DriveTrace, find_duplicates, is_duplicate

_ITS = OF_DRIVE.format(":", "")

# Drives that the rule can take for this one, and a few more: through an index by segment and time, so that the cost is
# that of the drive itself.
_BESIDE = text(
    f"""
    SELECT other.drive_id
    FROM (SELECT segment_id, partition, entered_s FROM drive_passes WHERE {_ITS}) AS mine
    JOIN drive_passes AS other
        ON other.segment_id = mine.segment_id AND other.partition = mine.partition AND other.drive_id <> :drive_id
        AND other.entered_s BETWEEN mine.entered_s - :apart_s AND mine.entered_s + :apart_s
    GROUP BY other.drive_id
    HAVING count(DISTINCT mine.segment_id) > :share * least(
        (SELECT count(DISTINCT segment_id) FROM drive_passes WHERE {_ITS}),
        (SELECT count(DISTINCT segment_id) FROM drive_passes AS o WHERE o.drive_id = other.drive_id))
    """  # noqa: S608 - constants
)

_ENTRIES = """
    SELECT drive_id, segment_id, entered_s FROM drive_passes
    WHERE drive_id = ANY(%(ids)s::uuid[]) AND partition = ANY(%(partitions)s::smallint[])
    ORDER BY drive_id, sequence
"""
_EPOCHS = "SELECT drive_id, measurements, epoch_s FROM drive_constants WHERE drive_id = ANY(%(ids)s::uuid[])"

_NAMED_BY = text("SELECT id FROM drives WHERE duplicate_of = :drive_id")
_DUPLICATE_OF = text(
    "SELECT id, duplicate_of FROM drives WHERE id = ANY(CAST(:ids AS uuid[])) ORDER BY sha256"
)
_HEARD = text("SELECT id FROM drives WHERE id = ANY(CAST(:ids AS uuid[])) AND duplicate_of IS NULL")
_SET_DUPLICATE_OF = text("UPDATE drives SET duplicate_of = :duplicate_of WHERE id = :drive_id")
_SEGMENTS = text(
    """
    SELECT DISTINCT segment_id FROM drive_passes
    WHERE drive_id = ANY(CAST(:ids AS uuid[])) AND partition = ANY(CAST(:partitions AS smallint[]))
    """
)


def duplicates_of(session: Session, drive_id: uuid.UUID) -> set[uuid.UUID]:
    """Drives that are not heard so far because this one is."""
    return set(session.execute(_NAMED_BY, {"drive_id": drive_id}).scalars())


def decide_duplicates(session: Session, drive_ids: Collection[uuid.UUID]) -> set[int]:
    """Decide anew who is heard among these drives and those that are the same; the segments of those that now are or no
    longer are."""
    drives, again = _decided(session, _among_heard(session, drive_ids))
    if {drives[k].id for k in again} != set(drive_ids):
        drives, again = _decided(session, _together(session, drive_ids))
    changed = []
    for k, drive in enumerate(drives):
        drive_id, former = drive.id, drive.duplicate_of
        witness = drives[again[k]].id if k in again else None
        if witness != former:
            session.execute(_SET_DUPLICATE_OF, {"drive_id": drive_id, "duplicate_of": witness})
        if witness is not None and former is None:
            uncondense_drive(session, drive_id)
        if (witness is None) != (former is None):
            changed.append(drive_id)
    if not changed:
        return set()
    values = {"ids": changed, "partitions": drive_partitions(session, changed)}
    return set(session.execute(_SEGMENTS, values).scalars())


def _decided(
    session: Session, witnesses: dict[uuid.UUID, DriveTrace]
) -> tuple[Sequence[Row[Any]], dict[int, int]]:
    """The drives with what they named so far, and which of them says which again, both by their place in the list."""
    # Of two that are alike to the last digit, their bytes decide.
    drives = session.execute(_DUPLICATE_OF, {"ids": list(witnesses)}).all()
    return drives, find_duplicates({k: witnesses[row.id] for k, row in enumerate(drives)})


def _among_heard(session: Session, drive_ids: Collection[uuid.UUID]) -> dict[uuid.UUID, DriveTrace]:
    """One drive that no other names, with those beside it that are heard; of several drives nothing.

    If it is one of these again, no other drive's fate depends on it: who is heard was decided without it. So the
    thousandth copy of a drive costs as much as the second.
    """
    if len(drive_ids) != 1:
        return {}
    drive_id = next(iter(drive_ids))
    heard = session.execute(_HEARD, {"ids": list(_beside(session, drive_id))}).scalars()
    return _witnesses(session, {drive_id, *heard})


def _together(session: Session, drive_ids: Collection[uuid.UUID]) -> dict[uuid.UUID, DriveTrace]:
    """These drives and all that are the same as any of them, however many steps away."""
    found = _witnesses(session, drive_ids)
    waiting = set(drive_ids)
    together: dict[uuid.UUID, DriveTrace] = {}
    while waiting:
        drive_id = waiting.pop()
        together[drive_id] = one = found[drive_id]
        # Of copies each is beside each: none is looked at twice.
        beside = _beside(session, drive_id) - together.keys() - waiting
        found |= _witnesses(session, beside - found.keys())
        waiting |= {other for other in beside if is_duplicate(one, found[other])}
    return together


def _beside(session: Session, drive_id: uuid.UUID) -> set[uuid.UUID]:
    values = {**of_drive(session, drive_id), "apart_s": LONGEST_ENTRY_S, "share": SAME_SHARE}
    return set(session.execute(_BESIDE, values).scalars())


def _witnesses(session: Session, drive_ids: Collection[uuid.UUID]) -> dict[uuid.UUID, DriveTrace]:
    """What tells each of these drives from others; nothing does of one without passes."""
    if not (ids := list(drive_ids)):
        return {}
    entries: dict[uuid.UUID, list[tuple[int, float]]] = {drive_id: [] for drive_id in ids}
    for drive_id, segment, entered_s in fetch_binary(
        session, _ENTRIES, {"ids": ids, "partitions": drive_partitions(session, ids)}
    ):
        entries[drive_id].append((segment, entered_s))
    epochs = {drive_id: said for drive_id, *said in fetch_binary(session, _EPOCHS, {"ids": ids})}
    found = {}
    for drive_id, passes in entries.items():
        measurements, epoch_s = epochs.get(drive_id, (0, b""))
        segment, enter_s = np.array(passes, float).reshape(-1, 2).T
        found[drive_id] = DriveTrace(
            segment.astype(np.int64), enter_s, np.frombuffer(epoch_s, "<f8").astype(np.float64), measurements
        )
    return found
