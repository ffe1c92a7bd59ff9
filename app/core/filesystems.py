"""File systems by URL: a folder, or with a driver a bucket; their free room, and the error of a full one.

Knows neither blobs nor rasters.
"""

from __future__ import annotations

import errno
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import fsspec
from fsspec.implementations.local import LocalFileSystem

from app.core import durable
from app.core.errors import StorageFullError
from app.core.messages import say
from app.core.settings import SettingsError

_BUCKETS = frozenset({"s3", "s3a"})
INCOMING = "incoming"
"""Folder of a store in which files are written before they have their name."""
_FULL = frozenset({errno.ENOSPC, errno.EDQUOT})


def file_system(url: str) -> tuple[Any, str]:
    """The file system of an fsspec URL (a plain path is a folder), and the path in it without a slash at its end.

    Others write there as well, so listings are never remembered.
    """
    try:
        fs, root = fsspec.core.url_to_fs(url, use_listings_cache=False)
    except (ImportError, ValueError) as error:
        raise SettingsError(
            say("cli.storage", scheme=url.partition("://")[0], error=str(error).rstrip("."))
        ) from error
    return fs, str(root).rstrip("/")


def is_folder(fs: Any) -> bool:
    """Whether the file system is of this machine (a network share that is mounted counts)."""
    return isinstance(fs, LocalFileSystem)


def make_folder(fs: Any, path: str) -> None:
    """Make a folder that is missing. A bucket has no folders: its driver would make the bucket itself."""
    if is_folder(fs):
        durable.make_folder(Path(path))
        return
    names = {fs.protocol} if isinstance(fs.protocol, str) else set(fs.protocol)
    if not names & _BUCKETS:
        fs.makedirs(path, exist_ok=True)


def complete(fs: Any, part: str, target: str) -> None:
    """Give a file that is written its name, at once; in a folder it survives a power cut from here on."""
    if is_folder(fs):
        durable.rename_durably(Path(part), Path(target))
        return
    make_folder(fs, target.rpartition("/")[0])
    fs.mv(part, target)


def put_file(fs: Any, root: str, source: Path, name: str) -> None:
    """Copy a file of this machine to ``root/name``, where it appears complete or not at all."""
    part = f"{root}/{INCOMING}/{uuid.uuid4().hex}"
    make_folder(fs, f"{root}/{INCOMING}")
    try:
        fs.put_file(str(source), part)
        complete(fs, part, f"{root}/{name}")
    except BaseException:
        remove_file(fs, part)
        raise


def remove_file(fs: Any, path: str) -> None:
    """Remove a file; one that is not there is no error."""
    with suppress(FileNotFoundError):
        fs.rm_file(path)


def modified_at(fs: Any, path: str) -> datetime:
    """When a file was last written, UTC; ``FileNotFoundError`` where there is none."""
    moment: datetime = fs.modified(path)
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


def free_bytes(fs: Any, root: str) -> int | None:
    """Free room, bytes; None where it is unknown, as of a bucket. The folder need not exist yet."""
    if not is_folder(fs):
        return None
    place = next(folder for folder in (Path(root), *Path(root).parents) if folder.is_dir())
    return shutil.disk_usage(place).free


def require_room(folder: Path, coming_bytes: int, keep_free_bytes: int) -> None:
    """``StorageFullError`` where less than ``keep_free_bytes`` would stay free in a folder that is there."""
    if shutil.disk_usage(folder).free - coming_bytes < keep_free_bytes:
        raise storage_full()


@contextmanager
def full_is_told() -> Iterator[None]:
    """Raise ``StorageFullError`` for the system's errors of a full disk or an exceeded quota."""
    try:
        yield
    except OSError as error:
        if error.errno in _FULL:
            raise storage_full() from error
        raise


def storage_full() -> StorageFullError:
    """The error where there is no room."""
    return StorageFullError(say("service.storage_full"))
