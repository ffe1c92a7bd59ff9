"""Stores, replaces and removes what one drive says of segments, and marks the cells that have to be solved for it.

How a drive is computed is not known here, nor what is shown of a segment (``app.map.store``), nor when a cell is
solved (``app.network.swap``).

A drive that is uploaded twice, or in two formats, counts once; its duplicates name it. Which drive counts follows from
what is stored alone, not from the order of the uploads, and by the rule of the library (``fusion.network.duplicates``).
Callers own the hours of the drive where it was (``app.network.locks``), so that of two drives that are stored at the
same time one sees the other.

One rule keeps the map right whatever runs at the same time: what a drive says is always stored together with marks of
the cells that it touches, and a cell is solved from everything that is stored.
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from sqlalchemy import Row, text
from sqlalchemy.orm import Session

from app.core.db import fetch_binary, plain_json
from app.network.condensed import OF_DRIVE, drive_partitions, of_drive, uncondense_drive
from app.network.locks import own_hours, share_network
from app.network.marks import MarkedBy, append_marks
from app.network.passes import hours_of, replace_passes
from fusion.network.duplicates import LONGEST_ENTRY_S, SAME_SHARE, DriveTrace, find_duplicates, is_duplicate
from fusion.network.pass_columns import PackedPasses
from fusion.network.pass_factor import PassFactor
from fusion.types import Floats, Ints, SegmentSlope

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
# Of two drives that are equal to the last digit, their bytes decide; of the same log of two owners the first to come.
_FORMER = text(
    "SELECT id, duplicate_of FROM drives WHERE id = ANY(CAST(:ids AS uuid[])) ORDER BY sha256, created_at, id"
)
_COUNTING = text("SELECT id FROM drives WHERE id = ANY(CAST(:ids AS uuid[])) AND duplicate_of IS NULL")
_SET_DUPLICATE_OF = text("UPDATE drives SET duplicate_of = :duplicate_of WHERE id = :drive_id")
_SEGMENTS = text("""
    SELECT DISTINCT segment_id FROM drive_passes
    WHERE drive_id = ANY(CAST(:ids AS uuid[])) AND partition = ANY(CAST(:partitions AS smallint[]))
""")


def decide_duplicates(session: Session, drive_ids: Collection[uuid.UUID]) -> set[int]:
    """Decide anew which of these drives, and of those equal to them, count.

    Returns the segments of the drives that count from now on and did not, or the other way round.
    """
    drives, original = _decided(session, drive_ids)
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


def _decided(session: Session, drive_ids: Collection[uuid.UUID]) -> tuple[Sequence[Row[Any]], dict[int, int]]:
    """What ``_assign`` says of these drives and of all that may equal them.

    Most are like no other, and then nothing more is read of them. One that duplicates a drive that counts leaves the
    others as they are, for they were decided without it: so the thousandth copy of a drive costs as much as the second.
    """
    if len(drive_ids) == 1:
        (drive_id,) = drive_ids
        candidates = _candidates(session, drive_id)
        if not candidates:
            return _assign(session, {drive_id: _UNREAD})
        counting = session.execute(_COUNTING, {"ids": list(candidates)}).scalars()
        drives, original = _assign(session, _traces(session, {drive_id, *counting}))
        if {drives[k].id for k in original} == set(drive_ids):
            return drives, original
    return _assign(session, _connected(session, drive_ids))


def _assign(
    session: Session, traces: dict[uuid.UUID, DriveTrace]
) -> tuple[Sequence[Row[Any]], dict[int, int]]:
    """The drives with what each was a duplicate of so far, and which of them duplicates which, by place in the list."""
    drives = session.execute(_FORMER, {"ids": list(traces)}).all()
    return drives, find_duplicates({k: traces[row.id] for k, row in enumerate(drives)})


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


_NO_EPOCHS = np.empty(0)
_UNREAD = DriveTrace(np.empty(0, np.int64), np.empty(0), _NO_EPOCHS, 0)

ESTIMATES_AT_ONCE = 4096


@dataclass(frozen=True)
class RunProvenance:
    """How the estimates of one run were made; ``options`` complete, defaults included."""

    method: str
    options: Mapping[str, Any]
    code_version: str
    road_version_id: int
    dem_version_id: int | None
    road_state: int | None = None
    """The highest state of the cells whose roads were read (``app.network.cells``)"""


# The published slopes of these segments may rest on the drive: on its own estimates or, until it is computed again, on
# estimates of a former model. What it contributes to the network is in its passes.
_DELETE_ESTIMATES = text("DELETE FROM drive_segments WHERE drive_id = :drive_id RETURNING segment_id")
_DELETE_PROVENANCE = text("DELETE FROM provenances WHERE drive_id = :drive_id")
_COUNTS = text("SELECT duplicate_of IS NULL FROM drives WHERE id = :drive_id")

_INSERT_PROVENANCE = text("""
    INSERT INTO provenances (drive_id, method, options, code_version, road_version_id, road_state, dem_version_id)
    VALUES (:drive_id, :method, CAST(:options AS jsonb), :code_version, :road_version_id, :road_state, :dem_version_id)
    RETURNING id
""")

_INSERT_ESTIMATES = text("""
    INSERT INTO drive_segments (drive_id, segment_id, slope_percent, slope_sigma_percent, observations,
                                passes, first_at, last_at, provenance_id, in_network)
    SELECT :drive_id, t.segment_id, t.slope, t.sigma, t.observations, t.passes, to_timestamp(t.first_at),
           to_timestamp(t.last_at), :provenance_id, :in_network
    FROM unnest(CAST(:segment_id AS bigint[]), CAST(:slope_percent AS float8[]), CAST(:slope_sigma_percent AS float8[]),
                CAST(:observations AS integer[]), CAST(:passes AS integer[]),
                CAST(:first_time_s AS float8[]), CAST(:last_time_s AS float8[]))
         AS t (segment_id, slope, sigma, observations, passes, first_at, last_at)
""")


def begin_change(session: Session, drive_id: uuid.UUID, factors: Sequence[PassFactor] = ()) -> None:
    """Keep out imports, and drives that can be duplicates of this one, before the drive's row is locked.

    ``factors`` are those that the drive is about to store; its stored passes count as well.
    """
    share_network(session)
    own_hours(session, hours_of(session, drive_id, factors, LONGEST_ENTRY_S))


def append_result(
    session: Session,
    drive: MarkedBy,
    segment_ids: Ints,
    estimates: Sequence[SegmentSlope],
    provenance: RunProvenance,
    factors: Sequence[PassFactor] = (),
    epoch_s: Floats = _NO_EPOCHS,
    *,
    delay_s: float = 0.0,
    look: Callable[[], None] = lambda: None,
) -> list[int]:
    """Replace what the drive says, and mark the cells that have to be solved for it within ``delay_s``; these cells.

    ``segment_ids`` maps the segments of estimates and factors (indices into the network of the run) to the
    database's ids. ``epoch_s`` are the times of the log's positions (e,); without them two logs of one drive are
    recognised by their entries into segments alone. Estimates whose slope or sigma is not finite are left out. ``look``
    is called between the parts of a long drive, and may raise. The caller has begun the change (``begin_change``) and
    holds the drive's row.
    """
    finite = [e for e in estimates if np.isfinite(e.slope_percent) and np.isfinite(e.slope_sigma_percent)]
    ids = [int(segment_ids[e.segment]) for e in finite]
    former = _delete_estimates(session, drive.drive_id)
    provenance_id = _insert_provenance(session, drive.drive_id, provenance)
    for first in range(0, len(ids), ESTIMATES_AT_ONCE):
        some = slice(first, first + ESTIMATES_AT_ONCE)
        _insert_estimates(session, drive.drive_id, provenance_id, ids[some], finite[some], bool(factors))
        look()
    touched = _replace_evidence(session, drive.drive_id, in_database(factors, segment_ids), epoch_s, look)
    look()
    return append_marks(session, touched, [*former, *(() if factors else ids)], drive, delay_s)


def append_removal(session: Session, drive: MarkedBy) -> list[int]:
    """Remove all that the drive says, and mark the cells that have to be solved for it; these cells.

    The caller has begun the change (``begin_change``) and holds the drive's row.
    """
    former = _delete_estimates(session, drive.drive_id)
    touched = _replace_evidence(session, drive.drive_id, [], _NO_EPOCHS)
    return append_marks(session, touched, former, drive)


def in_database(factors: Sequence[PassFactor], segment_ids: Ints) -> Sequence[PassFactor]:
    """Factors of a run with the database's ids of their segments."""
    if isinstance(factors, PackedPasses):
        return factors.over(segment_ids[factors.table.segment])
    return [factor.over(int(segment_ids[factor.segment])) for factor in factors]


def _replace_evidence(
    session: Session,
    drive_id: uuid.UUID,
    factors: Sequence[PassFactor],
    epoch_s: Floats,
    look: Callable[[], None] = lambda: None,
) -> set[int]:
    """Replace the drive's passes; the segments around which this changes the evidence."""
    counted = session.execute(_COUNTS, {"drive_id": drive_id}).scalar_one()
    changed = replace_passes(session, drive_id, factors, epoch_s, look)
    look()
    duplicates = session.execute(_DUPLICATES_OF, {"drive_id": drive_id}).scalars()
    others = decide_duplicates(session, {drive_id, *duplicates})
    counts = session.execute(_COUNTS, {"drive_id": drive_id}).scalar_one()
    return {*(changed if counted or counts else ()), *others}


def _delete_estimates(session: Session, drive_id: uuid.UUID) -> list[int]:
    """Delete the drive's estimates; their segments."""
    former = list(session.execute(_DELETE_ESTIMATES, {"drive_id": drive_id}).scalars())
    session.execute(_DELETE_PROVENANCE, {"drive_id": drive_id})
    return former


def _insert_provenance(session: Session, drive_id: uuid.UUID, provenance: RunProvenance) -> int:
    options = json.dumps(plain_json(provenance.options))
    values = {**vars(provenance), "drive_id": drive_id, "options": options}
    return int(session.execute(_INSERT_PROVENANCE, values).scalar_one())


def _insert_estimates(
    session: Session,
    drive_id: uuid.UUID,
    provenance_id: int,
    ids: list[int],
    estimates: Sequence[SegmentSlope],
    in_network: bool,
) -> None:
    values = {f.name: np.array([getattr(e, f.name) for e in estimates]) for f in fields(SegmentSlope)}
    one = {"drive_id": drive_id, "provenance_id": provenance_id, "in_network": in_network}
    session.execute(_INSERT_ESTIMATES, {**one, **values, "segment_id": np.array(ids)})
