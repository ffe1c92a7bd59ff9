"""Durable files: once a file has its name, it survives a power cut."""

from __future__ import annotations

import errno
import os
from pathlib import Path

_NOT_SYNCED = frozenset({errno.EACCES, errno.EINVAL, errno.ENOTSUP})
"""Errors of folders that we may not read, and of shares that cannot sync."""


def make_folder(folder: Path, mode: int = 0o777) -> None:
    """See that there is a folder; it and those that were made above it survive a power cut."""
    missing = [one for one in (folder, *folder.parents) if not one.is_dir()]
    folder.mkdir(mode, parents=True, exist_ok=True)
    for one in missing:
        _sync_folder(one.parent)


def rename_durably(part: Path, target: Path) -> None:
    """Give a complete file, or folder, of the same file system its name, at once.

    The file is synced before it has its name, then the folder that holds the name and those that were made for it: a
    folder that is only in memory is gone after a power cut, with all that it names. Raises ``OSError``.
    """
    if part.is_file():
        sync(part)
    make_folder(target.parent)
    part.replace(target)
    # The next one too: another process may have made this folder a moment ago and not synced it yet.
    for one in target.parents[:2]:
        _sync_folder(one)


def sync_named(file: Path) -> None:
    """Sync a file that was written in place, its folder, and the folder above, in which that may be new."""
    sync(file)
    for one in file.parents[:2]:
        _sync_folder(one)


def _sync_folder(folder: Path) -> None:
    try:
        sync(folder)
    except OSError as error:
        if error.errno not in _NOT_SYNCED:
            raise


def sync(path: Path) -> None:
    """Write to the disk what the system holds in memory of a file, or of a folder's names."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
