"""Retired evidence: what was measured on deleted roads, kept for a stated time and restored when a road comes back.

Evidence is what drives say, not what follows from it: passes in full, recent or condensed, and estimates. It is
restored as it was for drives that have not been computed again since; the others are computed once more. Evidence for
a segment of another length is carried over (``fusion.network.transfer``).
"""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Sessions, fetch_binary
from app.network.passes import insert_passes, partitions_of
from fusion.network.pass_factor import PassFactor
from fusion.network.transfer import Carrying, Ends
from fusion.roads.changes import ends_apart_m, ends_of
from fusion.roads.table import RoadTable
from fusion.types import Ints

# --- retiring

_RUN = "(SELECT max(id) FROM provenances AS v WHERE v.drive_id = {0}.drive_id)"
# Of a segment s.
MEASURED = """
    (EXISTS (SELECT FROM drive_segments AS e WHERE e.segment_id = s.id)
        OR EXISTS (SELECT FROM drive_passes AS p WHERE p.segment_id = s.id AND p.partition = versant_partition(s.cell)))
"""
_RETIRE = text(f"""
    INSERT INTO retired_segments (segment_id, osm_way_id, from_node, to_node, geom, length_m)
    SELECT s.id, s.osm_way_id, s.from_node, s.to_node, s.geom, s.length_m FROM segments AS s
    WHERE s.id = ANY(CAST(:ids AS bigint[])) AND {MEASURED}
    ORDER BY s.id RETURNING id, segment_id
""")  # noqa: S608 - constants
# Roads whose evidence is gone with its drives.
_DELETE_EMPTY = text("""
    DELETE FROM retired_segments AS a WHERE NOT EXISTS (SELECT FROM retired_passes AS p WHERE p.retired_id = a.id)
        AND NOT EXISTS (SELECT FROM retired_estimates AS e WHERE e.retired_id = a.id)
""")
_RETIRE_PASSES = text(f"""
    INSERT INTO retired_passes (retired_id, drive_id, run, sequence, entered_s, factor)
    SELECT a.id, p.drive_id, {_RUN.format("p")}, p.sequence, p.entered_s, p.factor
    FROM unnest(CAST(:retired AS bigint[]), CAST(:ids AS bigint[])) AS a (id, segment_id)
    JOIN drive_passes AS p ON p.segment_id = a.segment_id AND p.partition = ANY(CAST(:partitions AS smallint[]))
""")  # noqa: S608 - constants
_RETIRE_ESTIMATES = text(f"""
    INSERT INTO retired_estimates (retired_id, drive_id, run, slope_percent, slope_sigma_percent, observations, passes,
                                 first_at, last_at, in_network)
    SELECT a.id, e.drive_id, {_RUN.format("e")}, e.slope_percent, e.slope_sigma_percent, e.observations, e.passes,
           e.first_at, e.last_at, e.in_network
    FROM unnest(CAST(:retired AS bigint[]), CAST(:ids AS bigint[])) AS a (id, segment_id)
    JOIN drive_segments AS e ON e.segment_id = a.segment_id
""")  # noqa: S608 - constants
DELETE_OF = "DELETE FROM {} WHERE segment_id = ANY(CAST(:ids AS bigint[]))"
_BY_SEGMENT = ("drive_segments", "rejected_passes", "condensed_passes", "network_slopes", "segment_slopes")
_DELETE_EVIDENCE = (
    text(f"{DELETE_OF.format('drive_passes')} AND partition = ANY(CAST(:partitions AS smallint[]))"),
    *(text(DELETE_OF.format(table)) for table in _BY_SEGMENT),
)

# --- restoring

_FIND = text("""
    SELECT i.n, a.id, a.segment_id, a.from_node <> i.from_node AS back, a.osm_way_id = i.osm_way_id AS same_way,
           ST_X(ST_StartPoint(a.geom)) AS lon0, ST_Y(ST_StartPoint(a.geom)) AS lat0,
           ST_X(ST_EndPoint(a.geom)) AS lon1, ST_Y(ST_EndPoint(a.geom)) AS lat1, a.length_m,
           EXISTS (SELECT FROM segments AS s WHERE s.id = a.segment_id) AS taken
    FROM retired_segments AS a JOIN road_import AS i
        ON least(i.from_node, i.to_node) = least(a.from_node, a.to_node)
        AND greatest(i.from_node, i.to_node) = greatest(a.from_node, a.to_node)
    ORDER BY i.n, a.retired_at DESC, a.id DESC
""")
_DRIVES = text("""
    SELECT a.retired_id, a.drive_id, EXISTS (SELECT FROM provenances AS v WHERE v.id = a.run) AS fresh
    FROM (SELECT retired_id, drive_id, run FROM retired_passes WHERE retired_id = ANY(CAST(:ids AS bigint[]))
          UNION SELECT retired_id, drive_id, run FROM retired_estimates
          WHERE retired_id = ANY(CAST(:ids AS bigint[]))) AS a
    JOIN drives AS d ON d.id = a.drive_id AND d.status <> 'cancelled'
""")
_FRESH = """
    JOIN drives AS d ON d.id = a.drive_id AND d.status <> 'cancelled' JOIN provenances AS v ON v.id = a.run
"""
_PASSES = f"""
    SELECT a.retired_id, a.drive_id, a.sequence, a.entered_s, a.factor FROM retired_passes AS a {_FRESH}
    WHERE a.retired_id = ANY(%(ids)s::bigint[]) ORDER BY a.id
"""  # noqa: S608 - constants
_ESTIMATES_BACK = text(f"""
    INSERT INTO drive_segments (drive_id, segment_id, slope_percent, slope_sigma_percent, observations, passes,
                                first_at, last_at, provenance_id, in_network)
    SELECT a.drive_id, t.segment_id, t.sign * a.slope_percent, a.slope_sigma_percent, a.observations, a.passes,
           a.first_at, a.last_at, a.run, a.in_network
    FROM unnest(CAST(:ids AS bigint[]), CAST(:segments AS bigint[]), CAST(:signs AS integer[]))
         AS t (retired_id, segment_id, sign)
    JOIN retired_estimates AS a ON a.retired_id = t.retired_id {_FRESH}
    ON CONFLICT DO NOTHING
""")  # noqa: S608 - constants
_CLEAR = text("DELETE FROM retired_segments WHERE id = ANY(CAST(:ids AS bigint[]))")
_PRUNE = text("""
    DELETE FROM retired_segments WHERE id IN (
        SELECT id FROM retired_segments WHERE retired_at < clock_timestamp() - make_interval(secs => :age_s)
        ORDER BY retired_at LIMIT :most) RETURNING id
""")
PRUNED_AT_ONCE = 500

_ADD_PARTITIONS = text("""
    UPDATE drive_constants SET partitions = ARRAY(
        SELECT DISTINCT unnest(partitions || CAST(:partitions AS smallint[])) ORDER BY 1)
    WHERE drive_id = ANY(CAST(:drives AS uuid[])) AND NOT partitions @> CAST(:partitions AS smallint[])
""")


@dataclass(frozen=True)
class Return:
    """A road of the file, row ``n``, that comes back: its retired segment, and the segment id that it gets again (None:
    another road has it). ``void``: drives that have been computed again since it was retired."""

    n: int
    retired_id: int
    segment_id: int | None
    ends_deg: Ends
    length_m: float
    back: bool
    fresh: int
    """How many drives' evidence is restored as it was"""
    void: tuple[uuid.UUID, ...]


PassRow = tuple[uuid.UUID, int, int, float, bytes]
"""Drive, segment, sequence, moment of entry and factor of a pass, as it was over the road before."""


def returns_among(session: Session, table: RoadTable, rows: Ints, tolerance_m: float) -> list[Return]:
    """Which of these rows of the copied file are retired roads; each retired road comes back once."""
    numbers = set(rows.tolist())
    matches = [row for row in session.execute(_FIND) if row.n in numbers]
    # Several ways may run between the same nodes: each gets its own evidence back.
    matches.sort(key=lambda row: (not row.same_way or row.back, not row.same_way))
    if not matches:
        return []
    ends = np.array([(row.lon0, row.lat0, row.lon1, row.lat1) for row in matches], float)
    turned = np.where(np.array([row.back for row in matches])[:, None], ends[:, [2, 3, 0, 1]], ends)
    now = ends_of(table, np.array([row.n for row in matches], np.int64))
    near = ends_apart_m(turned, now) <= tolerance_m
    drives: dict[int, list[tuple[uuid.UUID, bool]]] = {}
    for row in session.execute(_DRIVES, {"ids": [row.id for row in matches]}):
        drives.setdefault(row.retired_id, []).append((row.drive_id, row.fresh))
    out: list[Return] = []
    used: set[int] = set()
    named: set[int] = set()
    for row, ok, where in zip(matches, near.tolist(), ends.tolist(), strict=True):
        if not ok or row.id in used or row.id not in drives:
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
                fresh=len({drive for drive, fresh in drives[row.id] if fresh}),
                void=tuple(sorted({drive for drive, fresh in drives[row.id] if not fresh})),
            )
        )
    return out


def retire(session: Session, segment_ids: Sequence[int]) -> None:
    """Move the evidence on these segments from the map to the retired evidence. The caller owns the network."""
    ids = {"ids": list(segment_ids), "partitions": partitions_of(session, segment_ids)}
    rows = session.execute(_RETIRE, ids).all()
    if rows:
        values = {"retired": [row.id for row in rows], "ids": [row.segment_id for row in rows]}
        session.execute(_RETIRE_PASSES, {**values, "partitions": ids["partitions"]})
        session.execute(_RETIRE_ESTIMATES, values)
    for statement in _DELETE_EVIDENCE:
        session.execute(statement, ids)


def restore(session: Session, returns: Sequence[Return], over: Mapping[int, tuple[int, Carrying]]) -> None:
    """Restore retired evidence: ``over`` has, by the retired segment's id, the segment that it is now and how the
    evidence is carried over. Evidence of drives computed again since is deleted. The caller owns the network."""
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
    """Add passes, each carried over to its segment as it is now."""
    if not rows:
        return
    factors = PassFactor.decode_all([(row[4], row[1], row[2]) for row in rows])
    factors = [how.factor(one, one.segment) for one, how in zip(factors, carried, strict=True)]
    drives = [row[0] for row in rows]
    insert_passes(session, drives, factors, np.array([row[3] for row in rows], float))
    partitions = partitions_of(session, {row[1] for row in rows})
    session.execute(_ADD_PARTITIONS, {"drives": list(set(drives)), "partitions": partitions})


def delete_empty(session: Session) -> None:
    """Delete retired roads whose drives have all been removed."""
    session.execute(_DELETE_EMPTY)


def prune(sessions: Sessions, days: float) -> int:
    """Delete evidence that was retired more than so many days ago; returns of how many roads."""
    count = 0
    while True:
        with sessions.begin() as session:
            values = {"age_s": 86400.0 * days, "most": PRUNED_AT_ONCE}
            matches = len(session.execute(_PRUNE, values).all())
        count += matches
        if matches < PRUNED_AT_ONCE:
            return count
