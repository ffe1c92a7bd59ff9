"""Which logs there are, and their bytes: in folders, in zips, behind addresses of object storage.

A folder is walked through, a zip that is named is opened as one; each file in them is a log, a zip among them an upload
bundle: the files of one drive. The order is that of names, whatever order storage lists them in.
"""

from __future__ import annotations

import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from app.batch.folder import BatchError
from app.core.filesystems import file_system, is_folder
from app.core.messages import say
from fusion.errors import FusionError, LogError
from fusion.formats import MAX_BYTES

_ADDED = frozenset({"Thumbs.db", "desktop.ini"})
"""What systems put beside files."""
_STAMPS = ("ETag", "etag", "md5Hash", "sha256", "version_id", "mtime", "LastModified", "last_modified")
"""What storage says of a file's contents, the surest first."""


class Log(NamedTuple):
    """One log: where it is, how large, and what changes when its bytes do (``stamp``).

    ``member``: its name in a zip, empty where the file is the log.
    """

    address: str
    member: str
    size: int
    stamp: str

    @property
    def name(self) -> str:
        """What it is called."""
        return f"{self.address}!{self.member}" if self.member else self.address

    @property
    def file_name(self) -> str:
        """Without folders."""
        return PurePosixPath(self.member or self.address).name


def list_logs(named: Sequence[str]) -> list[Log]:
    """Every log under these names, by name, each once.

    Raises ``BatchError`` for a name under which there is no log, ``OSError`` and what drivers of storage raise.
    """
    found: dict[tuple[str, str], Log] = {}
    for name in named:
        none = True
        for log in _under(name):
            found[log.address, log.member], none = log, False
        if none:
            raise BatchError(say("batch.no_log", name=name))
    return [found[key] for key in sorted(found)]


def _under(name: str) -> Iterator[Log]:
    fs, root = file_system(name)
    prefix = name.rstrip("/")
    if fs.isfile(root):
        info = fs.info(root)
        if root.lower().endswith(".zip"):
            yield from _in_zip(fs, root, prefix, _stamp(info))
        else:
            yield Log(prefix, "", int(info["size"]), _stamp(info))
        return
    if not fs.exists(root):
        raise BatchError(say("batch.nothing_there", name=name))
    for path, info in fs.find(root, detail=True).items():
        below = str(path)[len(root) :].lstrip("/")
        if info.get("type") != "directory" and not _is_hidden(below):
            yield Log(f"{prefix}/{below}", "", int(info["size"]), _stamp(info))


def _in_zip(fs: Any, root: str, prefix: str, stamp: str) -> Iterator[Log]:
    try:
        with fs.open(root, "rb") as file, zipfile.ZipFile(file) as archive:
            for info in archive.infolist():
                if not info.is_dir() and not _is_hidden(info.filename):
                    yield Log(prefix, info.filename, info.file_size, f"{stamp} {info.CRC:08x}")
    except zipfile.BadZipFile as error:
        raise BatchError(say("batch.no_zip", name=prefix, error=error)) from error


def _is_hidden(path: str) -> bool:
    parts = PurePosixPath(path).parts
    return any(part.startswith((".", "__MACOSX")) for part in parts) or parts[-1] in _ADDED


def _stamp(info: dict[str, Any]) -> str:
    known = next((name for name in _STAMPS if info.get(name) is not None), None)
    return "" if known is None else f"{known} {info[known]}"


_AT_ONCE = 1 << 20


@contextmanager
def opened(log: Log) -> Iterator[Path]:
    """Where the log can be read while the block runs; raises ``LogError`` or ``OSError``."""
    if log.size > MAX_BYTES:
        raise LogError(say("batch.large", n=log.size, most=MAX_BYTES))
    fs, path = file_system(log.address)
    if is_folder(fs) and not log.member:
        yield Path(path)
        return
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / (log.file_name or "log")
        with fs.open(path, "rb") as file, place.open("wb") as out:
            if not log.member:
                shutil.copyfileobj(file, out, _AT_ONCE)
            else:
                with zipfile.ZipFile(file) as archive, archive.open(log.member) as member:
                    shutil.copyfileobj(member, out, _AT_ONCE)
        yield place


class Reason(NamedTuple):
    """Why a log is not used, for a person; ``again``: it may be another time, as when storage did not answer."""

    text: str
    again: bool


def reason_of(error: Exception) -> Reason:
    """What an error says of a log."""
    if isinstance(error, FusionError):
        return Reason(" ".join(str(error).split()), False)
    if isinstance(error, OSError) and error.strerror:
        return Reason(say("batch.unreadable", error=error.strerror), True)
    return Reason(" ".join(say("batch.unusable", kind=type(error).__name__, error=error).split()), True)


DIED = Reason(
    say("batch.died"),
    True,
)
