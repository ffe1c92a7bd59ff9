"""The parts of the embedded cluster that need no server: finding programs, accounts, folders, sentences."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from app.embedded.account import Account, account_for, with_access
from app.embedded.binaries import find_binaries
from app.embedded.cluster import EmbeddedPostgres
from app.embedded.errors import EmbeddedPostgresError, PostgresMissingError
from app.embedded.locks import FileLock
from app.embedded.sockets import clear_sockets, prepare_socket_dir

OURSELVES = Account(None, None)


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


@pytest.mark.parametrize("below", ["", "a/b"])
def test_a_plain_file_is_no_data_folder(below: str, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("kept")
    with pytest.raises(EmbeddedPostgresError, match=f"{file} is not a folder"):
        EmbeddedPostgres(file / below).start()
    assert file.read_text() == "kept"


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


def test_the_socket_lies_in_the_cluster_where_it_can(tmp_path: Path) -> None:
    folder = prepare_socket_dir(tmp_path, OURSELVES)
    assert folder == tmp_path / "run"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    (folder / ".s.PGSQL.5432.lock").touch()
    clear_sockets(folder)
    assert not list(folder.iterdir())


def test_a_loose_socket_folder_is_closed(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir(mode=0o755)
    assert stat.S_IMODE(prepare_socket_dir(tmp_path, OURSELVES).stat().st_mode) == 0o700


def test_a_socket_folder_that_is_a_link_is_refused(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "run").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(EmbeddedPostgresError, match="somebody else's"):
        prepare_socket_dir(tmp_path, OURSELVES)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can make another user's folder")
def test_a_socket_folder_of_somebody_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir(mode=0o700)
    os.chown(tmp_path / "run", 4321, 4321)
    with pytest.raises(EmbeddedPostgresError, match="somebody else's"):
        prepare_socket_dir(tmp_path, OURSELVES)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root drops to another user")
def test_root_runs_a_users_cluster_as_that_user(tmp_path: Path) -> None:
    os.chown(tmp_path, 4321, 4322)
    account = account_for(tmp_path)
    assert (account.uid, account.gid) == (4321, 4322)
    done = account.run(["/bin/sh", "-c", "id -u; id -g; id -G"])
    assert done.stdout.split() == ["4321", "4322", "4322"]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root drops to another user")
def test_root_without_a_way_in_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o700)
    monkeypatch.setenv("PATH", str(tmp_path))  # no setpriv, so no capability can be handed on
    with pytest.raises(EmbeddedPostgresError, match=r"cannot enter .*closed.*ordinary user"):
        with_access(Account(4321, 4322), [closed])


@pytest.mark.skipif(os.geteuid() != 0, reason="only root drops to another user")
def test_no_capability_is_handed_on_where_none_is_needed() -> None:
    assert with_access(Account(4321, 4322), [Path("/")]).prefix == ()


def test_a_lock_has_one_owner_or_many_users(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    with FileLock.shared(path, OURSELVES) as one, FileLock.shared(path, OURSELVES):
        assert not one.try_exclusive()
    with (
        FileLock.exclusive(path, OURSELVES, 1),
        pytest.raises(EmbeddedPostgresError, match="Another program"),
    ):
        FileLock.exclusive(path, OURSELVES, 0.05)


def test_a_folder_that_cannot_be_made_is_explained(tmp_path: Path) -> None:
    long = tmp_path / ("x" * 300)
    with pytest.raises(EmbeddedPostgresError, match=r"xxx.* cannot be used for the database"):
        EmbeddedPostgres(long).start()


def test_a_folder_with_something_else_in_it_is_left_alone(tmp_path: Path) -> None:
    data = tmp_path / "postgres" / "data"
    data.mkdir(parents=True)
    (data / "thesis.tex").write_text("precious")
    with pytest.raises(EmbeddedPostgresError, match="no PostgreSQL cluster"):
        EmbeddedPostgres(tmp_path).start()
    assert (data / "thesis.tex").read_text() == "precious"


def test_a_damaged_cluster_is_explained(tmp_path: Path) -> None:
    data = tmp_path / "postgres" / "data"
    data.mkdir(parents=True)
    (data / "PG_VERSION").write_text("")
    with pytest.raises(EmbeddedPostgresError, match="damaged"):
        EmbeddedPostgres(tmp_path).start()
