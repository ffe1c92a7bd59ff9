"""The folder of a batch: what is where in it, files that appear whole, and one command at a time."""

from __future__ import annotations

import fcntl
import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

import pyarrow as pa
import pyarrow.parquet as pq

from app.core.messages import say
from app.core.text import dumps
from fusion.errors import FusionError


class BatchError(FusionError):
    """The batch cannot go on."""

    kind = "batch"


COMPRESSION = "zstd"
LAYOUT = 2
"""Of what is in the folder: what another made is made anew."""


def key_of(*parts: Any) -> str:
    """A name for what is made of these: equal for equal JSON."""
    return hashlib.sha256(dumps(parts).encode()).hexdigest()[:32]


@contextmanager
def written(path: Path) -> Iterator[Path]:
    """Where to write what becomes ``path`` at the end of the block: two workers may write the same file at once."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{uuid4().hex}{path.suffix}")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def write_table(path: Path, table: pa.Table, rows_together: int | None = None) -> None:
    """Write a Parquet file; equal tables make equal bytes. ``rows_together`` of them can be read alone."""
    with written(path) as partial:
        pq.write_table(table, partial, compression=COMPRESSION, row_group_size=rows_together)


def is_settled(file: Path) -> bool:
    """Whether a table of logs is there in which none is to be looked at again (column ``again``)."""
    if not file.is_file():
        return False
    again: list[bool | None] = pq.read_table(file, columns=["again"], use_threads=False)["again"].to_pylist()
    return not any(again)


@dataclass(frozen=True)
class BatchFolder:
    """Names of what is in it. Workers on other machines reach it by the same path."""

    path: Path

    @property
    def manifest(self) -> Path:
        """Which inputs, versions and options made the results that are there."""
        return self.path / "manifest.json"

    @property
    def inputs(self) -> Path:
        """Every log: name, size, digest."""
        return self.path / "inputs.parquet"

    @property
    def report(self) -> Path:
        """What became of every log."""
        return self.path / "report.parquet"

    def slopes(self, file_name: str) -> Path:
        """A file of results."""
        return self.path / file_name

    def roads(self, key: str) -> Path:
        """Roads by place, as a file of roads was cut."""
        return self.path / "roads" / key

    def located(self, key: str) -> Path:
        """Where some logs are."""
        return self.path / "located" / f"{key}.parquet"

    def drives(self, key: str) -> Path:
        """What is known of a group's drives but what their passes say."""
        return self.path / "drives" / f"{key}.parquet"

    def tracks(self, key: str) -> Path:
        """What a service has of a group's drives besides."""
        return self.path / "tracks" / f"{key}.parquet"

    @property
    def passes(self) -> Path:
        """What passes say, by place."""
        return self.path / "passes"

    @property
    def scratch(self) -> Path:
        """What lasts as long as the command."""
        return self.path / "scratch"

    @contextmanager
    def held(self) -> Iterator[None]:
        """Keep other commands out; ``BatchError`` where one is at work. ``OSError`` where it cannot be written."""
        self.path.mkdir(parents=True, exist_ok=True)
        with (self.path / ".lock").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise BatchError(say("batch.busy", folder=self.path)) from None
            yield


def remove_but(folder: Path, kept: set[Path]) -> None:
    """Remove the files below a folder that no ``kept`` path names, and folders that are empty then."""
    for path in sorted(folder.rglob("*"), reverse=True) if folder.is_dir() else ():
        if path.is_dir():
            if not any(path.iterdir()):
                path.rmdir()
        elif path not in kept:
            path.unlink()
