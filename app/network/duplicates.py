"""Duplicate drives: a drive that is uploaded twice, or in two formats, counts once; its duplicates name it.

Which drive counts follows from what is stored alone, not from the order of the uploads, and by the rule of the library
(``fusion.network.duplicates``). Callers own the hours of the drive (``app.network.locks``), so that of two drives that
are stored at the same time one sees the other.
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
_CANDIDATES = text(f"""
    SELECT other.drive_id
    FROM (SELECT segment_id, partition, entered_s FROM drive_passes WHERE {_ITS}) AS mine
    JOIN drive_passes AS other
        ON other.segment_id = mine.segment_id AND other.partition = mine.partition AND other.drive_id <> :drive_id
        AND other.entered_s BETWEEN mine.entered_s - :apart_s AND mine.entered_s + :apart_s
    GROUP BY other.drive_id
    HAVING count(DISTINCT mine.segment_id) > :share * least(
        (SELECT count(DISTINCT segment_id) FROM drive_passes WHERE {_ITS}),
        (SELECT count(DISTINCT segment_id) FROM drive_passes AS o WHERE o.drive_id = other.drive_id))
""")  # noqa: S608 - constants

_ENTRIES = """
    SELECT drive_id, segment_id, entered_s FROM drive_passes
    WHERE drive_id = ANY(%(ids)s::uuid[]) AND partition = ANY(%(partitions)s::smallint[])
    ORDER BY drive_id, sequence
"""
_EPOCHS = "SELECT drive_id, measurements, epoch_s FROM drive_constants WHERE drive_id = ANY(%(ids)s::uuid[])"

_DUPLICATES_OF = text("SELECT id FROM drives WHERE duplicate_of = :drive_id")
# Of two drives that are equal to the last digit, their bytes decide.
_FORMER = text("SELECT id, duplicate_of FROM drives WHERE id = ANY(CAST(:ids AS uuid[])) ORDER BY sha256")
_COUNTING = text("SELECT id FROM drives WHERE id = ANY(CAST(:ids AS uuid[])) AND duplicate_of IS NULL")
_SET_DUPLICATE_OF = text("UPDATE drives SET duplicate_of = :duplicate_of WHERE id = :drive_id")
_SEGMENTS = text("""
    SELECT DISTINCT segment_id FROM drive_passes
    WHERE drive_id = ANY(CAST(:ids AS uuid[])) AND partition = ANY(CAST(:partitions AS smallint[]))
""")


def duplicates_of(session: Session, drive_id: uuid.UUID) -> set[uuid.UUID]:
    """The drives that are marked as duplicates of this one."""
    return set(session.execute(_DUPLICATES_OF, {"drive_id": drive_id}).scalars())


def decide_duplicates(session: Session, drive_ids: Collection[uuid.UUID]) -> set[int]:
    """Decide anew which of these drives, and of those equal to them, count.

    Returns the segments of the drives that count from now on and did not, or the other way round.
    """
    drives, original = _assign(session, _with_counting(session, drive_ids))
    if {drives[k].id for k in original} != set(drive_ids):
        drives, original = _assign(session, _connected(session, drive_ids))
    changed = []
    for k, drive in enumerate(drives):
        drive_id, former = drive.id, drive.duplicate_of
        now = drives[original[k]].id if k in original else None
        if now != former:
            session.execute(_SET_DUPLICATE_OF, {"drive_id": drive_id, "duplicate_of": now})
        if now is not None and former is None:
            uncondense_drive(session, drive_id)
        if (now is None) != (former is None):
            changed.append(drive_id)
    if not changed:
        return set()
    values = {"ids": changed, "partitions": drive_partitions(session, changed)}
    return set(session.execute(_SEGMENTS, values).scalars())


def _assign(
    session: Session, traces: dict[uuid.UUID, DriveTrace]
) -> tuple[Sequence[Row[Any]], dict[int, int]]:
    """The drives with what each was a duplicate of so far, and which of them duplicates which, by place in the list."""
    drives = session.execute(_FORMER, {"ids": list(traces)}).all()
    return drives, find_duplicates({k: traces[row.id] for k, row in enumerate(drives)})


def _with_counting(session: Session, drive_ids: Collection[uuid.UUID]) -> dict[uuid.UUID, DriveTrace]:
    """One drive of which there are no duplicates, with the candidates that count; nothing for several drives.

    If the drive duplicates one of these, no other drive depends on it: the others were decided without it. So the
    thousandth copy of a drive costs as much as the second.
    """
    if len(drive_ids) != 1:
        return {}
    drive_id = next(iter(drive_ids))
    counting = session.execute(_COUNTING, {"ids": list(_candidates(session, drive_id))}).scalars()
    return _traces(session, {drive_id, *counting})


def _connected(session: Session, drive_ids: Collection[uuid.UUID]) -> dict[uuid.UUID, DriveTrace]:
    """These drives and all that equal any of them, however many steps away."""
    traces = _traces(session, drive_ids)
    waiting = set(drive_ids)
    connected: dict[uuid.UUID, DriveTrace] = {}
    while waiting:
        drive_id = waiting.pop()
        connected[drive_id] = one = traces[drive_id]
        # Each copy is a candidate of each other: none is looked at twice.
        candidates = _candidates(session, drive_id) - connected.keys() - waiting
        traces |= _traces(session, candidates - traces.keys())
        waiting |= {other for other in candidates if is_duplicate(one, traces[other])}
    return connected


def _candidates(session: Session, drive_id: uuid.UUID) -> set[uuid.UUID]:
    values = {**of_drive(session, drive_id), "apart_s": LONGEST_ENTRY_S, "share": SAME_SHARE}
    return set(session.execute(_CANDIDATES, values).scalars())


def _traces(session: Session, drive_ids: Collection[uuid.UUID]) -> dict[uuid.UUID, DriveTrace]:
    """The trace of each of these drives; that of a drive without passes is empty."""
    if not (ids := list(drive_ids)):
        return {}
    entries: dict[uuid.UUID, list[tuple[int, float]]] = {drive_id: [] for drive_id in ids}
    values = {"ids": ids, "partitions": drive_partitions(session, ids)}
    for drive_id, segment, entered_s in fetch_binary(session, _ENTRIES, values):
        entries[drive_id].append((segment, entered_s))
    epochs = {drive_id: row for drive_id, *row in fetch_binary(session, _EPOCHS, {"ids": ids})}
    traces = {}
    for drive_id, passes in entries.items():
        measurements, epoch_s = epochs.get(drive_id, (0, b""))
        segment, enter_s = np.array(passes, float).reshape(-1, 2).T
        traces[drive_id] = DriveTrace(
            segment.astype(np.int64), enter_s, np.frombuffer(epoch_s, "<f8").astype(np.float64), measurements
        )
    return traces
