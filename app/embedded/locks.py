"""Locks between programs on one machine: ``flock``, which the kernel releases when their holder dies."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

from app.core.messages import say
from app.embedded.account import Account
from app.embedded.errors import EmbeddedPostgresError


class FileLock:
    """A held lock; released by ``release``, at the end of a ``with`` block, or with the process."""

    def __init__(self, path: Path, account: Account) -> None:
        """Open the lock file, not locked yet."""
        self._path = path
        try:
            self._handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise EmbeddedPostgresError(say("embedded.lock_file", path=path, error=error.strerror)) from error
        account.own(self._handle)

    @classmethod
    def shared(cls, path: Path, account: Account) -> Self:
        """One of any number of holders."""
        lock = cls(path, account)
        fcntl.flock(lock._handle, fcntl.LOCK_SH)
        return lock

    @classmethod
    def exclusive(cls, path: Path, account: Account, timeout_s: float) -> Self:
        """The only holder; waits for the others, at most ``timeout_s``."""
        lock = cls(path, account)
        if not wait_until(lock.try_exclusive, timeout_s):
            lock.release()
            raise EmbeddedPostgresError(say("embedded.locked", seconds=timeout_s, path=path))
        return lock

    def try_exclusive(self) -> bool:
        """Become the only holder if nobody else holds the lock."""
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def release(self) -> None:
        """Give the lock back."""
        os.close(self._handle)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


def wait_until(condition: Callable[[], bool], timeout_s: float) -> bool:
    """Ask again and again; whether it held in time."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True
