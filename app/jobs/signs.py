"""Which processes of this machine live: each holds a locked file, which the kernel unlocks when it ends, however.

A connection to the database was such a sign, but a pooler does not show whose it is, and one that is cut off looks like
one that died. A file whose lock is free is of a process that died, unless its name ends with another start of the
machine: then the machine went. Of other machines, which have folders of their own, nothing is said.
"""

from __future__ import annotations

import fcntl
import logging
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from app.core.claims import process_name

logger = logging.getLogger(__name__)

SIGNS = "processes"
"""Folder in the data folder for signs of life."""
FORGOTTEN_AFTER_S = 86_400.0
"""Files of former starts of the machine, or of another machine that uses the folder too, go then."""
_BOOT = Path("/proc/sys/kernel/random/boot_id")


@cache
def _boot() -> str:
    """What no other start of this machine has. Where the system does not tell, its end seems to be a death."""
    with suppress(OSError):
        return _BOOT.read_text().strip()
    return "boot"


class Signs:
    """The files in a folder that the processes of one machine share; this process's own among them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._handle: int | None = None

    def begin(self) -> None:
        """Give this process's sign. Where no file can be locked there is none, and its death is not noticed."""
        name = f"{process_name()}.{_boot()}"
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            hidden = self._folder / f".{name}"
            self._handle = os.open(hidden, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            fcntl.flock(self._handle, fcntl.LOCK_EX)
            hidden.rename(self._folder / name)  # nobody sees it while it is not locked
        except OSError as error:
            logger.warning(
                "no file can be locked in %s (%s): if this process dies nobody will know",
                self._folder,
                error.strerror,
            )

    def end(self) -> None:
        """This process is about to end in order, or to be killed for good reason: nobody has to wonder about it."""
        handle, self._handle = self._handle, None
        if handle is not None:
            with suppress(OSError):
                (self._folder / f"{process_name()}.{_boot()}").unlink()
            os.close(handle)

    @contextmanager
    def died(self) -> Iterator[list[str]]:
        """Names of processes that died on this machine since it was started; forgotten when the block succeeds.

        Nobody else is told of them meanwhile.
        """
        found: dict[Path, int] = {}
        try:
            for path in self._others():
                if (handle := _locked(path)) is not None:
                    found[path] = handle
            yield [path.name.rpartition(".")[0] for path in found]
            for path in found:
                path.unlink(missing_ok=True)
        finally:
            for handle in found.values():
                os.close(handle)

    def living(self) -> int:
        """How many processes of this machine live and share the folder."""
        count = 0
        for path in self._folder.glob(f"[!.]*.{_boot()}"):
            if (handle := _locked(path)) is None:
                count += 1
            else:
                os.close(handle)
        return count

    def _others(self) -> list[Path]:
        """Files of this start of the machine."""
        with suppress(OSError):
            paths = [path for path in self._folder.iterdir() if not path.name.startswith(".")]
            of_now = [path for path in paths if path.name.endswith(f".{_boot()}")]
            for path in set(paths).difference(of_now):
                with suppress(OSError):
                    if time.time() - path.stat().st_mtime > FORGOTTEN_AFTER_S:
                        path.unlink()
            return sorted(of_now)
        return []


def _locked(path: Path) -> int | None:
    """The file, opened and locked; None where its process lives, or somebody else looks at it."""
    try:
        handle = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return None
    return handle
