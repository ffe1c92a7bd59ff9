"""The passes that drives contribute: written drive by drive, read by the segments that they are over.

Passes are the evidence; slopes are computed from them (``solve``). Those of duplicate drives are stored but not read
(``duplicates``), and of many passes over one segment the old ones are read as one sum (``condensed``).
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Collection, Sequence

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import bigints, fetch_binary, send_binary
from app.network.condensed import OF_DRIVE, StoredPass, condensed_of_drive, of_drive, subtract_condensed
from fusion.network.drive_constants import ConstantsInformation
from fusion.network.pass_columns import encoded, portions_of, table_of
from fusion.network.pass_factor import PassFactor
from fusion.types import Floats

# Statements with %(name)s are executed by psycopg itself, which takes and gives bytes as they are (``app.core.db``).

_MINE, _ITS = OF_DRIVE.format("%(", ")s"), OF_DRIVE.format(":", "")

_DELETE = f"""
    DELETE FROM drive_passes WHERE {_MINE}
    RETURNING segment_id, sequence, condensed_weight, CASE WHEN condensed_weight > 0 THEN factor END
"""  # noqa: S608 - constants
# While a drive changes, nobody condenses its passes (``condensed``).
_LOCK_DRIVE = text("SELECT FROM drives WHERE id = :drive_id FOR NO KEY UPDATE")
_DELETE_REJECTED = text("DELETE FROM rejected_passes WHERE drive_id = :drive_id")

_INSERT = """
    INSERT INTO drive_passes (drive_id, segment_id, sequence, entered_s, factor, partition)
    SELECT t.drive_id, t.segment_id, t.sequence, t.entered_s, t.factor, versant_partition(s.cell)
    FROM unnest(%(drive_id)s::uuid[], %(segment_id)s::bigint[], %(sequence)s::integer[], %(entered_s)s::float8[],
                %(factor)b::bytea[]) AS t (drive_id, segment_id, sequence, entered_s, factor)
    JOIN segments AS s ON s.id = t.segment_id
"""

# However many passes there are, recent ones are few, and an index knows them.
OVER = """
    SELECT p.id, p.drive_id, r.pass_id IS NULL AS accepted, p.factor, p.segment_id, p.sequence
    FROM drive_passes AS p
    LEFT JOIN rejected_passes AS r
        ON r.segment_id = p.segment_id AND r.pass_id = p.id AND r.segment_id = ANY(%(ids)s::bigint[])
    WHERE p.segment_id = ANY(%(ids)s::bigint[]) AND p.partition = ANY(%(partitions)s::smallint[])
        AND p.condensed_weight IS NULL AND (SELECT duplicate_of IS NULL FROM drives WHERE id = p.drive_id)
    ORDER BY p.drive_id, p.sequence
"""
_PARTITIONS = text(
    "SELECT DISTINCT versant_partition(cell) FROM segments WHERE id = ANY(CAST(:ids AS bigint[])) ORDER BY 1"
)

# What all passes of a drive together say of its constants, so that a solution need not read the passes outside of it;
# and what tells the drive from others (``duplicates``).
_DELETE_CONSTANTS = text("DELETE FROM drive_constants WHERE drive_id = :drive_id")
_INSERT_CONSTANTS = """
    INSERT INTO drive_constants (drive_id, passes, evidence, measurements, epoch_s, partitions)
    VALUES (%(drive_id)s, %(passes)s, %(evidence)b, %(measurements)s, %(epoch_s)b, %(partitions)s::smallint[])
"""

# A new drive can turn others' passes from accepted to rejected or back. A drive that is being removed takes its rows
# along; passes that were condensed meanwhile stay as they were condensed.
_REJECT = text("""
    INSERT INTO rejected_passes (segment_id, pass_id, drive_id)
    SELECT segment_id, id, drive_id FROM drive_passes
    WHERE id = ANY(CAST(:ids AS bigint[])) AND partition = ANY(CAST(:partitions AS smallint[]))
        AND condensed_weight IS NULL
    FOR KEY SHARE SKIP LOCKED
    ON CONFLICT DO NOTHING
""")
_ACCEPT = text("""
    DELETE FROM rejected_passes
    WHERE segment_id = ANY(CAST(:segments AS bigint[])) AND pass_id = ANY(CAST(:ids AS bigint[]))
""")

# The tile of zoom 12 that a segment is in, and the hour: a drive of a thousand kilometres has some two hundred. Each
# owner of one holds a lock of the server, which has room for thousands: hence no more numbers than that. Two hours that
# share one only wait for each other now and then.
_HOURS = text(f"""
    SELECT DISTINCT CAST(hashint8(
        CAST(floor((e.entered_s + apart_s) / 3600) AS bigint) << 24 | (s.cell >> 16) << 12 | (s.cell & 16383) >> 2
    ) & 4095 AS integer)
    FROM (SELECT segment_id, entered_s FROM drive_passes WHERE {_ITS}
          UNION ALL SELECT * FROM unnest(CAST(:segments AS bigint[]), CAST(:entered_s AS float8[]))) AS e,
        LATERAL (SELECT cell FROM segments WHERE id = e.segment_id OFFSET 0) AS s,
        unnest(ARRAY[CAST(-:apart_s AS float8), :apart_s]) AS apart_s
""")  # noqa: S608 - constants


def replace_passes(
    session: Session,
    drive_id: uuid.UUID,
    factors: Sequence[PassFactor],
    epoch_s: Floats,
    look: Callable[[], None] = lambda: None,
) -> set[int]:
    """Replace the drive's passes by ``factors``, whose segments are database ids; returns the segments of both.

    ``epoch_s`` are the times of the log's positions, shape (e,), Unix seconds. ``look`` is called between portions of
    a long drive, and may raise.
    """
    session.execute(_LOCK_DRIVE, {"drive_id": drive_id})
    deleted = fetch_binary(session, _DELETE, of_drive(session, drive_id))
    subtract_condensed(session, condensed_of_drive(session, drive_id, deleted))
    session.execute(_DELETE_REJECTED, {"drive_id": drive_id})
    session.execute(_DELETE_CONSTANTS, {"drive_id": drive_id})
    table = table_of(factors)
    driven = set(table.segment.tolist())
    if factors:
        for some, portion in portions_of(factors):
            look()
            insert_passes(session, [drive_id] * len(portion), portion, table.first_time_s[some])
        constants = {
            "passes": len(factors),
            "evidence": ConstantsInformation.of_passes(factors, progress=lambda *_: look()).encode(),
            "measurements": int(table.rows.sum()),
            "epoch_s": np.asarray(epoch_s, "<f8").tobytes(),
            "partitions": partitions_of(session, driven),
        }
        send_binary(session, _INSERT_CONSTANTS, {"drive_id": drive_id, **constants})
    return driven | {segment for segment, *_ in deleted}


def insert_passes(
    session: Session, drive_ids: Sequence[uuid.UUID], factors: Sequence[PassFactor], entered_s: Floats
) -> None:
    """Store one pass for each drive and factor, entered at ``entered_s`` (p,), Unix seconds."""
    table = table_of(factors)
    columns = {
        "drive_id": list(drive_ids),
        "segment_id": table.segment,
        "sequence": table.sequence,
        "entered_s": entered_s,
        "factor": list(encoded(factors)),
    }
    send_binary(session, _INSERT, columns)


def partitions_of(session: Session, segment_ids: Collection[int]) -> list[int]:
    """The partitions in which the passes over these segments are."""
    return list(session.execute(_PARTITIONS, {"ids": bigints(segment_ids)}).scalars())


def hours_of(
    session: Session, drive_id: uuid.UUID, factors: Sequence[PassFactor], apart_s: float
) -> set[int]:
    """Numbers of the hours in which the drive was in places, by its stored passes and by ``factors``, whose segments
    are database ids. Drives that entered a segment within ``apart_s`` of each other have one in common."""
    table = table_of(factors)
    entries = {"segments": table.segment, "entered_s": table.first_time_s}
    values = {**of_drive(session, drive_id), **entries, "apart_s": apart_s}
    return set(session.execute(_HOURS, values).scalars().all())


def passes_over(session: Session, segment_ids: Collection[int]) -> list[StoredPass]:
    """The recent passes over these segments, without those of duplicate drives; drive by drive in driving order."""
    values = {"ids": bigints(segment_ids), "partitions": partitions_of(session, segment_ids)}
    rows = fetch_binary(session, OVER, values)
    factors = PassFactor.decode_all([row[3:] for row in rows])
    return [
        StoredPass(pass_id, drive_id, accepted, factor)
        for (pass_id, drive_id, accepted, *_), factor in zip(rows, factors, strict=True)
    ]


def set_accepted(session: Session, accepted: Sequence[StoredPass], rejected: Sequence[StoredPass]) -> None:
    """Write which passes are accepted from now on, and which are rejected."""
    for statement, passes in ((_ACCEPT, accepted), (_REJECT, rejected)):
        if passes:
            segments = sorted({p.factor.segment for p in passes})
            ids = sorted(p.id for p in passes if p.id is not None)
            values = {"ids": bigints(ids), "segments": bigints(segments)}
            session.execute(statement, {**values, "partitions": partitions_of(session, segments)})
