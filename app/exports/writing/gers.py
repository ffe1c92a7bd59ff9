"""Overture's bridge files: which of its segments (GERS ids) each OpenStreetMap way went into.

Grammar: "Bridge Files" of Overture's documentation. Parquet, a file or a folder of them, with ``id`` (GERS) and
``record_id`` (``w123456@7``: way and version), mostly ``dataset``, ``type``, and for roads two pairs of numbers within
0..1: ``between``, the part of the Overture segment that the way makes up, and ``dataset_between``, the part of the way
that went into it. Files of older releases have no pairs. A pair that is null stands for the whole.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from app.core.messages import say
from fusion.errors import BadOptionsError
from fusion.messages import joined
from fusion.types import Floats, Ints

if TYPE_CHECKING:
    import pyarrow as pa

Range = tuple[float, float]
_PAIRS = ("between", "dataset_between")
_KEPT = {"dataset": "OpenStreetMap", "type": "segment"}
"""Of columns that there are, what they have to say."""


class Piece(NamedTuple):
    """A part of a way that is a part of an Overture segment; a range is None where the file does not tell it."""

    gers: int
    """A number within the ``Bridge``, of the segment with this id."""
    gers_id: str
    way: int
    version: int
    """Of the way; 0: not told."""
    on_gers: Range | None
    on_way: Range | None


@dataclass(frozen=True, eq=False)
class Bridge:
    """n records, sorted by way. ``shares`` (n, 4): of the segment from, to, of the way from, to; NaN unknown."""

    names: pa.Array
    """GERS ids."""
    gers: Ints
    way: Ints
    version: Ints
    shares: Floats

    def of_way(self, way: int) -> list[Piece]:
        """In which segments a way is; those that are told twice once, by their place along the way."""
        a, b = np.searchsorted(self.way, (way, way + 1))
        return self._pieces(np.arange(a, b))

    def of_gers(self, gers: int) -> list[Piece]:
        """Which ways a segment is made of."""
        a, b = np.searchsorted(self._sorted_gers, (gers, gers + 1))
        return self._pieces(self._by_gers[a:b])

    @cached_property
    def _by_gers(self) -> Ints:
        return np.argsort(self.gers, kind="stable")

    @cached_property
    def _sorted_gers(self) -> Ints:
        return np.asarray(self.gers[self._by_gers])

    def _pieces(self, rows: Ints) -> list[Piece]:
        found = {
            Piece(gers, str(self.names[gers]), way, version, _range(shares[:2]), _range(shares[2:]))
            for gers, way, version, shares in zip(
                *(column[rows].tolist() for column in (self.gers, self.way, self.version, self.shares)),
                strict=True,
            )
        }
        return sorted(found, key=lambda one: (one.way, one.on_way or (0.0, 0.0), one.gers_id))


def _range(shares: list[float]) -> Range | None:
    low, high = sorted(shares)
    return (max(low, 0.0), min(high, 1.0)) if low < high else None


def read_bridge(path: Path, ways: Ints) -> Bridge:
    """What a bridge file says of these ways, ascending; ``BadOptionsError`` where it cannot be read or is none."""
    import pyarrow as pa  # noqa: PLC0415 - only where such a file is read

    try:
        parts = [part for part in _parts(path, ways) if len(part)]
    except (OSError, pa.ArrowException) as error:
        reason = str(error).splitlines()[0].rstrip(".")
        raise BadOptionsError(
            say("export.cannot_be_read", file=path, error=reason), where="bridge"
        ) from error
    schema = pa.schema(
        {"id": pa.string(), "way": pa.int64(), "version": pa.int64(), **dict.fromkeys("abcd", pa.float64())}
    )
    table = pa.concat_tables(parts) if parts else schema.empty_table()
    table = table.sort_by([("way", "ascending"), ("id", "ascending")])
    coded = table["id"].combine_chunks().dictionary_encode()
    return Bridge(
        names=coded.dictionary,
        gers=coded.indices.to_numpy().astype(np.int64),
        way=table["way"].to_numpy(),
        version=table["version"].to_numpy(),
        shares=np.column_stack([table[name].to_numpy() for name in "abcd"]),
    )


def _parts(path: Path, ways: Ints) -> Iterator[pa.Table]:
    """The records of these ways, in the schema of ``read_bridge``, a part of the file at a time."""
    import pyarrow as pa  # noqa: PLC0415
    import pyarrow.compute as pc  # noqa: PLC0415
    from pyarrow import dataset  # noqa: PLC0415

    file = dataset.dataset(path, format="parquet", partitioning="hive")
    there = set(file.schema.names)
    if missing := [name for name in ("id", "record_id") if name not in there]:
        names = joined(missing, " and none ")
        raise BadOptionsError(say("export.lacks_columns", file=path.name, names=names), where="bridge")
    kept = [pc.field(name) == value for name, value in _KEPT.items() if name in there]
    pairs = [name for name in _PAIRS if name in there]
    wanted = kept[0] & kept[1] if len(kept) == 2 else kept[0] if kept else None
    for batch in file.to_batches(columns=["id", "record_id", *pairs], filter=wanted):
        record = pc.extract_regex(
            pc.cast(batch["record_id"], pa.string()), r"^w(?P<way>\d{1,18})(?:@(?P<version>\d{1,9}))?$"
        )
        way = pc.struct_field(record, "way").cast(pa.int64()).fill_null(-1)
        rows = np.flatnonzero(_among(way.to_numpy(), ways))
        if not len(rows):
            continue
        few, told = batch.take(pa.array(rows)), record.take(pa.array(rows))
        version = pc.struct_field(told, "version")
        version = pc.if_else(pc.equal(version, ""), None, version).cast(pa.int64()).fill_null(0)
        columns = [column for name in _PAIRS for column in _pair(few, name, len(rows))]
        yield pa.table(
            {
                "id": pc.cast(few["id"], pa.string()),
                "way": way.take(pa.array(rows)),
                "version": version,
                **dict(zip("abcd", columns, strict=True)),
            }
        )


def _pair(batch: pa.RecordBatch, name: str, rows: int) -> list[Any]:
    """Both numbers of a pair; NaN where there is no such column, 0 and 1 where it is null."""
    import pyarrow.compute as pc  # noqa: PLC0415

    if name not in batch.schema.names:
        return [np.full(rows, np.nan)] * 2
    return [
        pc.list_element(batch[name], k).cast("float64").fill_null(whole) for k, whole in enumerate((0.0, 1.0))
    ]


def _among(values: Ints, ascending: Ints) -> Any:
    if not len(ascending):
        return np.zeros(len(values), bool)
    at = np.minimum(np.searchsorted(ascending, values), len(ascending) - 1)
    return ascending[at] == values
