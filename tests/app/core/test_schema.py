"""The queue's schema follows the installed queue; programs and databases of different revisions know each other."""

from __future__ import annotations

import importlib
import logging
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import psycopg
import pytest
from alembic.script import ScriptDirectory

from app.core import databases, migrate, schema
from app.core.settings import Settings
from app.core.settings.places import libpq_url
from app.embedded.cluster import EmbeddedPostgres
from problem_support import check

BEFORE_THE_RECORD = "0009"  # the last revision whose databases do not say what the queue is at
_QUEUE = """
    SELECT 'column', table_name || '.' || column_name, data_type || coalesce(column_default, '') || is_nullable
        FROM information_schema.columns WHERE table_name LIKE 'procrastinate%'
    UNION ALL SELECT 'function', proname || pg_get_function_identity_arguments(oid),
        regexp_replace(prosrc, '\\s+', ' ', 'g') FROM pg_proc WHERE proname LIKE 'procrastinate%'
    UNION ALL SELECT 'trigger', tgname, pg_get_triggerdef(oid) FROM pg_trigger
        WHERE tgname LIKE 'procrastinate%' AND NOT tgisinternal
    UNION ALL SELECT 'index', indexname, indexdef FROM pg_indexes WHERE tablename LIKE 'procrastinate%'
    UNION ALL SELECT 'label', t.typname, e.enumlabel FROM pg_enum AS e JOIN pg_type AS t ON t.oid = e.enumtypid
        WHERE t.typname LIKE 'procrastinate%'
    UNION ALL SELECT 'constraint', conrelid::regclass::text, pg_get_constraintdef(oid) FROM pg_constraint
        WHERE conrelid::regclass::text LIKE 'procrastinate%' AND contype <> 'c'
"""


def rows(url: str, query: str) -> set[tuple[Any, ...]]:
    with psycopg.connect(libpq_url(url)) as connection:
        return set(connection.execute(query.encode()).fetchall())


def execute(url: str, statement: str | bytes) -> None:
    with psycopg.connect(libpq_url(url)) as connection:
        connection.execute(statement.encode() if isinstance(statement, str) else statement)


@pytest.fixture(scope="module")
def before_the_record(cluster: EmbeddedPostgres, new_database: Callable[[str], str]) -> str:
    """Name of a database of before the record that nobody is connected to."""
    name = new_database("template0")
    migrate.upgrade(cluster.url_of(name), BEFORE_THE_RECORD)
    return name


@pytest.fixture
def older_url(
    cluster: EmbeddedPostgres, new_database: Callable[[str], str], before_the_record: str
) -> Iterator[str]:
    """A database like that, of this test alone."""
    name = new_database(before_the_record)
    yield cluster.url_of(name)
    databases.drop_database(cluster.url, name)


def with_older_queue(url: str, last: str) -> None:
    """Let a database of before the record have a job, and a queue that goes up to the file ``last``."""
    first = importlib.import_module("migrations.versions.0001_first")
    execute(url, first._DROP_QUEUE)
    folder = Path(schema.SchemaManager.get_migrations_path())
    for name in schema.queue_files():
        if name <= last:
            execute(url, (folder / name).read_bytes())
    execute(url, "INSERT INTO procrastinate_jobs (queue_name, task_name) VALUES ('drives', 'process_drive')")


@pytest.fixture(scope="module")
def newest(
    cluster: EmbeddedPostgres, template_db: str, new_database: Callable[[str], str]
) -> set[tuple[Any, ...]]:
    """What the queue of a new database is made of."""
    return rows(cluster.url_of(new_database(template_db)), _QUEUE)


@pytest.mark.parametrize("last", [name for name in schema.queue_files() if name > "02.14"])
def test_an_older_queue_comes_up_to_the_installed_one(
    older_url: str, newest: set[tuple[Any, ...]], last: str
) -> None:
    url = older_url
    with_older_queue(url, last)
    former = rows(url, _QUEUE)
    migrate.upgrade(url)
    assert migrate.standing_of(url).usable
    waiting = {f for f in schema.queue_files() if f > last and "_post_" in f}
    assert rows(url, "SELECT name FROM queue_migrations") == {
        (name,) for name in schema.queue_files() if name not in waiting
    }
    if waiting:  # what programs call that still run is there
        called = {row[1] for row in former if row[0] == "function" and "fetch_job_v2" not in row[1]}
        assert called <= {row[1] for row in rows(url, _QUEUE)}
    migrate.upgrade(url, finish=True)
    assert rows(url, _QUEUE) == newest
    assert rows(url, "SELECT task_name, status::text FROM procrastinate_jobs") == {("process_drive", "todo")}


def test_a_later_file_of_the_queue_is_applied_once_and_demanded(
    database_url: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in schema.queue_files():
        (tmp_path / name).symlink_to(Path(schema.SchemaManager.get_migrations_path()) / name)
    for name, table in (("03.99.00_01_pre_more.sql", "more"), ("03.99.00_50_post_less.sql", "less")):
        (tmp_path / name).write_text(f"CREATE TABLE procrastinate_{table} (x int); SELECT '%';")
    monkeypatch.setattr(schema.SchemaManager, "get_migrations_path", lambda: str(tmp_path))
    before = migrate.standing_of(database_url)
    assert not before.usable
    assert "versant migrate" in before.sentence
    there = (
        "SELECT to_regclass('procrastinate_more') IS NOT NULL, to_regclass('procrastinate_less') IS NOT NULL"
    )
    for finish, found in ((False, (True, False)), (False, (True, False)), (True, (True, True))):
        migrate.upgrade(database_url, finish=finish)
        assert rows(database_url, there) == {found}
        assert migrate.standing_of(database_url) == migrate.Standing(migrate.latest_revision(), True)


def test_the_record_of_the_queue_survives_its_own_migration(database_url: str) -> None:
    recorded = rows(database_url, "SELECT name FROM queue_migrations")
    assert recorded == {(name,) for name in schema.queue_files()}
    migrate.downgrade(database_url, BEFORE_THE_RECORD)
    migrate.upgrade(database_url)
    assert rows(database_url, "SELECT name FROM queue_migrations") == recorded


@pytest.fixture
def newer(database_url: str) -> Callable[[str], str]:
    """``newer(oldest)``: a database that a later version migrated, and its word on the oldest programs."""

    def make(oldest_program: str) -> str:
        execute(database_url, "UPDATE alembic_version SET version_num = '9999'")
        execute(database_url, f"UPDATE schema_support SET oldest_program = '{oldest_program}'")
        return database_url

    return make


def test_programs_stay_ready_while_a_newer_schema_serves_them(
    newer: Callable[[str], str],
    tmp_path: Path,
    server_maker: Callable[..., Any],
    caplog: pytest.LogCaptureFixture,
) -> None:
    url = newer(str(migrate.latest_revision()))
    with server_maker(Settings(database_url=url, data_dir=tmp_path)) as web:
        assert web.client.get("/readyz").json()["checks"]["database"] == "ok"
        assert web.client.get("/v1/drives").is_success
    with caplog.at_level(logging.WARNING):
        migrate.upgrade(url)
        migrate.standing_of(url).demand()
    assert [("9999" in line, "still serves" in line) for line in caplog.messages] == [(True, True)] * 2
    assert rows(url, "SELECT version_num FROM alembic_version") == {("9999",)}


def test_programs_are_not_ready_where_a_newer_schema_does_not_serve_them(
    newer: Callable[[str], str], tmp_path: Path, server_maker: Callable[..., Any]
) -> None:
    url = newer("9998")
    with server_maker(Settings(database_url=url, data_dir=tmp_path)) as web:
        assert "update the program" in check(web.client.get("/readyz"), 503)["detail"]
    with pytest.raises(migrate.SchemaError, match="update the program"):
        migrate.upgrade(url)


def test_programs_are_not_ready_on_an_older_schema(database_url: str) -> None:
    migrate.downgrade(database_url, "-1")
    found = migrate.standing_of(database_url)
    assert (found.usable, found.newer) == (False, False)
    assert "versant migrate" in found.sentence


def test_each_migration_notes_which_programs_it_serves(database_url: str) -> None:
    head = ScriptDirectory("migrations").get_revision("head")
    assert head is not None
    oldest = migrate.oldest_program(head.module)
    assert rows(database_url, "SELECT oldest_program FROM schema_support") == {(oldest,)}
    migration = ModuleType("later")
    migration.__dict__.update(revision="0099")
    assert migrate.oldest_program(migration) == "0099"
    migration.__dict__.update(oldest_program="0042")
    assert migrate.oldest_program(migration) == "0042"
