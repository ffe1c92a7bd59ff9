"""What was measured on roads that are lost: kept for a stated time, and brought back when such a road comes back.

Kept is what drives say, not what follows from it: passes in full, whether they were in a sum or not, and estimates. It
comes back as it was for drives that have not been computed anew since; the others are computed once more. What moves to
a segment of another length is carried over (``fusion.network.transfer``).
"""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Sessions, fetch_binary, send_binary
from app.network.passes import partitions_of
from fusion.network.pass_factor import PassFactor
from fusion.network.transfer import Carrying, Ends
from fusion.roads.changes import ends_apart_m, ends_of
from fusion.roads.table import RoadTable
from fusion.types import Ints

# --- into the attic

_RUN = "(SELECT max(id) FROM provenances AS v WHERE v.drive_id = {0}.drive_id)"
_KEEP = text(
    """
    INSERT INTO retired_segments (segment_id, osm_way_id, from_node, to_node, geom, length_m)
    SELECT s.id, s.osm_way_id, s.from_node, s.to_node, s.geom, s.length_m FROM segments AS s
    WHERE s.id = ANY(CAST(:ids AS bigint[])) AND (
        EXISTS (SELECT FROM drive_segments AS e WHERE e.segment_id = s.id)
        OR EXISTS (SELECT FROM drive_passes AS p WHERE p.segment_id = s.id AND p.partition = versant_partition(s.cell)))
    ORDER BY s.id RETURNING id, segment_id
    """
)
# Of what is measured there is nothing left, for the drives are gone.
_DROP_EMPTY = text(
    """
    DELETE FROM retired_segments AS a WHERE NOT EXISTS (SELECT FROM retired_passes AS p WHERE p.retired_id = a.id)
        AND NOT EXISTS (SELECT FROM retired_estimates AS e WHERE e.retired_id = a.id)
    """
)
_KEEP_PASSES = text(
    f"""
    INSERT INTO retired_passes (retired_id, drive_id, run, sequence, entered_s, factor)
    SELECT a.id, p.drive_id, {_RUN.format("p")}, p.sequence, p.entered_s, p.factor
    FROM unnest(CAST(:attic AS bigint[]), CAST(:ids AS bigint[])) AS a (id, segment_id)
    JOIN drive_passes AS p ON p.segment_id = a.segment_id AND p.partition = ANY(CAST(:partitions AS smallint[]))
    """  # noqa: S608 - constants
)
_KEEP_ESTIMATES = text(
    f"""
    INSERT INTO retired_estimates (retired_id, drive_id, run, slope_percent, slope_sigma_percent, observations, passes,
                                 first_at, last_at, in_network)
    SELECT a.id, e.drive_id, {_RUN.format("e")}, e.slope_percent, e.slope_sigma_percent, e.observations, e.passes,
           e.first_at, e.last_at, e.in_network
    FROM unnest(CAST(:attic AS bigint[]), CAST(:ids AS bigint[])) AS a (id, segment_id)
    JOIN drive_segments AS e ON e.segment_id = a.segment_id
    """  # noqa: S608 - constants
)
_FORGET = tuple(
    text(statement)
    for statement in (
        "DELETE FROM drive_passes WHERE segment_id = ANY(CAST(:ids AS bigint[])) "
        "AND partition = ANY(CAST(:partitions AS smallint[]))",
        *(
            f"DELETE FROM {table} WHERE segment_id = ANY(CAST(:ids AS bigint[]))"  # noqa: S608 - constants
            for table in (
                "drive_segments",
                "rejected_passes",
                "condensed_passes",
                "network_slopes",
                "segment_slopes",
            )
        ),
    )
)

# --- out of it

_FIND = text(
    """
    SELECT i.n, a.id, a.segment_id, a.from_node <> i.from_node AS back, a.osm_way_id = i.osm_way_id AS same_way,
           ST_X(ST_StartPoint(a.geom)) AS lon0, ST_Y(ST_StartPoint(a.geom)) AS lat0,
           ST_X(ST_EndPoint(a.geom)) AS lon1, ST_Y(ST_EndPoint(a.geom)) AS lat1, a.length_m,
           EXISTS (SELECT FROM segments AS s WHERE s.id = a.segment_id) AS taken
    FROM retired_segments AS a JOIN road_import AS i
        ON least(i.from_node, i.to_node) = least(a.from_node, a.to_node)
        AND greatest(i.from_node, i.to_node) = greatest(a.from_node, a.to_node)
    ORDER BY i.n, a.retired_at DESC, a.id DESC
    """
)
_SAID = text(
    """
    SELECT a.retired_id, a.drive_id, EXISTS (SELECT FROM provenances AS v WHERE v.id = a.run) AS fresh
    FROM (SELECT retired_id, drive_id, run FROM retired_passes WHERE retired_id = ANY(CAST(:ids AS bigint[]))
          UNION SELECT retired_id, drive_id, run FROM retired_estimates
          WHERE retired_id = ANY(CAST(:ids AS bigint[]))) AS a
    JOIN drives AS d ON d.id = a.drive_id AND d.status <> 'cancelled'
    """
)
_FRESH = """
    JOIN drives AS d ON d.id = a.drive_id AND d.status <> 'cancelled' JOIN provenances AS v ON v.id = a.run
"""
_PASSES = f"""
    SELECT a.retired_id, a.drive_id, a.sequence, a.entered_s, a.factor FROM retired_passes AS a {_FRESH}
    WHERE a.retired_id = ANY(%(ids)s::bigint[]) ORDER BY a.id
"""  # noqa: S608 - constants
_ESTIMATES_BACK = text(
    f"""
    INSERT INTO drive_segments (drive_id, segment_id, slope_percent, slope_sigma_percent, observations, passes,
                                first_at, last_at, provenance_id, in_network)
    SELECT a.drive_id, t.segment_id, t.sign * a.slope_percent, a.slope_sigma_percent, a.observations, a.passes,
           a.first_at, a.last_at, a.run, a.in_network
    FROM unnest(CAST(:ids AS bigint[]), CAST(:segments AS bigint[]), CAST(:signs AS integer[]))
         AS t (retired_id, segment_id, sign)
    JOIN retired_estimates AS a ON a.retired_id = t.retired_id {_FRESH}
    ON CONFLICT DO NOTHING
    """  # noqa: S608 - constants
)
_CLEAR = text("DELETE FROM retired_segments WHERE id = ANY(CAST(:ids AS bigint[]))")
_PRUNE = text(
    """
    DELETE FROM retired_segments WHERE id IN (
        SELECT id FROM retired_segments WHERE retired_at < clock_timestamp() - make_interval(secs => :age_s)
        ORDER BY retired_at LIMIT :most) RETURNING id
    """
)
PRUNED_AT_ONCE = 500

_PUT = """
    INSERT INTO drive_passes (drive_id, segment_id, sequence, entered_s, factor, partition)
    SELECT t.drive_id, t.segment_id, t.sequence, t.entered_s, t.factor, versant_partition(s.cell)
    FROM unnest(%(drive_id)s::uuid[], %(segment_id)s::bigint[], %(sequence)s::integer[], %(entered_s)s::float8[],
                %(factor)b::bytea[]) AS t (drive_id, segment_id, sequence, entered_s, factor)
    JOIN segments AS s ON s.id = t.segment_id
"""
_LOOKED_FOR = text(
    """
    UPDATE drive_constants SET partitions = ARRAY(
        SELECT DISTINCT unnest(partitions || CAST(:partitions AS smallint[])) ORDER BY 1)
    WHERE drive_id = ANY(CAST(:drives AS uuid[])) AND NOT partitions @> CAST(:partitions AS smallint[])
    """
)


@dataclass(frozen=True)
class Return:
    """A road of the file, row ``n``, that was there before: what is kept of it, and the number that it can have again
    (None: another road has it). ``void``: drives that have been computed anew since."""

    n: int
    retired_id: int
    segment_id: int | None
    ends_deg: Ends
    length_m: float
    back: bool
    fresh: int
    """How many drives' evidence comes back as it was"""
    void: tuple[uuid.UUID, ...]


PassRow = tuple[uuid.UUID, int, int, float, bytes]
"""Drive, segment, sequence, moment of entry and factor of a pass, as it was over the road before."""


def returns_among(session: Session, table: RoadTable, rows: Ints, tolerance_m: float) -> list[Return]:
    """Which of these rows of the copied file are roads that something is kept of; each kept road comes back once."""
    wanted = set(rows.tolist())
    found = [row for row in session.execute(_FIND) if row.n in wanted]
    # Several ways may run between the same nodes: each has its own again.
    found.sort(key=lambda row: (not row.same_way or row.back, not row.same_way))
    if not found:
        return []
    ends = np.array([(row.lon0, row.lat0, row.lon1, row.lat1) for row in found], float)
    turned = np.where(np.array([row.back for row in found])[:, None], ends[:, [2, 3, 0, 1]], ends)
    now = ends_of(table, np.array([row.n for row in found], np.int64))
    near = ends_apart_m(turned, now) <= tolerance_m
    said: dict[int, list[tuple[uuid.UUID, bool]]] = {}
    for row in session.execute(_SAID, {"ids": [row.id for row in found]}):
        said.setdefault(row.retired_id, []).append((row.drive_id, row.fresh))
    out: list[Return] = []
    used: set[int] = set()
    named: set[int] = set()
    for row, ok, where in zip(found, near.tolist(), ends.tolist(), strict=True):
        if not ok or row.id in used or row.id not in said:
            continue
        used.add(row.id)
        free = not row.taken and row.segment_id not in named and row.n not in {one.n for one in out}
        if free:
            named.add(row.segment_id)
        out.append(
            Return(
                n=row.n,
                retired_id=row.id,
                segment_id=row.segment_id if free else None,
                ends_deg=(where[0], where[1], where[2], where[3]),
                length_m=row.length_m,
                back=row.back,
                fresh=len({drive for drive, fresh in said[row.id] if fresh}),
                void=tuple(sorted({drive for drive, fresh in said[row.id] if not fresh})),
            )
        )
    return out


def keep(session: Session, segment_ids: Sequence[int]) -> None:
    """Take what was measured on these segments off the map, and keep it. The caller owns the network."""
    ids = {"ids": list(segment_ids), "partitions": partitions_of(session, segment_ids)}
    kept = session.execute(_KEEP, ids).all()
    if kept:
        values = {"attic": [row.id for row in kept], "ids": [row.segment_id for row in kept]}
        session.execute(_KEEP_PASSES, {**values, "partitions": ids["partitions"]})
        session.execute(_KEEP_ESTIMATES, values)
    for statement in _FORGET:
        session.execute(statement, ids)


def bring_back(session: Session, returns: Sequence[Return], over: Mapping[int, tuple[int, Carrying]]) -> None:
    """Put what is kept of roads back on the map: ``over`` says by its number in the attic which segment each is now,
    and how it becomes that. What is kept of drives computed anew since goes. The caller owns the network."""
    ids = [one.retired_id for one in returns]
    rows = fetch_binary(session, _PASSES, {"ids": ids})
    put_passes(
        session, [(row[1], over[row[0]][0], *row[2:]) for row in rows], [over[row[0]][1] for row in rows]
    )
    values = {
        "ids": ids,
        "segments": [over[one][0] for one in ids],
        "signs": [-1 if over[one][1].back else 1 for one in ids],
    }
    session.execute(_ESTIMATES_BACK, values)
    session.execute(_CLEAR, {"ids": ids})


def put_passes(session: Session, rows: Sequence[PassRow], carried: Sequence[Carrying]) -> None:
    """Add passes, each carried over to its segment as that is now."""
    if not rows:
        return
    factors = PassFactor.decode_all([(row[4], row[1], row[2]) for row in rows])
    factors = [how.factor(one, one.segment) for one, how in zip(factors, carried, strict=True)]
    drives = [row[0] for row in rows]
    columns = {
        "drive_id": drives,
        "segment_id": [row[1] for row in rows],
        "sequence": [row[2] for row in rows],
        "entered_s": [row[3] for row in rows],
        "factor": PassFactor.encode_all(factors),
    }
    send_binary(session, _PUT, columns)
    partitions = partitions_of(session, {row[1] for row in rows})
    session.execute(_LOOKED_FOR, {"drives": list(set(drives)), "partitions": partitions})


def drop_empty(session: Session) -> None:
    """Forget roads that were kept for the sake of drives that are removed by now."""
    session.execute(_DROP_EMPTY)


def prune(sessions: Sessions, days: float) -> int:
    """Let go what has been kept for longer than so many days; of how many roads."""
    count = 0
    while True:
        with sessions.begin() as session:
            values = {"age_s": 86400.0 * days, "most": PRUNED_AT_ONCE}
            found = len(session.execute(_PRUNE, values).all())
        count += found
        if found < PRUNED_AT_ONCE:
            return count
