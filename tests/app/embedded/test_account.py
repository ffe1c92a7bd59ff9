"""Root drops to another user, with no more power than it takes."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from app.embedded.account import Account, account_for, with_access
from app.embedded.errors import EmbeddedPostgresError


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
