"""The statements of backups, restores and the doctor. No file is opened here."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Any, NamedTuple

from sqlalchemy import TextClause, text
from sqlalchemy.orm import Session

from app.core.caller import ROLES
from app.core.tables import HAS_LOG, IS_SHOWN

# These statements work on databases of every version, so that one can be backed up before it is migrated.
_EXPORT = text("SELECT pg_export_snapshot()")
_VERSIONS = text("""
    SELECT CAST(current_setting('server_version_num') AS integer) / 10000 AS postgres_major,
           current_setting('server_version') AS postgres,
           (SELECT extversion FROM pg_extension WHERE extname = 'postgis') AS postgis
""")
_BLOBS = "SELECT DISTINCT ON (blob_key) blob_key, sha256, size_bytes FROM drives WHERE {of} ORDER BY blob_key"
_KEEPS_FOR_DAYS = text("""
    SELECT EXISTS (SELECT FROM information_schema.columns WHERE table_schema = current_schema()
                   AND table_name = 'drives' AND column_name = 'log_deleted_at')
""")
_RASTERS = text("SELECT sources FROM dem_versions WHERE active")
_HAS_REGIONS = text("SELECT to_regclass('regions') IS NOT NULL")
_IS_FOLLOWED = text("SELECT to_regclass('change_epoch') IS NOT NULL")
_ROAD_FILES = text("SELECT file_uri, file_sha256 FROM regions WHERE file_uri IS NOT NULL ORDER BY file_uri")
_COUNTS = text("SELECT (SELECT count(*) FROM drives) AS drives, (SELECT count(*) FROM segments) AS segments")
_WANTED_STILL = "SELECT blob_key FROM drives WHERE blob_key = ANY(CAST(:keys AS text[])) AND {of} ORDER BY 1"

# Tables, views and sequences that belong to no extension.
_IS_EMPTY = text("""
    SELECT NOT EXISTS (
        SELECT FROM pg_class AS c JOIN pg_namespace AS n ON n.oid = c.relnamespace
        WHERE c.relkind IN ('r', 'p', 'v', 'm', 'S') AND n.nspname NOT IN ('pg_catalog', 'information_schema')
            AND n.nspname NOT LIKE 'pg\\_%' AND NOT EXISTS (
                SELECT FROM pg_depend AS d WHERE d.classid = CAST('pg_class' AS regclass) AND d.objid = c.oid
                    AND d.deptype = 'e'))
""")

# The workers of the saved database are not this one's. Of jobs of which one that waits is enough one is left. A drive
# that only waits to be published has no job.
_PUT_BACK = (
    text("""
        DELETE FROM procrastinate_jobs AS j WHERE status = 'doing' AND queueing_lock IS NOT NULL AND EXISTS (
            SELECT FROM procrastinate_jobs AS o WHERE o.queueing_lock = j.queueing_lock
                AND (o.status = 'todo' OR (o.status = 'doing' AND o.id < j.id)))
    """),
    text("UPDATE procrastinate_jobs SET status = 'todo', worker_id = NULL WHERE status = 'doing'"),
    text("DELETE FROM procrastinate_workers"),
    text("UPDATE computations SET since = NULL"),
    text("""
        UPDATE drives SET status = 'queued', stage = NULL, progress = 0
        WHERE status = 'running' AND stage IS DISTINCT FROM 'publishing'
    """),
)
_WAITING = text("SELECT count(*) FROM drives WHERE status = 'queued'")

_HAS_OWNERS = text("SELECT to_regclass('owners') IS NOT NULL")
# Also where row level security is off for a table that has policies: then everybody is shown everything.
_LACKING = text("""
    SELECT n.name FROM unnest(CAST(:roles AS text[])) AS n (name) LEFT JOIN pg_roles AS r ON r.rolname = n.name
    WHERE r.oid IS NULL OR NOT pg_has_role(r.oid, 'MEMBER') OR EXISTS (
        SELECT FROM pg_tables AS t WHERE t.schemaname = current_schema() AND pg_has_role(t.tableowner, 'USAGE')
            AND NOT has_table_privilege(r.oid, format('%I.%I', t.schemaname, t.tablename), 'SELECT'))
    UNION ALL
    SELECT DISTINCT p.tablename FROM pg_policies AS p
    JOIN pg_tables AS t ON t.schemaname = p.schemaname AND t.tablename = p.tablename
    WHERE p.schemaname = current_schema() AND NOT t.rowsecurity
    ORDER BY 1
""")
_CLOCK = text("SELECT clock_timestamp()")
_WORKERS = text("""
    WITH alive AS (
        SELECT id FROM procrastinate_workers
        WHERE last_heartbeat > clock_timestamp() - make_interval(secs => :silent_s)
    ), jobless AS (
        SELECT d.status FROM drives AS d
        WHERE d.status IN ('queued', 'running') AND d.stage IS DISTINCT FROM 'publishing' AND NOT EXISTS (
            SELECT FROM procrastinate_jobs AS j
            WHERE j.status IN ('todo', 'doing') AND j.args ->> 'drive_id' = CAST(d.id AS text))
    )
    SELECT (SELECT count(*) FROM alive) AS alive,
           (SELECT count(*) FROM procrastinate_jobs AS j
            WHERE j.status = 'doing' AND NOT EXISTS (SELECT FROM alive WHERE alive.id = j.worker_id)) AS stuck,
           (SELECT count(*) FROM jobless WHERE status = 'queued') AS queued,
           (SELECT count(*) FROM jobless WHERE status = 'running') AS running
""")
_DRIVE_BLOBS = "SELECT CAST(id AS text) AS id, blob_key FROM drives WHERE {of} ORDER BY 1"


class Versions(NamedTuple):
    """Of the server; PostGIS None: it is not installed in the database."""

    postgres_major: int
    postgres: str
    postgis: str | None


@dataclass(frozen=True)
class Contents:
    """What a snapshot refers to: blobs by key with SHA-256 (hex) and size, bytes, active rasters as they are listed,
    and files of regions' roads with their SHA-256; and what it counts.
    """

    blobs: dict[str, tuple[str, int]]
    rasters: list[dict[str, Any]]
    road_files: dict[str, str]
    drives: int
    segments: int


class Workers(NamedTuple):
    """Workers that gave a sign of life, jobs that a silent one holds, and drives that wait, or run, without a job."""

    alive: int
    stuck: int
    queued: int
    running: int


def export_snapshot(session: Session) -> str:
    """The name under which others see what this session's transaction sees, for as long as it lasts."""
    return str(session.execute(_EXPORT).scalar_one())


def versions(session: Session) -> Versions:
    """The server's programs."""
    return Versions(*session.execute(_VERSIONS).one())


def contents(session: Session) -> Contents:
    """What the database refers to."""
    blobs = {
        row.blob_key: (row.sha256, row.size_bytes) for row in session.execute(_with_log(session, _BLOBS))
    }
    rasters = [source for sources in session.execute(_RASTERS).scalars() for source in sources]
    regions = session.execute(_ROAD_FILES) if session.execute(_HAS_REGIONS).scalar_one() else ()
    road_files = {row.file_uri: row.file_sha256 for row in regions}
    return Contents(blobs, rasters, road_files, *session.execute(_COUNTS).one())


def wanted_still(session: Session, keys: list[str]) -> list[str]:
    """Those of the blobs whose drives are there, are not being removed and have their log."""
    return list(session.execute(_with_log(session, _WANTED_STILL), {"keys": keys}).scalars()) if keys else []


def is_empty(session: Session) -> bool:
    """Whether nobody has made anything in the database but extensions."""
    return bool(session.execute(_IS_EMPTY).scalar_one())


def put_back(session: Session) -> int:
    """Let what workers of the saved database had begun wait again; how many drives wait."""
    for statement in _PUT_BACK:
        session.execute(statement)
    return int(session.execute(_WAITING).scalar_one())


def is_followed(session: Session) -> bool:
    """Whether the database is of a schema by which others follow the map (``app.changes``)."""
    return bool(session.execute(_IS_FOLLOWED).scalar_one())


def lacking_roles(session: Session) -> list[str] | None:
    """Roles of callers that the server lacks, that this user cannot act as or that may not read, and tables that are
    not guarded; None where the schema is from before there were any."""
    if not session.execute(_HAS_OWNERS).scalar_one():
        return None
    return list(session.execute(_LACKING, {"roles": list(ROLES.values())}).scalars())


def server_clock(session: Session) -> datetime:
    """The server's time."""
    moment: datetime = session.execute(_CLOCK).scalar_one()
    return moment


def workers(session: Session, silent_s: float) -> Workers:
    """How the queue's workers are; one is silent after so many seconds."""
    return Workers(*session.execute(_WORKERS, {"silent_s": silent_s}).one())


def drive_blobs(session: Session) -> dict[str, str]:
    """The blob of every drive that is not being removed and whose log is kept, by the drive's id."""
    return {row.id: row.blob_key for row in session.execute(_with_log(session, _DRIVE_BLOBS))}


def _with_log(session: Session, statement: str) -> TextClause:
    """The statement of drives that are shown and have a log: of older databases all have."""
    kept = f" AND {HAS_LOG}" if session.execute(_KEEPS_FOR_DAYS).scalar_one() else ""
    return text(statement.format(of=IS_SHOWN.format("drives") + kept))
