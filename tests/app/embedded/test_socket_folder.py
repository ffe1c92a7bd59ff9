"""The folder of the socket is private, or refused."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from app.embedded.account import Account
from app.embedded.data_folder import clear_sockets, prepare_socket_dir
from app.embedded.errors import EmbeddedPostgresError

OURSELVES = Account(None, None)


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
