"""A group of logs of one place through the pipeline: what their passes say and what is known of the drives is kept."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from app.batch.folder import LAYOUT, BatchFolder, is_settled, key_of, written
from app.batch.kept import Origin, kept_row, write_kept
from app.batch.listing import DIED, Log, Reason, opened, reason_of
from app.batch.roads import PlacedRoads
from app.batch.stored import PassRows, drive_row, write_drives, write_passes
from app.core.text import dumps
from fusion.formats import read_log
from fusion.network.pass_factor import PassFactor
from fusion.pipeline import parse_options, positions_of, road_boxes, run_drive
from fusion.roads.table import RoadTable, rows_of
from fusion.terrain.dem import Dem
from fusion.together import FusedDrive
from fusion.types import Ints


@dataclass(frozen=True)
class Choices:
    """How drives are fused: equal choices make equal results."""

    version: str
    method: str
    options: dict[str, Any]
    roads: PlacedRoads
    rasters: tuple[tuple[str, int, int], ...]
    """Path, bytes and time of writing (ns) of each"""

    def document(self) -> dict[str, Any]:
        """As JSON; where files stand has no part in it."""
        return {
            "layout": LAYOUT,
            "version": self.version,
            "method": self.method,
            "options": self.options,
            "roads": self.roads.folder.name,
            "rasters": [[Path(path).name, size, time_ns] for path, size, time_ns in self.rasters],
        }

    def terrain(self) -> Dem | None:
        """The rasters, opened once in each process."""
        return _terrain(tuple(path for path, _, _ in self.rasters))


@dataclass(frozen=True)
class Group:
    """Logs that one task fuses."""

    folder: BatchFolder
    key: str
    logs: tuple[Log, ...]
    choices: Choices

    @classmethod
    def of(cls, folder: BatchFolder, logs: Sequence[tuple[Log, str]], choices: Choices) -> Group:
        """Of logs with the digests of their bytes."""
        names = [(log.name, sha256) for log, sha256 in logs]
        return cls(folder, key_of(choices.document(), names), tuple(log for log, _ in logs), choices)

    @property
    def is_done(self) -> bool:
        """Whether that is known from before."""
        return is_settled(self.folder.drives(self.key))

    def work(self, without: frozenset[int] = frozenset()) -> None:
        """Fuse each log but those whose numbers are in ``without``, which kill whoever does."""
        rows: list[dict[str, Any]] = []
        passes: list[PassRows] = []
        kept: list[dict[str, Any]] = []
        for k, log in enumerate(self.logs):
            if k in without:
                rows.append(_not_used(log, DIED))
                continue
            try:
                one, roads, origin = fused(log, self.choices)
                kept.append(kept_row(k, one, origin, self.choices.terrain()))
            except Exception as error:  # whatever is wrong with a log, the others go on
                rows.append(_not_used(log, reason_of(error)))
                continue
            rows.append(drive_row(log.name, one, roads) | {"report": dumps(_finite(one.result.report))})
            if one.result.factors:
                passes.append(PassRows.of(k, one, one.result.factors, roads))
        write_passes(self.folder, self.key, passes)
        write_kept(self.folder, self.key, kept)
        # At the end: where it is there, so are the passes.
        write_drives(self.folder.drives(self.key), rows)

    def alone(self, k: int) -> None:
        """Fuse one log and keep nothing: whether it kills."""
        with suppress(Exception):  # what is wrong with it is said where its result is kept
            fused(self.logs[k], self.choices)


def fused(log: Log, choices: Choices) -> tuple[FusedDrive, RoadTable, Origin]:
    """One drive, the roads that its segments count in, and its log."""
    options = parse_options(choices.method, choices.options)
    with opened(log) as path:
        read = read_log(path, columns=options.columns)
    located = positions_of(read, options)
    roads, rows = choices.roads.near(road_boxes(located.log))
    network, result = run_drive(located, roads, choices.terrain(), method=choices.method, options=options)
    own = rows[rows_of(roads, network.table)]
    return FusedDrive(own, result, located.log.fix.time_s), network.table, Origin(read, located.log)


@dataclass(frozen=True)
class Late:
    """A drive, by its number, whose altimeter is late by another time than was thought; ``file`` is for its passes."""

    log: Log
    drive: int
    lag_s: float
    choices: Choices
    folder: BatchFolder
    file: str

    def work(self) -> Ints:
        """Write the passes anew (``late_passes``); the rows of roads that they count in."""
        late_by, own = self._kept()
        factors = [] if late_by is None else list(late_by(self.lag_s))
        rows: Ints = own[np.array([f.segment for f in factors], np.int64)]
        stored = [*zip([f.sequence for f in factors], PassFactor.encode_all(factors), strict=True)]
        with written(self.folder.scratch / self.file) as partial:
            partial.write_bytes(pickle.dumps((stored, rows)))
        return rows

    def _kept(self) -> Any:
        """How its factors are made anew: of the log, or as the round before left it."""
        place = self.folder.scratch / f"kept-{self.drive}"
        if place.is_file():
            with place.open("rb") as file:
                return _Kept(file, self.choices).load()
        one, _, _ = fused(self.log, self.choices)
        found = one.result.late_by, one.rows
        with written(place) as partial, partial.open("wb") as file:
            _Keeping(file, pickle.HIGHEST_PROTOCOL).dump(found)
        return found


def late_passes(folder: BatchFolder, file: str) -> tuple[list[tuple[int, bytes]], Ints]:
    """The passes of a drive that were made anew, by their sequence, and their rows."""
    return pickle.loads((folder.scratch / file).read_bytes())  # type: ignore[no-any-return] # noqa: S301 - our own files


class _Keeping(pickle.Pickler):
    """Leaves out rasters, which are open files."""

    def persistent_id(self, obj: Any) -> str | None:
        """See ``pickle``."""
        return "rasters" if isinstance(obj, Dem) else None


class _Kept(pickle.Unpickler):
    """Puts them in again."""

    def __init__(self, file: BinaryIO, choices: Choices) -> None:
        super().__init__(file)
        self._choices = choices

    def persistent_load(self, pid: str) -> Dem | None:
        """See ``pickle``."""
        return self._choices.terrain()


@lru_cache(1)
def _terrain(paths: tuple[str, ...]) -> Dem | None:
    return Dem.open([Path(path) for path in paths], trusted=True) if paths else None


def _not_used(log: Log, why: Reason) -> dict[str, Any]:
    return {"log": log.name, "reason": why.text, "again": why.again}


def _finite(value: Any) -> Any:
    """As JSON has it: unknown is null."""
    if isinstance(value, dict):
        return {str(k): _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if isinstance(value, np.generic):
        return _finite(value.item())
    return None if isinstance(value, float) and not np.isfinite(value) else value
