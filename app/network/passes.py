"""The passes that drives contribute: written drive by drive, read by the segments that they are over.

Passes are the truth; slopes are made of them (``solve``). Those of a drive that is there already, under another id, are
stored but not read (``twins``).
"""

from __future__ import annotations

import uuid
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import fetch_binary, send_binary
from fusion.network.elsewhere import ConstantsSaid
from fusion.network.pass_factor import PassFactor
from fusion.types import Floats

# Statements with %(name)s are executed by psycopg itself, which takes and gives bytes as they are (``app.core.db``).

_DELETE = text("DELETE FROM drive_passes WHERE drive_id = :drive_id RETURNING segment_id")

_INSERT = """
    INSERT INTO drive_passes (drive_id, segment_id, sequence, entered_s, factor, accepted)
    SELECT %(drive_id)s, t.segment_id, t.sequence, t.entered_s, t.factor, true
    FROM unnest(%(segment_id)s::bigint[], %(sequence)s::integer[], %(entered_s)s::float8[], %(factor)b::bytea[])
         AS t (segment_id, sequence, entered_s, factor)
"""

_OVER = """
    SELECT p.id, p.drive_id, p.accepted, p.factor, p.segment_id, p.sequence
    FROM drive_passes AS p
    WHERE p.segment_id = ANY(%(ids)s::bigint[]) AND (SELECT same_as IS NULL FROM drives WHERE id = p.drive_id)
    ORDER BY p.drive_id, p.sequence
"""

# What all passes of a drive together say of its constants, so that a window need not read those outside of it; and what
# tells the drive from others (``twins``).
_DELETE_CONSTANTS = text("DELETE FROM drive_constants WHERE drive_id = :drive_id")
_INSERT_CONSTANTS = """
    INSERT INTO drive_constants (drive_id, passes, said, measurements, epoch_s)
    VALUES (%(drive_id)s, %(passes)s, %(said)b, %(measurements)s, %(epoch_s)b)
"""
_CONSTANTS = "SELECT drive_id, passes, said FROM drive_constants WHERE drive_id = ANY(%(ids)s::uuid[])"

# A drive that comes can turn the verdict over passes of others.
_SET_VERDICTS = text(
    """
    UPDATE drive_passes AS p SET accepted = t.accepted
    FROM unnest(CAST(:ids AS bigint[]), CAST(:accepted AS boolean[])) AS t (id, accepted) WHERE p.id = t.id
    """
)

# A segment is heard where any of the drive's passes over it is; one that is there already contradicts nobody.
_HEARD = text(
    """
    SELECT count(*) AS segments, count(*) FILTER (WHERE NOT heard) AS rejected
    FROM (SELECT bool_or(p.accepted OR d.same_as IS NOT NULL) AS heard
          FROM drive_passes AS p JOIN drives AS d ON d.id = p.drive_id WHERE p.drive_id = :drive_id
          GROUP BY p.segment_id) AS one
    """
)


_MOMENTS = text("SELECT DISTINCT floor(entered_s) FROM drive_passes WHERE drive_id = :drive_id")


class StoredPass(NamedTuple):
    """A pass with its row's id (None: it is not stored), its drive and the verdict that stands over it."""

    id: int | None
    drive_id: uuid.UUID
    accepted: bool
    factor: PassFactor


class Hearing(NamedTuple):
    """On how many segments a drive has passes, and on how many of them none is heard."""

    segments: int
    rejected: int


def replace_passes(
    session: Session, drive_id: uuid.UUID, factors: Sequence[PassFactor], epoch_s: Floats
) -> set[int]:
    """Exchange the drive's passes for ``factors``, whose segments are database ids; the segments of both.

    ``epoch_s`` are the times of the log's positions, shape (e,), Unix seconds.
    """
    touched = set(session.execute(_DELETE, {"drive_id": drive_id}).scalars())
    session.execute(_DELETE_CONSTANTS, {"drive_id": drive_id})
    if factors:
        columns = {
            "segment_id": [f.segment for f in factors],
            "sequence": [f.sequence for f in factors],
            "entered_s": [f.first_time_s for f in factors],
            "factor": [f.encode() for f in factors],
        }
        send_binary(session, _INSERT, {"drive_id": drive_id, **columns})
        whole = {
            "passes": len(factors),
            "said": ConstantsSaid.of_passes(factors).encode(),
            "measurements": sum(f.rows for f in factors),
            "epoch_s": np.asarray(epoch_s, "<f8").tobytes(),
        }
        send_binary(session, _INSERT_CONSTANTS, {"drive_id": drive_id, **whole})
    return touched | {f.segment for f in factors}


def moments_of(session: Session, drive_id: uuid.UUID) -> set[float]:
    """When the drive came to its segments, Unix seconds."""
    return set(session.execute(_MOMENTS, {"drive_id": drive_id}).scalars())


def passes_over(session: Session, segment_ids: Collection[int]) -> list[StoredPass]:
    """All passes over these segments but those of drives that are there already; drive by drive as driven."""
    rows = fetch_binary(session, _OVER, {"ids": list(segment_ids)})
    factors = PassFactor.decode_all([row[3:] for row in rows])
    return [
        StoredPass(key, drive_id, accepted, factor)
        for (key, drive_id, accepted, *_), factor in zip(rows, factors, strict=True)
    ]


def said_elsewhere(session: Session, drives: Sequence[Sequence[StoredPass]]) -> dict[int, ConstantsSaid]:
    """What the drives' other passes say of their constants, by place in ``drives``: the whole less what is here."""
    ids = [said[0].drive_id for said in drives]
    whole = {key: (count, said) for key, count, said in fetch_binary(session, _CONSTANTS, {"ids": ids})}
    found = {}
    for k, passes in enumerate(drives):
        count, said = whole.get(passes[0].drive_id, (0, b""))
        if count > len(passes):
            found[k] = ConstantsSaid.decode(said) - ConstantsSaid.of_passes([p.factor for p in passes])
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


def set_verdicts(session: Session, verdicts: Mapping[int, bool]) -> None:
    """Write whether passes, by id, are heard."""
    if verdicts:
        session.execute(_SET_VERDICTS, {"ids": list(verdicts), "accepted": list(verdicts.values())})


def hearing(session: Session, drive_id: uuid.UUID) -> Hearing:
    """How far the drive agrees with the others over the same segments, by the verdicts that stand."""
    return Hearing(*session.execute(_HEARD, {"drive_id": drive_id}).one())
