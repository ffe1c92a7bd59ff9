"""A batch's folder as an archive of drives: what it was made of, and its drives group by group."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, NamedTuple, Self

import pyarrow as pa
import pyarrow.parquet as pq

from app.batch.folder import LAYOUT, BatchError, BatchFolder, write_table
from app.batch.kept import KeptDrive, read_kept
from app.batch.listing import Log
from app.batch.locating import Located
from app.batch.places import place_of_name
from app.batch.roads import PlacedRoads
from app.core.messages import say
from fusion.pipeline import parse_options

INPUTS = pa.schema(
    {
        "log": pa.string(), "bytes": pa.int64(), "sha256": pa.string(), "address": pa.string(), "member": pa.string(),
        "stamp": pa.string(), "group": pa.string(),
    }
)  # fmt: skip
"""One row a log; ``group`` is unknown where it was not fused: it cannot be read, or is the same as another."""


class Input(NamedTuple):
    """A log, what its bytes were, and its group."""

    log: Log
    sha256: str
    group: str


def write_inputs(
    folder: BatchFolder, located: Iterable[Located], groups: Iterable[tuple[str, Sequence[Log]]]
) -> None:
    """Write them in the order of ``groups``: the key of each, and its logs."""
    group_of = {log: key for key, logs in groups for log in logs}
    number_of = {key: number for number, key in enumerate(dict.fromkeys(group_of.values()))}
    rows = [
        (one.log.name, one.log.size, one.sha256, one.log.address, one.log.member, one.log.stamp, group_of.get(one.log))
        for one in located
    ]  # fmt: skip
    rows.sort(key=lambda row: number_of.get(row[-1] or "", len(number_of)))
    columns = [[row[k] for row in rows] for k in range(len(INPUTS.names))]
    write_table(folder.inputs, pa.table(dict(zip(INPUTS.names, columns, strict=True)), schema=INPUTS))


def read_inputs(folder: BatchFolder) -> list[Input]:
    """Those that were fused, whatever came of it."""
    return [
        Input(Log(row["address"], row["member"], row["bytes"], row["stamp"]), row["sha256"], row["group"])
        for row in pq.read_table(folder.inputs, use_threads=False).to_pylist()
        if row["group"] is not None
    ]


@dataclass(frozen=True)
class Archive:
    """What came of a batch; ``inputs`` are in the order of groups, which is that of places."""

    folder: BatchFolder
    name: str
    """Equal for the same logs"""
    version: str
    method: str
    options: dict[str, Any]
    """Those that are no defaults, as an upload names them"""
    roads: PlacedRoads
    inputs: Sequence[Input]
    """Logs that are drives"""
    failed: int
    """Logs that are none"""

    @classmethod
    def read(cls, folder: BatchFolder) -> Self:
        """Of a folder in which a batch came to its end; raises ``BatchError``."""
        if not folder.manifest.is_file():
            raise BatchError(say("batch.no_batch", folder=folder.path))
        manifest = json.loads(folder.manifest.read_text(encoding="utf-8"))
        choices = manifest["choices"]
        if choices.get("layout") != LAYOUT:
            raise BatchError(say("batch.other_version", folder=folder.path))
        became = pq.read_table(folder.report, columns=["log", "status"], use_threads=False).to_pylist()
        done = {row["log"] for row in became if row["status"] == "done"}
        method, options = choices["method"], choices["options"]
        defaults = parse_options(method).model_dump(mode="json")
        return cls(
            folder,
            manifest["logs_sha256"],
            choices["version"],
            method,
            {name: value for name, value in options.items() if value != defaults.get(name)},
            PlacedRoads(folder.roads(choices["roads"])),
            [one for one in read_inputs(folder) if one.log.name in done],
            sum(row["status"] == "failed" for row in became),
        )

    def groups(self, wanted: Sequence[Input]) -> Iterator[tuple[list[Input], Iterator[KeptDrive]]]:
        """The groups of these logs, each with these and all its drives."""
        places = self._places()
        for key, inputs in groupby(wanted, key=lambda one: one.group):
            yield list(inputs), read_kept(self.folder, key, places.get(key, []))

    def _places(self) -> dict[str, list[int]]:
        """The places in which each group has passes."""
        found: dict[str, list[int]] = {}
        for place in sorted(self.folder.passes.glob("place=*")):
            number = place_of_name(place.name.removeprefix("place="))
            for file in place.glob("*.parquet"):
                found.setdefault(file.stem, []).append(number)
        return found
