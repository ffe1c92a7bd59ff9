"""A log's bytes as a file of this machine, under its own name: some readers go by names."""

from __future__ import annotations

import shutil
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from app.batch.listing import Log
from app.core.filesystems import file_system, is_folder
from app.core.messages import say
from fusion.errors import FusionError, LogError
from fusion.formats import MAX_BYTES

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
