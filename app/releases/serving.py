"""The statements that bring what was told to what is served: sessions here read the schema ``edition``.

Only what differs is written, so that what stays the same keeps its ETag and its day. Counts are given in buckets, and
nothing is said of when anybody drove.
"""

from __future__ import annotations

from datetime import UTC, date, datetime, time
from itertools import count
from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.tables import IS_SHOWN, NetworkSlope
from app.network.cells import OVER, cells_over, raise_versions

_COLUMNS = [column.name for column in NetworkSlope.__table__.columns]
_OTHERS = {
    "drives": "bucket.drives",
    "observations": "bucket.observations",
    "driven_share": "CAST(NULL AS float8)",
}
_NAMES = ", ".join(_COLUMNS)
_BUCKET = "(SELECT coalesce(max(b), 0) FROM unnest(CAST(:buckets AS integer[])) AS b WHERE b <= {})"

# By how many owners a slope is known is counted once more, among the passes that the solution has accepted.
_SERVE = text(f"""
    WITH known AS (
        SELECT p.segment_id FROM told.drive_passes AS p JOIN told.drives AS d ON d.id = p.drive_id
        LEFT JOIN told.rejected_passes AS r ON r.segment_id = p.segment_id AND r.pass_id = p.id
        WHERE r.pass_id IS NULL AND p.condensed_weight IS DISTINCT FROM 0
        GROUP BY p.segment_id HAVING count(DISTINCT d.owner_id) >= :owners_needed
    ), next AS (
        SELECT {", ".join(f"{_OTHERS.get(name, 't.' + name)} AS {name}" for name in _COLUMNS)}
        FROM told.network_slopes AS t JOIN segments AS s ON s.id = t.segment_id,
            LATERAL (SELECT {_BUCKET.format("t.drives")} AS drives,
                            {_BUCKET.format("t.observations")} AS observations) AS bucket
        WHERE t.drives = 0 OR t.segment_id IN (SELECT segment_id FROM known)
    ), gone AS (
        DELETE FROM segment_slopes AS a WHERE NOT EXISTS (SELECT FROM next AS n WHERE n.segment_id = a.segment_id)
        RETURNING segment_id
    ), written AS (
        INSERT INTO segment_slopes AS a ({_NAMES}, updated_at) SELECT {_NAMES}, :moment FROM next ORDER BY segment_id
        ON CONFLICT (segment_id) DO UPDATE
            SET {", ".join(f"{name} = excluded.{name}" for name in _COLUMNS[1:])}, updated_at = excluded.updated_at
        WHERE ({", ".join(f"a.{name}" for name in _COLUMNS[1:])})
            IS DISTINCT FROM ({", ".join(f"excluded.{name}" for name in _COLUMNS[1:])})
        RETURNING segment_id
    )
    SELECT segment_id FROM gone UNION ALL SELECT segment_id FROM written
""")  # noqa: S608 - constants

# Roads that came, moved or went since the last edition; at the first one, all.
_NOTE_ROADS = text("""
    INSERT INTO segment_changes AS c (segment_id, xid, changed_at, gone)
    SELECT s.id, versant_xid(), :moment, false
    FROM segments AS s, told.standing AS known WHERE s.road_version_id > known.road_version_id ORDER BY s.id
    ON CONFLICT (segment_id) DO UPDATE SET xid = excluded.xid, changed_at = excluded.changed_at, gone = false
""")
_NOTE_GONE = text("""
    INSERT INTO segment_changes AS c (segment_id, xid, changed_at, gone)
    SELECT d.segment_id, versant_xid(), :moment, true FROM derived_segments AS d
    WHERE NOT EXISTS (SELECT FROM segments AS s WHERE s.id = d.segment_id) ORDER BY d.segment_id
    ON CONFLICT (segment_id) DO UPDATE SET xid = excluded.xid, changed_at = excluded.changed_at, gone = true
    WHERE NOT c.gone
""")
_CELLS_OF_ROADS = text(
    f"""{OVER.format(where="s.road_version_id > (SELECT road_version_id FROM told.standing)")}
    UNION SELECT cell FROM derived_segments AS d WHERE NOT EXISTS (SELECT FROM segments AS s WHERE s.id = d.segment_id)
    """  # noqa: S608 - constants
)
_NOTE_STANDING = text("""
    UPDATE told.standing SET road_version_id = (SELECT coalesce(max(road_version_id), 0) FROM segments)
    WHERE road_version_id < (SELECT coalesce(max(road_version_id), 0) FROM segments)
""")
_NOTE_DAY = (
    text("UPDATE segment_changes SET changed_at = :moment WHERE xid = versant_xid()"),
    text("UPDATE cells SET changed_at = :moment WHERE changed_xid = versant_xid()"),
)

_SHARES = """
    SELECT count(*) AS segments, coalesce(sum(s.length_m), 0) AS length_m
    FROM {slopes} AS a JOIN segments AS s ON s.id = a.segment_id WHERE a.drives > 0
"""
_ADD = text(f"""
    WITH told AS ({_SHARES.format(slopes="segment_slopes")}),
    driven AS ({_SHARES.format(slopes="public.segment_slopes")})
    INSERT INTO editions (number, day, owners, owners_needed, segments, length_m, withheld_share, withheld_length_share)
    SELECT coalesce((SELECT max(number) FROM editions), 0) + 1, :day, :owners, :owners_needed, t.segments, t.length_m,
           round(CAST(1 - least(t.segments / nullif(CAST(d.segments AS float8), 0), 1) AS numeric), 2),
           round(CAST(1 - least(t.length_m / nullif(d.length_m, 0), 1) AS numeric), 2)
    FROM told AS t, driven AS d
    RETURNING number
""")  # noqa: S608 - constants
_FORGET = tuple(
    text(f"TRUNCATE {tables}")
    for tables in (
        "edition.segment_slopes, edition.cells, edition.segment_changes, edition.ways, edition.drawn_pieces, "
        "edition.derived_segments, edition.cells_to_draw, edition.stored_tiles",
        "told.drive_passes, told.condensed_passes, told.rejected_passes, told.drive_constants, told.network_marks, "
        "told.network_slopes, told.segment_slopes, told.cells, told.drives, told.examined, told.places",
        "editions",
    )
)
_FORGET_STANDING = text("UPDATE told.standing SET road_version_id = 0")
_ANY = text("SELECT EXISTS (SELECT FROM editions)")
_ANY_REMOVED = text(f"""
    SELECT EXISTS (SELECT FROM told.drives AS t
                   WHERE NOT EXISTS (SELECT FROM drives AS d WHERE d.id = t.id AND {IS_SHOWN.format("d")}))
""")  # noqa: S608 - constants


def buckets(owners_needed: int) -> list[int]:
    """What counts are told as: the greatest of these that is not greater."""
    steps = (step * 10**power for power in count() for step in (1, 2, 5))
    return [owners_needed, *(s for s in (next(steps) for _ in range(28)) if owners_needed < s < 2**31)]


def serve(session: Session, owners_needed: int, day: date) -> int:
    """Let what was solved be what is served, in the session's transaction; of how many segments anything changed."""
    values: dict[str, Any] = {"moment": datetime.combine(day, time(), UTC)}
    wanted = {"buckets": buckets(owners_needed), "owners_needed": owners_needed}
    changed = list(session.execute(_SERVE, {**values, **wanted}).scalars())
    of_roads = set(session.execute(_CELLS_OF_ROADS).scalars())
    cells = {*of_roads, *(cells_over(session, changed) if changed else ())}
    for note in (_NOTE_ROADS, _NOTE_GONE):
        session.execute(note, values)
    raise_versions(session, cells)
    session.execute(_NOTE_STANDING)
    for note in _NOTE_DAY:
        session.execute(note, values)
    return len(changed)


def add_edition(session: Session, *, day: date, owners: int, owners_needed: int) -> int:
    """The number of the edition that is served from now on."""
    values = {"day": day, "owners": owners, "owners_needed": owners_needed}
    return int(session.execute(_ADD, values).scalar_one())


def any_removed(session: Session) -> bool:
    """Whether anything is told of a drive that was removed since."""
    return bool(session.execute(_ANY_REMOVED).scalar_one())


def forget_all(session: Session) -> bool:
    """Keep nothing of what was told and served; whether there was anything."""
    if not session.execute(_ANY).scalar_one():
        return False
    for statement in (*_FORGET, _FORGET_STANDING):
        session.execute(statement)
    return True
