"""The state of a database's schema: the project's revision, the programs it still serves, and the queue's schema.

The queue (procrastinate) ships its schema as one script and the way to it as a file for each change. The first
migration takes the script. From then on ``bring_queue_up`` applies the files that are missing and notes each, so that
an update of the package brings its schema along. A later migration (0010) began these notes.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psycopg
from procrastinate.schema import SchemaManager
from sqlalchemy import Connection, text
from sqlalchemy.orm import Session

from app.core.caller import API_ROLE, EDITION, PUBLIC_ROLE, ROLES
from app.core.settings.places import libpq_url

_HAS_TABLE = text("SELECT to_regclass(:name) IS NOT NULL")
_REVISION = text("SELECT version_num FROM alembic_version")
_OLDEST_PROGRAM = text("SELECT oldest_program FROM schema_support")
_SUPPORT = text("""
    INSERT INTO schema_support (id, oldest_program) VALUES (1, :revision)
    ON CONFLICT (id) DO UPDATE SET oldest_program = excluded.oldest_program
""")

_APPLIED = "SELECT name FROM queue_migrations"
_HAS_OWNERS = "SELECT to_regclass('owners') IS NOT NULL"
_HAS_RECORD = "SELECT to_regclass('queue_migrations') IS NOT NULL"
_RECORD = "INSERT INTO queue_migrations (name) VALUES (%s) ON CONFLICT DO NOTHING"
# Jobs name the worker that has them by a foreign key, which is set to NULL where the worker goes. The queue (release
# 3.10) leaves it to jobs that ended, and has an index on it of running ones alone: whenever a worker ended or fell
# silent all jobs were read and its own written anew, 20 s at three million (procrastinate-org/procrastinate, issue
# 1454, open). So jobs that do not run name none, and there is an index of those that do. It comes last: where it is,
# nothing is left to do. While it is made no job can be written, for a second with three million of them.
_NAMES_FEW = "SELECT to_regclass('ix_procrastinate_jobs_worker_id') IS NOT NULL"
_NAME_FEW = (
    "UPDATE procrastinate_jobs SET worker_id = NULL WHERE worker_id IS NOT NULL AND status <> 'doing'",
    """
    CREATE OR REPLACE FUNCTION procrastinate_versant_forget_worker() RETURNS trigger LANGUAGE plpgsql AS $$
    BEGIN
        IF NEW.status <> 'doing' THEN NEW.worker_id := NULL; END IF;
        RETURN NEW;
    END $$
    """,
    # Of no column in particular: the queue's own files could not change it then.
    """
    CREATE OR REPLACE TRIGGER procrastinate_versant_forget_worker BEFORE UPDATE ON procrastinate_jobs
    FOR EACH ROW EXECUTE FUNCTION procrastinate_versant_forget_worker()
    """,
    "CREATE INDEX ix_procrastinate_jobs_worker_id ON procrastinate_jobs (worker_id) WHERE worker_id IS NOT NULL",
)

_ROLE = """
    DO $$ BEGIN
        IF NOT EXISTS (SELECT FROM pg_roles WHERE rolname = '{role}') THEN CREATE ROLE {role} NOLOGIN; END IF;
    EXCEPTION WHEN duplicate_object OR unique_violation THEN NULL;  -- another database of this server, just now
    END $$
"""
_JOIN = "GRANT {role} TO {member}"
_IS_MEMBER = "SELECT pg_has_role(CAST(:member AS name), CAST(:role AS name), 'MEMBER')"
# Each once: a right that is given again is a new row of the catalogue.
_GIVE = """
    DO $$ DECLARE name text; BEGIN
        FOR name IN SELECT c.oid::regclass::text FROM pg_class AS c
                    WHERE c.relnamespace = current_schema()::regnamespace AND c.relkind IN ('r', 'p', 'v')
                      AND pg_has_role(c.relowner, 'USAGE') AND NOT has_table_privilege('{role}', c.oid, 'DELETE') LOOP
            EXECUTE 'GRANT SELECT, INSERT, UPDATE, DELETE ON ' || name || ' TO {role}';
        END LOOP;
        FOR name IN SELECT s.seqrelid::regclass::text FROM pg_sequence AS s JOIN pg_class AS c ON c.oid = s.seqrelid
                    WHERE c.relnamespace = current_schema()::regnamespace
                      AND NOT has_sequence_privilege('{role}', s.seqrelid, 'USAGE') LOOP
            EXECUTE 'GRANT USAGE, SELECT ON SEQUENCE ' || name || ' TO {role}';
        END LOOP;
    END $$
"""
# Who sees an edition may begin its epoch of changes as well, where a database was brought here (``app.changes.store``).
_GIVE_EDITION = (
    "GRANT USAGE ON SCHEMA {edition} TO {api}, {public}",
    "GRANT SELECT ON ALL TABLES IN SCHEMA {edition} TO {api}, {public}",
    "GRANT INSERT, UPDATE ON {edition}.change_epoch, {edition}.segment_changes, {edition}.cells TO {api}, {public}",
)
_OF_ROADS = ("segments", "road_versions", "dem_versions", "regions", "editions", "map_names")
"""Of the live tables those that the public may read: what nobody drove."""
_THERE = "SELECT string_agg(name, ', ') FROM unnest(%s::text[]) AS name WHERE to_regclass(name) IS NOT NULL"
_GIVE_ROADS = "GRANT SELECT ON {tables} TO {public}"
_HAS_EDITION = "SELECT to_regclass('editions') IS NOT NULL"
# Whoever may call them is answered what is his own alone; the others may not even call.
_GIVE_PLACES = (
    "REVOKE EXECUTE ON FUNCTION {functions} FROM PUBLIC",
    "GRANT EXECUTE ON FUNCTION {functions} TO {owner}, {operator}",
)
_OF_PLACES = "versant_places(bigint), versant_place_share(bigint, float8, float8)"
_HAS_PLACES = "SELECT to_regproc('versant_place_share') IS NOT NULL"
_COMMENT = "COMMENT ON TABLE procrastinate_jobs IS {}"


@dataclass(frozen=True)
class SchemaState:
    """What a database says of its schema; ``revision`` None: it was never migrated."""

    revision: str | None
    oldest_program: str | None
    """The revision of the oldest programs that work with it; None: those of its own alone."""
    queue_waits: tuple[str, ...]
    """Files of the queue's schema that this program needs and that are not applied."""


def schema_state(session: Session | Connection) -> SchemaState:
    """Read it, in the session's transaction."""
    if not _has(session, "alembic_version"):
        return SchemaState(None, None, ())
    revision = session.execute(_REVISION).scalar()
    oldest = session.execute(_OLDEST_PROGRAM).scalar() if _has(session, "schema_support") else None
    applied = set(session.execute(text(_APPLIED)).scalars()) if _has(session, "queue_migrations") else None
    waits = () if applied is None else tuple(n for n in queue_files() if n not in applied and not _later(n))
    return SchemaState(None if revision is None else str(revision), oldest, waits)


def note_support(connection: Connection, oldest_program: str) -> None:
    """Note the revision of the oldest programs that work with the schema as it is now."""
    if _has(connection, "schema_support"):
        connection.execute(_SUPPORT, {"revision": oldest_program})


def ensure_roles(connection: Connection) -> None:
    """Make the roles of callers (``app.core.caller``) where the server lacks them, and let this user become each.

    Roles are the server's, not the database's. A user who may not make roles is told so by the database.
    """
    user = str(connection.execute(text("SELECT current_user")).scalar_one())
    quote = connection.dialect.identifier_preparer.quote
    for role in (*ROLES.values(), PUBLIC_ROLE):
        connection.execute(text(_ROLE.format(role=role)))
        for member, group in ((user, role), *(((role, API_ROLE),) if role != PUBLIC_ROLE else ())):
            if not connection.execute(text(_IS_MEMBER), {"member": member, "role": group}).scalar_one():
                connection.execute(text(_JOIN.format(role=group, member=quote(member))))


def give_rights(url: str) -> None:
    """Let the API's roles use every table and sequence that there is; row level security says which rows.

    What looks into other schemas for them only those of them may call that need it.
    """
    with psycopg.connect(libpq_url(url), autocommit=True) as connection:
        if (connection.execute(_HAS_OWNERS).fetchone() or (False,))[0]:
            connection.execute(_GIVE.format(role=API_ROLE))
        if (connection.execute(_HAS_EDITION).fetchone() or (False,))[0]:
            (tables,) = connection.execute(_THERE, (list(_OF_ROADS),)).fetchone() or ("",)
            names = {"edition": EDITION, "api": API_ROLE, "public": PUBLIC_ROLE, "tables": tables}
            for statement in (*_GIVE_EDITION, _GIVE_ROADS):
                connection.execute(statement.format(**names))
        if (connection.execute(_HAS_PLACES).fetchone() or (False,))[0]:
            may_ask = {"owner": ROLES["own"], "operator": ROLES["operate"]}
            for statement in _GIVE_PLACES:
                connection.execute(statement.format(functions=_OF_PLACES, **may_ask))


def queue_files() -> list[str]:
    """Names of the files of the installed queue's schema, in their order."""
    return sorted(path.name for path in Path(SchemaManager.get_migrations_path()).glob("*.sql"))


def comment_on_queue(connection: psycopg.Connection[Any], last: str) -> None:
    """Say at the queue's table, while there is no record, up to which file its schema goes."""
    connection.execute(psycopg.sql.SQL(_COMMENT).format(psycopg.sql.Literal(last)))


def bring_queue_up(url: str, *, finish: bool) -> list[str]:
    """Apply what is missing of the queue's schema, a transaction for each file; returns the files' names.

    What the project adds to it (``_NAME_FEW``) is made once.
    Files that take away what older programs need (their names say "post") wait for ``finish``.
    """
    with psycopg.connect(libpq_url(url), autocommit=True) as connection:
        if not (connection.execute(_HAS_RECORD).fetchone() or (False,))[0]:
            return []
        applied = {name for (name,) in connection.execute(_APPLIED)}
        missing = [name for name in queue_files() if name not in applied and (finish or not _later(name))]
        for name in missing:
            with connection.transaction():
                script = (Path(SchemaManager.get_migrations_path()) / name).read_bytes()
                connection.execute(script)
                connection.execute(_RECORD, (name,))
        if not (connection.execute(_NAMES_FEW).fetchone() or (False,))[0]:
            for statement in _NAME_FEW:
                connection.execute(statement)
    return missing


def _later(name: str) -> bool:
    """Whether the file is to be applied when no older program runs any more."""
    return "_post_" in name


def _has(session: Session | Connection, table: str) -> bool:
    return bool(session.execute(_HAS_TABLE, {"name": table}).scalar_one())
