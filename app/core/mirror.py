"""Files that never change, stored elsewhere (a bucket) and read through copies on this machine. Knows no raster.

A file's folder is named after its content, so an existing copy is right. It is fetched once per machine, however many
processes ask for it at once, and appears complete or not at all.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import shutil
import uuid
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path, PurePosixPath

from app.core.durable import rename_durably, sync_named
from app.core.filesystems import INCOMING, file_system, is_folder, modified_at, put_file
from app.core.messages import say
from app.core.settings.places import FilePlace, RemoteFolder


class MirrorError(Exception):
    """A file cannot be fetched or sent; the message says which and why."""


def local_folder(place: FilePlace) -> Path:
    """The folder on this machine: of the files, or of the copies of those that are kept elsewhere."""
    return place if isinstance(place, Path) else place.copies


def send(place: FilePlace, names: Sequence[str]) -> None:
    """Store files that are in the folder where they are kept, in this order; ``MirrorError`` where that fails.

    Afterwards they survive a power cut.
    """
    if isinstance(place, Path):
        for name in names:
            sync_named(place / name)
        return
    fs, root = file_system(place.url)
    for name in names:
        try:
            put_file(fs, root, place.copies / name, name)
        except Exception as error:  # any storage fsspec knows, each with errors of its own
            raise MirrorError(
                say("storage.not_stored", name=name, place=place.url, reason=_reason(error))
            ) from error


def fetch(place: FilePlace, name: str, sha256: str) -> Path:
    """Where a file of this content is on this machine, fetched with the files beside it if it is not here yet."""
    copy = local_folder(place) / name
    if isinstance(place, Path) or copy.is_file():
        return copy
    with _alone(place, copy.parent.name):
        if not copy.is_file():
            _fetch(place, copy.parent.name, copy.name, sha256)
    return copy


def problem(place: FilePlace, name: str, sha256: str) -> str:
    """What is wrong with a stored file; empty if nothing is.

    A file that is stored elsewhere is not fetched: only its existence is checked.
    """
    if not isinstance(place, Path):
        fs, root = file_system(place.url)
        return "" if fs.exists(f"{root}/{name}") else f"{name} is not in {place.url}"
    if not (place / name).is_file():
        return f"{name} is not in {place}"
    return "" if sha256_of(place / name) == sha256 else f"{name} is not as it was"


def remove_older(place: FilePlace, group: str, than: timedelta) -> bool:
    """Remove a file with those beside it, if they are there and came longer ago than that; whether they are gone."""
    fs, root = file_system(str(place) if isinstance(place, Path) else place.url)
    try:
        paths = [str(path) for path in fs.ls(f"{root}/{group}", detail=False, refresh=True)]
    except FileNotFoundError:
        return False
    limit = datetime.now(UTC) - than
    if any(modified_at(fs, path) >= limit for path in paths):
        return False
    for path in paths:
        fs.rm_file(path)
    if is_folder(fs):
        Path(root, group).rmdir()
    else:
        shutil.rmtree(local_folder(place) / group, ignore_errors=True)
    return True


def forget(place: FilePlace, name: str) -> None:
    """Remove a file and its folder, here and where it is stored; missing files and failures are ignored."""
    group = PurePosixPath(name).parent
    shutil.rmtree(local_folder(place) / group, ignore_errors=True)
    if isinstance(place, RemoteFolder):
        with contextlib.suppress(Exception):  # any storage fsspec knows, each with errors of its own
            fs, root = file_system(place.url)
            fs.rm(f"{root}/{group}", recursive=True)


def _fetch(place: RemoteFolder, group: str, filename: str, sha256: str) -> None:
    fs, root = file_system(place.url)
    incoming = place.copies / INCOMING / uuid.uuid4().hex
    incoming.mkdir(parents=True)
    try:
        paths = [str(path) for path in fs.ls(f"{root}/{group}", detail=False)]
        # The named file comes last: where it exists, the files that belong to it do as well.
        paths.sort(key=lambda path: PurePosixPath(path).name == filename)
        for path in paths:
            fs.get_file(path, str(incoming / PurePosixPath(path).name))
        if sha256_of(incoming / filename) != sha256:
            raise MirrorError(say("storage.other_content"))
        for path in paths:
            part = incoming / PurePosixPath(path).name
            rename_durably(part, place.copies / group / part.name)
    except Exception as error:  # as in send
        raise MirrorError(
            say("storage.not_fetched", group=group, file=filename, place=place.url, reason=_reason(error))
        ) from error
    finally:
        shutil.rmtree(incoming, ignore_errors=True)


@contextlib.contextmanager
def _alone(place: RemoteFolder, group: str) -> Iterator[None]:
    """Hold this machine's lock of a group of files; it goes with the process that holds it."""
    locks = place.copies / "locks"
    locks.mkdir(parents=True, exist_ok=True)
    with (locks / group).open("wb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _reason(error: Exception) -> str:
    if isinstance(error, FileNotFoundError):
        return "it is not there"
    reason = str(error) if isinstance(error, MirrorError) else f"{type(error).__name__}: {error}"
    return reason.rstrip(". ")


def sha256_of(path: Path) -> str:
    """The SHA-256 of a file, hex."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
