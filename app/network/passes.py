"""The passes that drives contribute: written drive by drive, read by the segments that they are over.

Passes are the truth; slopes are made of them (``solve``). Those of a drive that is there already, under another id, are
stored but not read (``twins``), and of many over one segment the old ones are read as a sum (``sums``).
"""

from __future__ import annotations

import uuid
from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import fetch_binary, send_binary
from app.network.condensed import OF_DRIVE, condensed_of_drive, of_drive, subtract_condensed
from fusion.network.outside_passes import ConstantsInformation
from fusion.network.pass_factor import PassFactor
from fusion.types import Floats

# Statements with %(name)s are executed by psycopg itself, which takes and gives bytes as they are (``app.core.db``).

_MINE, _ITS = OF_DRIVE.format("%(", ")s"), OF_DRIVE.format(":", "")

_DELETE = f"""
    DELETE FROM drive_passes WHERE {_MINE}
    RETURNING segment_id, sequence, condensed_weight, CASE WHEN condensed_weight > 0 THEN factor END
"""  # noqa: S608 - constants
# Nobody sums passes of a drive that changes (``sums``).
_KEEP = text("SELECT FROM drives WHERE id = :drive_id FOR NO KEY UPDATE")
_DELETE_VERDICTS = text("DELETE FROM rejected_passes WHERE drive_id = :drive_id")

_INSERT = """
    INSERT INTO drive_passes (drive_id, segment_id, sequence, entered_s, factor, partition)
    SELECT %(drive_id)s, t.segment_id, t.sequence, t.entered_s, t.factor, versant_partition(s.cell)
    FROM unnest(%(segment_id)s::bigint[], %(sequence)s::integer[], %(entered_s)s::float8[], %(factor)b::bytea[])
         AS t (segment_id, sequence, entered_s, factor)
    JOIN segments AS s ON s.id = t.segment_id
"""

# However many passes there were, those that are not in a sum are few; an index knows them.
OVER = """
    SELECT p.id, p.drive_id, r.pass_id IS NULL AS accepted, p.factor, p.segment_id, p.sequence
    FROM drive_passes AS p
    LEFT JOIN rejected_passes AS r
        ON r.segment_id = p.segment_id AND r.pass_id = p.id AND r.segment_id = ANY(%(ids)s::bigint[])
    WHERE p.segment_id = ANY(%(ids)s::bigint[]) AND p.partition = ANY(%(partitions)s::smallint[])
        AND p.condensed_weight IS NULL AND (SELECT duplicate_of IS NULL FROM drives WHERE id = p.drive_id)
    ORDER BY p.drive_id, p.sequence
"""
_REGIONS = text(
    "SELECT DISTINCT versant_partition(cell) FROM segments WHERE id = ANY(CAST(:ids AS bigint[])) ORDER BY 1"
)

# What all passes of a drive together say of its constants, so that a window need not read those outside of it; and what
# tells the drive from others (``twins``).
_DELETE_CONSTANTS = text("DELETE FROM drive_constants WHERE drive_id = :drive_id")
_INSERT_CONSTANTS = """
    INSERT INTO drive_constants (drive_id, passes, evidence, measurements, epoch_s, partitions)
    VALUES (%(drive_id)s, %(passes)s, %(evidence)b, %(measurements)s, %(epoch_s)b, %(partitions)s::smallint[])
"""
_CONSTANTS = "SELECT drive_id, passes, evidence FROM drive_constants WHERE drive_id = ANY(%(ids)s::uuid[])"

# A drive that comes can turn the verdict over passes of others. One that is going just now takes its verdicts along,
# and over what has been summed meanwhile the verdict stands.
_REJECT = text(
    """
    INSERT INTO rejected_passes (segment_id, pass_id, drive_id)
    SELECT segment_id, id, drive_id FROM drive_passes
    WHERE id = ANY(CAST(:ids AS bigint[])) AND partition = ANY(CAST(:partitions AS smallint[]))
        AND condensed_weight IS NULL
    FOR KEY SHARE SKIP LOCKED
    ON CONFLICT DO NOTHING
    """
)
_HEAR = text(
    """
    DELETE FROM rejected_passes
    WHERE segment_id = ANY(CAST(:segments AS bigint[])) AND pass_id = ANY(CAST(:ids AS bigint[]))
    """
)

_MOMENTS = text(f"SELECT DISTINCT floor(entered_s) FROM drive_passes WHERE {_ITS}")  # noqa: S608 - constants


class StoredPass(NamedTuple):
    """A pass with its row's id (None: it is not stored), its drive and the verdict that stands over it."""

    id: int | None
    drive_id: uuid.UUID
    accepted: bool
    factor: PassFactor


def replace_passes(
    session: Session, drive_id: uuid.UUID, factors: Sequence[PassFactor], epoch_s: Floats
) -> set[int]:
    """Exchange the drive's passes for ``factors``, whose segments are database ids; the segments of both.

    ``epoch_s`` are the times of the log's positions, shape (e,), Unix seconds.
    """
    session.execute(_KEEP, {"drive_id": drive_id})
    gone = fetch_binary(session, _DELETE, of_drive(session, drive_id))
    subtract_condensed(session, condensed_of_drive(session, drive_id, gone))
    session.execute(_DELETE_VERDICTS, {"drive_id": drive_id})
    session.execute(_DELETE_CONSTANTS, {"drive_id": drive_id})
    touched = {segment for segment, *_ in gone}
    if factors:
        columns = {
            "segment_id": np.array([f.segment for f in factors]),
            "sequence": np.array([f.sequence for f in factors]),
            "entered_s": np.array([f.first_time_s for f in factors], float),
            "factor": PassFactor.encode_all(factors),
        }
        send_binary(session, _INSERT, {"drive_id": drive_id, **columns})
        whole = {
            "passes": len(factors),
            "evidence": ConstantsInformation.of_passes(factors).encode(),
            "measurements": sum(f.rows for f in factors),
            "epoch_s": np.asarray(epoch_s, "<f8").tobytes(),
            "partitions": partitions_of(session, {f.segment for f in factors}),
        }
        send_binary(session, _INSERT_CONSTANTS, {"drive_id": drive_id, **whole})
    return touched | {f.segment for f in factors}


def partitions_of(session: Session, segment_ids: Collection[int]) -> list[int]:
    """The partitions by which the passes over these segments are parted."""
    return list(session.execute(_REGIONS, {"ids": list(segment_ids)}).scalars())


def moments_of(session: Session, drive_id: uuid.UUID) -> set[float]:
    """When the drive came to its segments, Unix seconds."""
    return set(session.execute(_MOMENTS, of_drive(session, drive_id)).scalars())


def passes_over(session: Session, segment_ids: Collection[int]) -> list[StoredPass]:
    """The passes over these segments that are in no sum, but for those of drives that are there already; drive by drive
    as driven."""
    rows = fetch_binary(
        session, OVER, {"ids": list(segment_ids), "partitions": partitions_of(session, segment_ids)}
    )
    factors = PassFactor.decode_all([row[3:] for row in rows])
    return [
        StoredPass(key, drive_id, accepted, factor)
        for (key, drive_id, accepted, *_), factor in zip(rows, factors, strict=True)
    ]


def said_elsewhere(
    session: Session, drives: Sequence[Sequence[StoredPass]]
) -> dict[int, ConstantsInformation]:
    """What the drives' other passes say of their constants, by place in ``drives``: the whole less what is here.

    A pass that is in a sum, here or elsewhere, is not here: it says as little of the constants as any pass does over a
    road of which next to nothing is known, and less than it would say among the others.
    """
    ids = [said[0].drive_id for said in drives]
    whole = {key: (count, said) for key, count, said in fetch_binary(session, _CONSTANTS, {"ids": ids})}
    found = {}
    for k, passes in enumerate(drives):
        count, said = whole.get(passes[0].drive_id, (0, b""))
        if count > len(passes):
            found[k] = ConstantsInformation.decode(said) - ConstantsInformation.of_passes(
                [p.factor for p in passes]
            )
    return found


def by_drive(passes: Iterable[StoredPass]) -> list[list[StoredPass]]:
    """The passes of each drive, drives in the order in which they were driven.

    Not in that of their coming: the sums over them would differ in the last digits.
    """
    drives: dict[uuid.UUID, list[StoredPass]] = {}
    for one in passes:
        drives.setdefault(one.drive_id, []).append(one)
    return sorted(
        drives.values(), key=lambda said: (min(p.factor.first_time_s for p in said), said[0].drive_id)
    )


def set_accepted(session: Session, heard: Sequence[StoredPass], rejected: Sequence[StoredPass]) -> None:
    """Write which passes are heard from now on, and which are not."""
    for statement, passes in ((_HEAR, heard), (_REJECT, rejected)):
        if passes:
            segments = sorted({p.factor.segment for p in passes})
            ids = sorted(p.id for p in passes if p.id is not None)
            values = {"ids": ids, "segments": segments, "partitions": partitions_of(session, segments)}
            session.execute(statement, values)
