"""Sums of old passes: a solution reads a bounded jury of the newest over a segment, and the others as one sum.

A pass is in the jury until it is summed, once in its life; what is in a sum is taken off again when its drive goes or
turns out to be there twice. Sums are rows that are added and, by whoever sums or takes off, put together; a row of a
pass and its part in a sum change in one transaction. So nobody waits for anybody, whoever dies leaves the evidence as
it was, and nothing is in both or in neither.

What is taken off is computed as it was when it was added. Whoever changes how (``fusion.network.condensed``, and what
``fusion.network.outside_passes`` says of a pass) lets a migration empty ``condensed_passes`` and
``drive_passes.condensed_weight``: nothing is lost, and solvers sum anew.
"""

from __future__ import annotations

import uuid
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import fetch_binary, send_binary
from fusion.network.condensed import CondensedPasses
from fusion.network.curve import knot_length
from fusion.network.outside_passes import ConstantsInformation
from fusion.network.pass_factor import PassFactor

RECENT_PASSES = 48
"""Passes over a segment that are read as they are: up to twice as many, then the older ones are summed until at most so
many are left. Slopes with 24 and with 96 are as near to those of all passes, and solutions take half and twice as long
(``benchmarks/evidence``); so many are a fair verdict over roads that change."""
AT_ONCE = 200
"""Passes that are summed in one transaction, some tens of milliseconds: whoever changes their drives waits for it."""
MOST_CONDENSED = 5000
"""Passes that are summed after one solution, a millisecond each: nobody waits for long, and the rest comes later."""

# A statement that names drives names their partitions as well, as a value known at planning time: PostgreSQL then reads
# only those parts of the table.
OF_DRIVE = "drive_id = {0}drive_id{1} AND partition = ANY(CAST({0}partitions{1} AS smallint[]))"
_MINE = OF_DRIVE.format("%(", ")s")
_DRIVE_REGIONS = text(
    """
    SELECT DISTINCT unnest(partitions) FROM drive_constants WHERE drive_id = ANY(CAST(:ids AS uuid[])) ORDER BY 1
    """
)

_OVER = (
    "SELECT segment_id, evidence FROM condensed_passes WHERE segment_id = ANY(%(ids)s::bigint[]) ORDER BY id"
)
_TAKE = (
    "DELETE FROM condensed_passes WHERE segment_id = ANY(%(ids)s::bigint[]) RETURNING segment_id, evidence"
)
# What others are at is left to them: nobody waits.
_TAKE_FREE = """
    DELETE FROM condensed_passes WHERE id IN (
        SELECT id FROM condensed_passes WHERE segment_id = ANY(%(ids)s::bigint[]) FOR UPDATE SKIP LOCKED)
    RETURNING segment_id, evidence
"""
_APPEND = """
    INSERT INTO condensed_passes (segment_id, evidence)
    SELECT * FROM unnest(%(ids)s::bigint[], %(evidence)b::bytea[])
"""
_LENGTHS = text("SELECT id, length_m FROM segments WHERE id = ANY(CAST(:ids AS bigint[]))")
_SAID = "SELECT drive_id, evidence, passes FROM drive_constants WHERE drive_id = ANY(%(ids)s::uuid[])"

# Drives that are being replaced, removed or found to be there twice just now are left alone; the others wait.
_KEEP_DRIVES = text(
    """
    SELECT id FROM drives WHERE id = ANY(CAST(:ids AS uuid[])) AND duplicate_of IS NULL
    ORDER BY id FOR SHARE SKIP LOCKED
    """
)
_SUM = text(
    """
    UPDATE drive_passes AS p SET condensed_weight = t.weight
    FROM unnest(CAST(:ids AS bigint[]), CAST(:weights AS float8[])) AS t (id, weight)
    WHERE p.id = t.id AND p.partition = ANY(CAST(:partitions AS smallint[])) AND p.condensed_weight IS NULL
    RETURNING p.id
    """
)
_UNSUM = f"""
    WITH summed AS MATERIALIZED (
        SELECT id, partition, condensed_weight FROM drive_passes WHERE {_MINE} AND condensed_weight IS NOT NULL
    )
    UPDATE drive_passes AS p SET condensed_weight = NULL
    FROM summed AS s WHERE p.id = s.id AND p.partition = s.partition
    RETURNING p.segment_id, p.sequence, s.condensed_weight, p.factor
"""  # noqa: S608 - constants
_SUMMED = f"""
    SELECT segment_id, sequence, condensed_weight, factor FROM drive_passes
    WHERE {_MINE} AND condensed_weight > 0 AND segment_id = ANY(%(ids)s::bigint[])
"""  # noqa: S608 - constants

SummedRow = tuple[Any, ...]
"""Segment, sequence, the weight with which it was summed (None: it was not), and the factor's bytes, of a pass."""


class OldPass(NamedTuple):
    """A pass that is to be summed: its row's id, what it says, and how much it counted in the last solution."""

    id: int
    drive_id: uuid.UUID
    factor: PassFactor
    weight: float


def condensed_over(
    session: Session, segment_ids: Collection[int], without: uuid.UUID | None = None
) -> dict[int, CondensedPasses]:
    """The sums over these segments, but for what one drive has in them."""
    found = _added(fetch_binary(session, _OVER, {"ids": list(segment_ids)}))
    if found and without is not None:
        rows = fetch_binary(session, _SUMMED, {**of_drive(session, without), "ids": list(found)})
        for segment, own in condensed_of_drive(session, without, rows).items():
            found[segment] = found[segment] + -own
    return {segment: one for segment, one in found.items() if one.passes > 0}


def condensed_of_drive(
    session: Session, drive_id: uuid.UUID, rows: Iterable[SummedRow]
) -> dict[int, CondensedPasses]:
    """What these passes of a drive are in the sums of their segments, by what is stored alone."""
    heard = [(data, segment, sequence, weight) for segment, sequence, weight, data in rows if weight]
    if not heard:
        return {}
    factors = PassFactor.decode_all([row[:3] for row in heard])
    over: dict[int, list[tuple[PassFactor, float]]] = {}
    for factor, (*_, weight) in zip(factors, heard, strict=True):
        over.setdefault(factor.segment, []).append((factor, weight))
    whole = _said(session, [drive_id])[drive_id]
    lengths = _lengths(session, over)
    return {segment: _sum_of(said, whole, lengths[segment]) for segment, said in over.items()}


def of_drive(session: Session, drive_id: uuid.UUID) -> dict[str, Any]:
    """The values of a statement on the passes of one drive (``OF_DRIVE``)."""
    return {"drive_id": drive_id, "partitions": drive_partitions(session, [drive_id])}


def drive_partitions(session: Session, drive_ids: Collection[uuid.UUID]) -> list[int]:
    """The partitions in which drives have passes."""
    return list(session.execute(_DRIVE_REGIONS, {"ids": list(drive_ids)}).scalars())


def append_condensed(session: Session, sums: Mapping[int, CondensedPasses]) -> None:
    """Add to the sums of segments."""
    if sums:
        send_binary(
            session, _APPEND, {"ids": list(sums), "evidence": [one.encode() for one in sums.values()]}
        )


def uncondense_drive(session: Session, drive_id: uuid.UUID) -> None:
    """Take a drive that is heard no longer off all sums: its passes are as if they had never been in one."""
    subtract_condensed(
        session,
        condensed_of_drive(session, drive_id, fetch_binary(session, _UNSUM, of_drive(session, drive_id))),
    )


def subtract_condensed(session: Session, said: Mapping[int, CondensedPasses]) -> None:
    """Take what a drive had said off the sums of segments. Nobody waits, and no row tells what the drive had said."""
    if not said:
        return
    ids = {"ids": sorted(said)}
    found = _added(fetch_binary(session, _TAKE_FREE, ids))
    left = {segment for segment, _ in fetch_binary(session, _OVER, ids)}
    for segment, one in said.items():
        found[segment] = found[segment] + -one if segment in found else -one
    append_condensed(session, {k: one for k, one in found.items() if one.passes != 0 or k in left})


def passes_to_condense(passes: Sequence[OldPass]) -> list[OldPass]:
    """Of the passes over one segment those that are to be summed, the oldest first; none before they are twice a jury.

    Drives go as a whole, so that one is never in the jury and in the sum. The newest stays, however often it passed.
    """
    if len(passes) <= 2 * RECENT_PASSES:
        return []
    drives: dict[uuid.UUID, list[OldPass]] = {}
    for one in passes:
        drives.setdefault(one.drive_id, []).append(one)
    newest_first = sorted(
        drives.values(), key=lambda said: (max(p.factor.first_time_s for p in said), said[0].drive_id)
    )[::-1]
    stay, count = 1, len(newest_first[0])
    while stay < len(newest_first) and count + len(newest_first[stay]) <= RECENT_PASSES:
        count += len(newest_first[stay])
        stay += 1
    return [p for said in newest_first[stay:][::-1] for p in said]


def portions(old: Iterable[OldPass], size: int) -> Iterator[list[OldPass]]:
    """Old passes, segment by segment and drive by drive, in portions of ``size`` and the rest of the last drive's."""
    portion: list[OldPass] = []
    for _, said in groupby(old, key=lambda p: (p.factor.segment, p.drive_id)):
        portion += said
        if len(portion) >= size:
            yield portion
            portion = []
    if portion:
        yield portion


def condensed_by_drive(
    session: Session, old: Sequence[OldPass]
) -> dict[tuple[int, uuid.UUID], CondensedPasses]:
    """What is to be added for each drive on each segment. Takes its time; nothing is written."""
    over: dict[tuple[int, uuid.UUID], list[tuple[PassFactor, float]]] = {}
    for one in old:
        over.setdefault((one.factor.segment, one.drive_id), []).append((one.factor, one.weight))
    said = _said(session, {drive for _, drive in over})
    lengths = _lengths(session, {segment for segment, _ in over})
    return {
        (segment, drive): _sum_of(passes, said[drive], lengths[segment])
        for (segment, drive), passes in over.items()
        if drive in said and segment in lengths
    }


def condense(
    session: Session,
    old: Sequence[OldPass],
    made: Mapping[tuple[int, uuid.UUID], CondensedPasses],
    partitions: Sequence[int],
) -> None:
    """Put those of the old passes that are still there and in no sum into the sums of their segments (``made``)."""
    drives = sorted({p.drive_id for p in old})
    free = set(session.execute(_KEEP_DRIVES, {"ids": drives}).scalars())
    mine = [p for p in old if p.drive_id in free and (p.factor.segment, p.drive_id) in made]
    values = {
        "ids": [p.id for p in mine],
        "weights": [p.weight for p in mine],
        "partitions": list(partitions),
    }
    came = set(session.execute(_SUM, values).scalars())
    # A drive's passes over a segment are summed together or not at all, for its row is kept.
    done = {(p.factor.segment, p.drive_id) for p in mine if p.id in came}
    if not done:
        return
    found = _added(fetch_binary(session, _TAKE, {"ids": sorted({segment for segment, _ in done})}))
    for segment, drive in sorted(done):
        one = made[segment, drive]
        found[segment] = found[segment] + one if segment in found else one
    append_condensed(session, {segment: one for segment, one in found.items() if one.passes != 0})


def _added(rows: Iterable[tuple[int, bytes]]) -> dict[int, CondensedPasses]:
    found: dict[int, CondensedPasses] = {}
    for segment, data in rows:
        one = CondensedPasses.decode(data)
        found[segment] = found[segment] + one if segment in found else one
    return found


def _sum_of(
    passes: Sequence[tuple[PassFactor, float]], whole: tuple[ConstantsInformation, int], length_m: float
) -> CondensedPasses:
    ordered = sorted(passes, key=lambda pair: pair[0].sequence)
    return CondensedPasses.of_drive(
        [p for p, _ in ordered], [weight for _, weight in ordered], *whole, length_m
    )


def _said(
    session: Session, drive_ids: Collection[uuid.UUID]
) -> dict[uuid.UUID, tuple[ConstantsInformation, int]]:
    """What all passes of each drive say of its constants, and how many they are."""
    rows = fetch_binary(session, _SAID, {"ids": sorted(drive_ids)})
    return {drive: (ConstantsInformation.decode(data), count) for drive, data, count in rows}


def _lengths(session: Session, segment_ids: Collection[int]) -> dict[int, float]:
    """What the knots of segments assume that they are long, m."""
    rows = session.execute(_LENGTHS, {"ids": sorted(segment_ids)})
    return {row.id: float(knot_length(row.length_m)) for row in rows}
