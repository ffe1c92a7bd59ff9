"""Condensed passes: a solution reads a bounded number of recent passes over a segment, and all older ones as one sum.

A pass is recent until it is condensed, which happens once. When its drive is removed or becomes a duplicate, the pass
is subtracted from the sum again. Sums are rows that are added, and merged by whoever condenses or subtracts; the row
of a pass and its part of a sum change in one transaction. So nobody waits for anybody, an interrupted process leaves
the evidence as it was, and no pass is counted twice or not at all.

What is subtracted is computed as it was when it was added. Whoever changes that computation
(``fusion.network.condensed``) lets a migration empty
``condensed_passes`` and ``drive_passes.condensed_weight``: nothing is lost, and solvers condense anew.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import bigints, fetch_binary, send_binary
from fusion.network.condensed import CondensedPasses
from fusion.network.curve import knot_length
from fusion.network.drive_constants import ConstantsInformation
from fusion.network.pass_factor import PassFactor

RECENT_PASSES = 48
"""Passes over a segment that are read one by one. From twice as many on, the older ones are condensed until at most so
many are left. Slopes with 24 and with 96 are as near to those of all passes, and solutions take half and twice as long
(``benchmarks/evidence``); so many still tell which passes to reject over roads that change."""
AT_ONCE = 200
"""Passes that are condensed in one transaction of some tens of milliseconds; whoever changes their drives waits."""
MOST_CONDENSED = 5000
"""Passes that are condensed after one solution, a millisecond each; the rest comes later."""

# A statement that names drives names their partitions as well, as a value known at planning time: PostgreSQL then reads
# only those parts of the table.
OF_DRIVE = "drive_id = {0}drive_id{1} AND partition = ANY(CAST({0}partitions{1} AS smallint[]))"
_MINE = OF_DRIVE.format("%(", ")s")
_PARTITIONS = text("""
    SELECT DISTINCT unnest(partitions) FROM drive_constants WHERE drive_id = ANY(CAST(:ids AS uuid[])) ORDER BY 1
""")

_OVER = (
    "SELECT segment_id, evidence FROM condensed_passes WHERE segment_id = ANY(%(ids)s::bigint[]) ORDER BY id"
)
_TAKE = (
    "DELETE FROM condensed_passes WHERE segment_id = ANY(%(ids)s::bigint[]) RETURNING segment_id, evidence"
)
# Rows that others have locked are left to them: nobody waits.
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
_CONSTANTS = "SELECT drive_id, evidence, passes FROM drive_constants WHERE drive_id = ANY(%(ids)s::uuid[])"

# Drives that somebody replaces, removes or marks as duplicates just now are left alone; others who want that wait.
_KEEP_DRIVES = text("""
    SELECT id FROM drives WHERE id = ANY(CAST(:ids AS uuid[])) AND duplicate_of IS NULL
    ORDER BY id FOR SHARE SKIP LOCKED
""")
_MARK_CONDENSED = text("""
    UPDATE drive_passes AS p SET condensed_weight = t.weight
    FROM unnest(CAST(:ids AS bigint[]), CAST(:weights AS float8[])) AS t (id, weight)
    WHERE p.id = t.id AND p.partition = ANY(CAST(:partitions AS smallint[])) AND p.condensed_weight IS NULL
    RETURNING p.id
""")
_MARK_RECENT = f"""
    WITH condensed AS MATERIALIZED (
        SELECT id, partition, condensed_weight FROM drive_passes WHERE {_MINE} AND condensed_weight IS NOT NULL
    )
    UPDATE drive_passes AS p SET condensed_weight = NULL
    FROM condensed AS c WHERE p.id = c.id AND p.partition = c.partition
    RETURNING p.segment_id, p.sequence, c.condensed_weight, p.factor
"""  # noqa: S608 - constants
_CONDENSED = f"""
    SELECT segment_id, sequence, condensed_weight, factor FROM drive_passes
    WHERE {_MINE} AND condensed_weight > 0 AND segment_id = ANY(%(ids)s::bigint[])
"""  # noqa: S608 - constants

CondensedRow = tuple[Any, ...]
"""Of a pass: segment, sequence, the weight with which it was condensed (None: it is recent), and the factor's bytes."""


class StoredPass(NamedTuple):
    """A pass: the id of its row (None: it is not stored), its drive, whether it is accepted, and its factor.

    ``weight``: of one that is to be condensed, in the last solution.
    """

    id: int | None
    drive_id: uuid.UUID
    accepted: bool
    factor: PassFactor
    weight: float = 1.0


def condensed_over(
    session: Session, segment_ids: Collection[int], without: uuid.UUID | None = None
) -> dict[int, CondensedPasses]:
    """The condensed passes over these segments, ``without`` those of one drive."""
    sums = _added(fetch_binary(session, _OVER, {"ids": bigints(segment_ids)}))
    if sums and without is not None:
        rows = fetch_binary(session, _CONDENSED, {**of_drive(session, without), "ids": list(sums)})
        for segment, own in condensed_of_drive(session, without, rows).items():
            sums[segment] = sums[segment] + -own
    return {segment: one for segment, one in sums.items() if one.passes > 0}


def condensed_of_drive(
    session: Session, drive_id: uuid.UUID, rows: Iterable[CondensedRow]
) -> dict[int, CondensedPasses]:
    """What these passes of a drive contribute to the condensed passes of their segments, from what is stored alone."""
    weighted = [(data, segment, sequence, weight) for segment, sequence, weight, data in rows if weight]
    if not weighted:
        return {}
    factors = PassFactor.decode_all([row[:3] for row in weighted])
    passes = [
        StoredPass(None, drive_id, True, factor, row[3])
        for factor, row in zip(factors, weighted, strict=True)
    ]
    return {segment: one for (segment, _), one in condensed_by_drive(session, passes).items()}


def of_drive(session: Session, drive_id: uuid.UUID) -> dict[str, Any]:
    """The values of a statement on the passes of one drive (``OF_DRIVE``)."""
    return {"drive_id": drive_id, "partitions": drive_partitions(session, [drive_id])}


def drive_partitions(session: Session, drive_ids: Collection[uuid.UUID]) -> list[int]:
    """The partitions in which drives have passes."""
    return list(session.execute(_PARTITIONS, {"ids": list(drive_ids)}).scalars())


def append_condensed(session: Session, sums: Mapping[int, CondensedPasses]) -> None:
    """Add to the condensed passes of segments."""
    if sums:
        evidence = [one.encode() for one in sums.values()]
        send_binary(session, _APPEND, {"ids": list(sums), "evidence": evidence})


def uncondense_drive(session: Session, drive_id: uuid.UUID) -> None:
    """Subtract a drive from all condensed passes: its passes are recent, as if they had never been condensed."""
    rows = fetch_binary(session, _MARK_RECENT, of_drive(session, drive_id))
    subtract_condensed(session, condensed_of_drive(session, drive_id, rows))


def subtract_condensed(session: Session, contributions: Mapping[int, CondensedPasses]) -> None:
    """Subtract a drive's contributions from the condensed passes of segments.

    Nobody waits, and no row that remains tells what the drive contributed.
    """
    if not contributions:
        return
    ids = {"ids": sorted(contributions)}
    sums = _added(fetch_binary(session, _TAKE_FREE, ids))
    locked = {segment for segment, _ in fetch_binary(session, _OVER, ids)}
    for segment, one in contributions.items():
        _add(sums, segment, -one)
    append_condensed(session, {k: one for k, one in sums.items() if one.passes != 0 or k in locked})


def oldest(over: Mapping[int, Sequence[StoredPass]]) -> list[StoredPass]:
    """Of the passes over each segment those that are to be condensed now, at most some more than ``MOST_CONDENSED``."""
    old = (p for segment in sorted(over) for p in passes_to_condense(over[segment]))
    return next(portions(old, MOST_CONDENSED), [])


def passes_to_condense(passes: Sequence[StoredPass]) -> list[StoredPass]:
    """Of the passes over one segment those to be condensed, the oldest first; none below twice ``RECENT_PASSES``.

    All passes of a drive are condensed together. The newest drive stays, however often it passed.
    """
    if len(passes) <= 2 * RECENT_PASSES:
        return []
    newest_first = by_drive(passes, max)[::-1]
    stay, count = 1, len(newest_first[0])
    while stay < len(newest_first) and count + len(newest_first[stay]) <= RECENT_PASSES:
        count += len(newest_first[stay])
        stay += 1
    return [p for laps in newest_first[stay:][::-1] for p in laps]


def by_drive(
    passes: Iterable[StoredPass], moment: Callable[[Iterator[float]], float] = min
) -> list[list[StoredPass]]:
    """The passes of each drive, drives in the order in which they were driven: by that moment of the passes of each.

    In the order of their uploads the sums over them would differ in the last digits.
    """
    drives: dict[uuid.UUID, list[StoredPass]] = {}
    for one in passes:
        drives.setdefault(one.drive_id, []).append(one)
    return sorted(
        drives.values(), key=lambda laps: (moment(p.factor.first_time_s for p in laps), laps[0].drive_id)
    )


def portions(old: Iterable[StoredPass], size: int) -> Iterator[list[StoredPass]]:
    """Old passes, segment by segment and drive by drive, in portions of ``size`` and the rest of the last drive's."""
    portion: list[StoredPass] = []
    for _, laps in groupby(old, key=lambda p: (p.factor.segment, p.drive_id)):
        portion += laps
        if len(portion) >= size:
            yield portion
            portion = []
    if portion:
        yield portion


def condensed_by_drive(
    session: Session, old: Sequence[StoredPass]
) -> dict[tuple[int, uuid.UUID], CondensedPasses]:
    """The contribution of each drive to each segment, by (segment, drive). It takes its time; nothing is written."""
    over: dict[tuple[int, uuid.UUID], list[StoredPass]] = {}
    for one in old:
        over.setdefault((one.factor.segment, one.drive_id), []).append(one)
    constants = drive_constants(session, {drive for _, drive in over})
    rows = session.execute(_LENGTHS, {"ids": sorted({segment for segment, _ in over})})
    knots_m = {row.id: float(knot_length(row.length_m)) for row in rows}
    made = {}
    for (segment, drive), passes in over.items():
        if drive in constants and segment in knots_m:
            ordered = sorted(passes, key=lambda p: p.factor.sequence)
            factors, weights = [p.factor for p in ordered], [p.weight for p in ordered]
            made[segment, drive] = CondensedPasses.of_drive(
                factors, weights, *constants[drive], knots_m[segment]
            )
    return made


def condense(
    session: Session,
    old: Sequence[StoredPass],
    contributions: Mapping[tuple[int, uuid.UUID], CondensedPasses],
    partitions: Sequence[int],
) -> None:
    """Add those of the old passes that are still recent to the condensed passes of their segments."""
    drives = sorted({p.drive_id for p in old})
    free = set(session.execute(_KEEP_DRIVES, {"ids": drives}).scalars())
    mine = [p for p in old if p.drive_id in free and (p.factor.segment, p.drive_id) in contributions]
    values = {
        "ids": [p.id for p in mine],
        "weights": [p.weight for p in mine],
        "partitions": list(partitions),
    }
    marked = set(session.execute(_MARK_CONDENSED, values).scalars())
    # A drive's passes over a segment are marked together or not at all, because its row is locked.
    done = {(p.factor.segment, p.drive_id) for p in mine if p.id in marked}
    if not done:
        return
    sums = _added(fetch_binary(session, _TAKE, {"ids": sorted({segment for segment, _ in done})}))
    for segment, drive in sorted(done):
        _add(sums, segment, contributions[segment, drive])
    append_condensed(session, {segment: one for segment, one in sums.items() if one.passes != 0})


def _added(rows: Iterable[tuple[int, bytes]]) -> dict[int, CondensedPasses]:
    """The sum of the rows of each segment."""
    sums: dict[int, CondensedPasses] = {}
    for segment, data in rows:
        _add(sums, segment, CondensedPasses.decode(data))
    return sums


def _add(sums: dict[int, CondensedPasses], segment: int, one: CondensedPasses) -> None:
    sums[segment] = sums[segment] + one if segment in sums else one


def drive_constants(
    session: Session, drive_ids: Collection[uuid.UUID]
) -> dict[uuid.UUID, tuple[ConstantsInformation, int]]:
    """What all passes of each drive say of its constants, and how many they are."""
    rows = fetch_binary(session, _CONSTANTS, {"ids": sorted(drive_ids)})
    return {drive: (ConstantsInformation.decode(data), count) for drive, data, count in rows}


def constants_outside(
    session: Session, drives: Sequence[Sequence[StoredPass]]
) -> dict[int, ConstantsInformation]:
    """What passes of the drives outside of these say of their constants, by place in ``drives``: all less these.

    A condensed pass, here or elsewhere, counts as outside: it says as little of the constants as any pass does over a
    road of which next to nothing is known, and less than it would say among the others.
    """
    stored = drive_constants(session, {passes[0].drive_id for passes in drives})
    outside = {}
    for k, passes in enumerate(drives):
        constants, count = stored.get(passes[0].drive_id, (ConstantsInformation.nothing(), 0))
        if count > len(passes):
            outside[k] = constants - ConstantsInformation.of_passes([p.factor for p in passes])
    return outside
