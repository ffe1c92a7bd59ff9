"""Which PostgreSQL is taken, and what is said where there is none."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.embedded.binaries import find_binaries, find_client
from app.embedded.errors import PostgresMissingError


def fake_postgres(root: Path, major: int, *, postgis: bool) -> Path:
    """An installation whose programs only know their version."""
    programs = root / str(major) / "bin"
    programs.mkdir(parents=True)
    for name in ("initdb", "pg_ctl", "postgres"):
        (programs / name).write_text(f"#!/bin/sh\necho '{name} (PostgreSQL) {major}.3 (Fake)'\n")
        (programs / name).chmod(0o755)
    if postgis:
        extensions = programs.parent / "share" / "extension"
        extensions.mkdir(parents=True)
        (extensions / "postgis.control").touch()
    return programs


def test_the_newest_version_that_has_postgis_is_taken(tmp_path: Path) -> None:
    # Numbers that no real installation under /usr/share has.
    places = [fake_postgres(tmp_path, m, postgis=m != 1017) for m in (1009, 1016, 1017)]
    assert find_binaries(places=places).folder == places[1].resolve()


def test_an_existing_cluster_gets_its_own_version(tmp_path: Path) -> None:
    places = [fake_postgres(tmp_path, m, postgis=True) for m in (1015, 1016)]
    assert find_binaries(1015, places=places).major == 1015
    with pytest.raises(PostgresMissingError, match="postgresql-1014-postgis-3"):
        find_binaries(1014, places=places)


def test_without_postgresql_the_message_says_what_to_install(tmp_path: Path) -> None:
    with pytest.raises(
        PostgresMissingError, match=r"No PostgreSQL server.*apt-get install postgresql-postgis"
    ):
        find_binaries(places=[tmp_path])


def test_without_postgis_the_message_names_what_was_found(tmp_path: Path) -> None:
    programs = fake_postgres(tmp_path, 1016, postgis=False)
    with pytest.raises(PostgresMissingError, match=r"PostgreSQL 1016 in .*, without PostGIS"):
        find_binaries(places=[programs])


def test_a_version_that_is_too_old_is_not_taken(tmp_path: Path) -> None:
    with pytest.raises(PostgresMissingError, match="13 or newer"):
        find_binaries(places=[fake_postgres(tmp_path, 9, postgis=True)])


def test_programs_that_do_not_run_are_passed_over(tmp_path: Path) -> None:
    broken = fake_postgres(tmp_path, 1016, postgis=True)
    (broken / "postgres").write_text("#!/bin/sh\nexit 3\n")
    with pytest.raises(PostgresMissingError, match="No PostgreSQL server"):
        find_binaries(places=[broken])


def test_a_client_is_of_the_server_s_version_or_the_next_newer_one(tmp_path: Path) -> None:
    places = []
    for major in (17, 13, 15):
        folder = tmp_path / str(major)
        folder.mkdir()
        program = folder / "pg_dump"
        program.write_text(f"#!/bin/sh\necho 'pg_dump (PostgreSQL) {major}.2'\n")
        program.chmod(0o755)
        places.append(folder)
    for wanted, taken in ((13, 13), (14, 15), (15, 15), (16, 17)):
        assert find_client("pg_dump", wanted, places=places) == (
            str(tmp_path / str(taken) / "pg_dump"),
            taken,
        )
    with pytest.raises(PostgresMissingError, match=r"PostgreSQL 18 or newer is needed.*postgresql-client-18"):
        find_client("pg_dump", 18, places=places)
    with pytest.raises(PostgresMissingError, match="none is"):
        find_client("pg_restore", 13, places=places)
