"""Locks between programs."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.embedded.account import Account
from app.embedded.cluster import FileLock
from app.embedded.errors import EmbeddedPostgresError

OURSELVES = Account(None, None)


def test_a_lock_has_one_owner_or_many_users(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    with FileLock.shared(path, OURSELVES) as one, FileLock.shared(path, OURSELVES):
        assert not one.try_exclusive()
    with (
        FileLock.exclusive(path, OURSELVES, 1),
        pytest.raises(EmbeddedPostgresError, match="Another program"),
    ):
        FileLock.exclusive(path, OURSELVES, 0.05)
