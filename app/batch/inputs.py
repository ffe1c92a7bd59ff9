"""Which logs a batch was made of, where each is, and in which group it was fused: a file beside the manifest."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq

from app.batch.folder import BatchFolder, write_table
from app.batch.listing import Log
from app.batch.locating import Located

SCHEMA = pa.schema(
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
    columns = [[row[k] for row in rows] for k in range(len(SCHEMA.names))]
    write_table(folder.inputs, pa.table(dict(zip(SCHEMA.names, columns, strict=True)), schema=SCHEMA))


def read_inputs(folder: BatchFolder) -> list[Input]:
    """Those that were fused, whatever came of it."""
    return [
        Input(Log(row["address"], row["member"], row["bytes"], row["stamp"]), row["sha256"], row["group"])
        for row in pq.read_table(folder.inputs, use_threads=False).to_pylist()
        if row["group"] is not None
    ]
