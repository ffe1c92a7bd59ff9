"""A service's database of any size: real drives over a real map, and copies of both side by side, as SQL makes them.

Copies of the roads lie beside each other (``served.million``). Each carries the original's slopes and copies of the
drives with all their passes, each of another day, until there are as many passes as are asked for. What workers make of
segments (ways, low zooms) they make of the copies as well.
"""

from __future__ import annotations

from collections.abc import Mapping

from sqlalchemy import Table, text
from sqlalchemy.orm import Session

from accuracy.scoring import show_progress
from app.core import tables
from app.core.db import Sessions
from app.core.tables.network import DrivePass
from app.map.derived.following import follow_all
from app.network.cells import raise_versions
from served.million import NUMBERS, Copy, copies, copies_there, copy_roads
from service.databases import vacuum

DAY_S = 86_400.0
_MAPPED = """
    CREATE TEMP TABLE mapped ON COMMIT DROP AS
    SELECT o.id AS original, c.id
    FROM segments AS o JOIN segments AS c ON c.osm_way_id = o.osm_way_id + :number
        AND c.from_node = o.from_node + :number AND c.to_node = o.to_node + :number
    WHERE o.osm_way_id < :numbers AND c.osm_way_id BETWEEN :number AND :number + :numbers
"""
_DRIVEN = """
    CREATE TEMP TABLE driven ON COMMIT DROP AS
    SELECT d.id AS original, CAST(md5(CAST(d.id AS text) || :number || ' ' || again) AS uuid) AS id, again
    FROM drives AS d, generate_series(1, :times) AS again WHERE d.size_bytes > 0
"""
# Of the first copy, whose drives have logs.
_OWN_PASSES = text(
    "SELECT count(*) FROM drive_passes JOIN drives AS d ON d.id = drive_id WHERE d.size_bytes > 0"
)
_CELLS = text("SELECT DISTINCT cell FROM segments")
_BYTES = text("SELECT pg_database_size(current_database())")
_COUNTS = {
    name: text(f"SELECT count(*) FROM {name}")  # noqa: S608 - a constant
    for name in ("segments", "segment_slopes", "drives", "drive_passes", "ways", "drawn_pieces")
}
# What each table takes with its indexes and what lies out of line, partitions with their parent.
_TABLES = text("""
    SELECT CAST(CAST(coalesce(i.inhparent, c.oid) AS regclass) AS text) AS name,
           sum(pg_total_relation_size(c.oid)) AS bytes
    FROM pg_class AS c LEFT JOIN pg_inherits AS i ON i.inhrelid = c.oid
    WHERE c.relkind = 'r' AND c.relnamespace = CAST('public' AS regnamespace)
    GROUP BY 1 HAVING sum(pg_total_relation_size(c.oid)) > 1e6 ORDER BY 2 DESC
""")
MOMENTS = ("created_at", "drive_time", "queued_at", "started_at", "computed_at", "finished_at")
"""Of a drive: those of a copy are of another day."""
_SLOPES = ("network_slopes", "segment_slopes")


def _copied(table: Table, values: Mapping[str, str], source: str) -> str:
    """A statement that copies the rows t of ``source``, with other ``values`` of some columns; '' leaves one out."""
    names = [c.name for c in table.columns if values.get(c.name) != "" and c.computed is None]
    chosen = ", ".join(values.get(name, f"t.{name}") for name in names)
    return f"INSERT INTO {table.name} ({', '.join(names)}) SELECT {chosen} FROM {source}"  # noqa: S608 - constants


def _statements() -> list[str]:
    base = tables.Base.metadata.tables
    moved = f"make_interval(secs => {DAY_S} * (:copy * 1000 + n.again))"
    of_drive = " AS t JOIN driven AS n ON n.original = t.drive_id"
    on_road = " JOIN mapped AS m ON m.original = t.segment_id"
    drives = {
        "id": "n.id", "sha256": "md5(CAST(n.id AS text))", "content_sha256": "NULL", "blob_key": "CAST(n.id AS text)",
        "size_bytes": "0", **{moment: f"t.{moment} - {moved}" for moment in MOMENTS},
    }  # fmt: skip
    passes = {
        "id": "", "drive_id": "n.id", "segment_id": "m.id",
        "entered_s": f"t.entered_s - {DAY_S} * (:copy * 1000 + n.again)", "condensed_weight": "NULL",
        "partition": "versant_partition((SELECT cell FROM segments WHERE id = m.id))",
    }  # fmt: skip
    return [
        *(_copied(base[name], {"segment_id": "m.id"}, f"{name} AS t{on_road}") for name in _SLOPES),
        _copied(base["drives"], drives, "drives AS t JOIN driven AS n ON n.original = t.id"),
        _copied(base["provenances"], {"id": "", "drive_id": "n.id"}, f"provenances{of_drive}"),
        _copied(
            base["drive_segments"],
            {"drive_id": "n.id", "segment_id": "m.id", "provenance_id": "p.id"},
            f"drive_segments{of_drive}{on_road} JOIN provenances AS p ON p.drive_id = n.id",
        ),
        _copied(base["drive_constants"], {"drive_id": "n.id"}, f"drive_constants{of_drive}"),
        _copied(base[DrivePass.__tablename__], passes, f"drive_passes{of_drive}{on_road}"),
    ]


def grow(sessions: Sessions, segments: int, passes: int) -> None:
    """Copy what a service has made of some drives until there are so many segments and passes, about.

    Copies that are there stay; where all are nothing is done.
    """
    with sessions() as session:
        every, there = copies(session, segments), copies_there(session)
        own = session.execute(_OWN_PASSES).scalar_one()
    times = max(round(passes / (len(every) + 1) / own), 1)
    if there >= len(every):
        return
    for copy in every[there:]:
        show_progress(f"copy {copy.number} of {len(every)}")
        with sessions.begin() as session:
            session.execute(text("SET LOCAL synchronous_commit = off"))
            copy_roads(session, copy)
            _copy_evidence(session, copy, times)
    with sessions.begin() as session:
        raise_versions(session, session.execute(_CELLS).scalars().all())
    vacuum(sessions)
    show_progress("ways and low zooms")
    follow_all(sessions)
    show_progress("")


def _copy_evidence(session: Session, copy: Copy, times: int) -> None:
    values = {"copy": copy.number, "number": copy.number * NUMBERS, "numbers": NUMBERS, "times": times}
    for statement in (_MAPPED, _DRIVEN, "ANALYZE mapped, driven", *_statements()):
        session.execute(text(statement), values)


def sizes(sessions: Sessions) -> dict[str, int]:
    """Rows of the large tables, and the bytes of the whole database."""
    with sessions() as session:
        counts = {name: session.execute(count).scalar_one() for name, count in _COUNTS.items()}
        return {**counts, "bytes": session.execute(_BYTES).scalar_one()}


def bytes_of_tables(sessions: Sessions) -> dict[str, int]:
    """What each table of a megabyte or more takes, with its indexes; the largest first."""
    with sessions() as session:
        return {row.name: int(row.bytes) for row in session.execute(_TABLES)}
