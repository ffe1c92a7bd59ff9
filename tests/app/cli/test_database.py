"""Which database a command gets, and that the embedded one comes migrated."""

from __future__ import annotations

from pathlib import Path

import psycopg
import pytest
from typer.testing import CliRunner

from app.cli import app
from app.cli.database import database, settings_for
from app.core import migrate
from app.core.settings import Settings
from app.core.settings.places import libpq_url
from app.embedded.cluster import EmbeddedPostgres


def revision_of(url: str) -> str | None:
    with psycopg.connect(libpq_url(url)) as connection:
        row = connection.execute("SELECT version_num FROM alembic_version").fetchone()
    return None if row is None else str(row[0])


def test_a_database_that_is_named_is_taken_as_it_is(tmp_path: Path) -> None:
    settings = Settings(database_url="postgresql://me@db.example/slopes", data_dir=tmp_path)
    with database(settings) as found:
        assert found.database_url == "postgresql+psycopg://me@db.example/slopes"
    assert not list(tmp_path.iterdir()), "no cluster is made beside it"


@pytest.mark.db
def test_a_data_folder_wins_over_the_variable_and_comes_migrated(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("VERSANT_DATABASE_URL", "postgresql://me@db.example/slopes")
    with database(settings_for(tmp_path)) as found:
        assert EmbeddedPostgres(tmp_path).is_running()
        assert revision_of(str(found.database_url)) == migrate.latest_revision()
    assert not EmbeddedPostgres(tmp_path).is_running()


@pytest.mark.db
def test_nobody_else_reads_the_logs_and_rasters_of_a_data_folder(tmp_path: Path) -> None:
    """Folders of an older version, made as the umask said, are closed as well."""
    (tmp_path / "blobs").mkdir(mode=0o755)
    with database(settings_for(tmp_path)):
        for folder in ("blobs", "dem", "postgres"):
            assert (tmp_path / folder).stat().st_mode & 0o077 == 0, folder


@pytest.mark.db
def test_folders_that_are_named_apart_keep_their_rights(tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    shared.mkdir(mode=0o755)
    named = Settings(data_dir=tmp_path / "data", blob_url=shared.as_uri(), dem_url=str(shared))
    with database(named):
        assert shared.stat().st_mode & 0o777 == 0o755
        assert not (named.data_dir / "blobs").exists()


def test_migrations_go_up_twice_and_down_again(blank_database_url: str) -> None:
    for _ in range(2):
        migrate.upgrade(blank_database_url)
        assert revision_of(blank_database_url) == migrate.latest_revision()
    migrate.check(blank_database_url)
    migrate.downgrade(blank_database_url)
    assert revision_of(blank_database_url) is None


def test_a_test_gets_a_migrated_copy_and_never_the_template(database_url: str, template_db: str) -> None:
    assert revision_of(database_url) == migrate.latest_revision()
    with psycopg.connect(libpq_url(database_url)) as connection:
        row = connection.execute("SELECT current_database()").fetchone()
    assert row is not None
    assert row[0] != template_db


@pytest.mark.parametrize("command", ["api", "worker"])
def test_programs_refuse_a_database_that_no_longer_serves_them(
    command: str, database_url: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with psycopg.connect(libpq_url(database_url)) as connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
        connection.execute("UPDATE schema_support SET oldest_program = '9998'")
    monkeypatch.setenv("VERSANT_DATABASE_URL", database_url)
    monkeypatch.setenv("VERSANT_DATA_DIR", str(tmp_path))
    result = CliRunner().invoke(app, [command])
    assert result.exit_code == 1
    assert "serves no program as old as this one" in result.stderr


def test_migrating_from_an_older_program_leaves_a_newer_database_as_it_is(
    database_url: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with psycopg.connect(libpq_url(database_url)) as connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    monkeypatch.setenv("VERSANT_DATABASE_URL", database_url)
    monkeypatch.setenv("VERSANT_DATA_DIR", str(tmp_path))
    result = CliRunner().invoke(app, ["migrate"])
    assert result.exit_code == 0
    assert "at revision 9999" in result.stderr
