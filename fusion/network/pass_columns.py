"""All passes of a network as one table: everything but what they say, which is large and stays where it is used."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from operator import attrgetter
from tempfile import TemporaryFile
from typing import Any, Self, overload
from weakref import finalize

import numpy as np

from fusion.arrays import ColumnTable
from fusion.network.pass_factor import NUISANCES, PassFactor
from fusion.types import Bools, Floats, Ints

PACKED_AT_ONCE = 1 << 14
"""So many passes of a long drive are there at once: those of eight hours on ordinary roads."""


def in_order(drives: Mapping[int, Sequence[PassFactor]]) -> tuple[list[int], list[PassFactor]]:
    """The drive of each pass, and the passes, drive by drive in the order of driving."""
    ordered = [(d, p) for d in sorted(drives) for p in sorted(drives[d], key=attrgetter("sequence"))]
    return [d for d, _ in ordered], [p for _, p in ordered]


@dataclass(frozen=True, eq=False)
class PassColumns(ColumnTable):
    """m passes, drive by drive in the order of driving; columns (m,) as ``PassFactor`` has them, but: ``drive`` is the
    number of its drive, ``knots`` how many knot variables it speaks of, ``used`` (m, ``NUISANCES``) which of the
    drive's unknowns, and ``walk_m2_per_s`` has shape (m, 2)."""

    drive: Ints
    sequence: Ints
    segment: Ints
    mount: Ints
    place: Ints
    rows: Ints
    observations: Ints
    condensed: Ints
    square: Floats
    start_m: Floats
    end_m: Floats
    roughness: Floats
    grade_length_m: Floats
    first_time_s: Floats
    last_time_s: Floats
    walk_m2_per_s: Floats
    knots: Ints
    used: Bools

    @classmethod
    def of(cls, drives: Mapping[int, Sequence[PassFactor]]) -> Self:
        """Of drives by their numbers."""
        return cls.in_order(*in_order(drives))

    @classmethod
    def in_order(cls, drive: Sequence[int], passes: Sequence[PassFactor]) -> Self:
        """Of passes that are in order, with their drives."""
        kinds = {
            spec.name: _KINDS[str(spec.type)]
            for spec in fields(cls)
            if spec.name not in ("drive", "knots", "used")
        }
        rows = [*zip(*map(attrgetter(*kinds), passes), strict=True)] or [()] * len(kinds)
        columns: dict[str, Any] = {
            name: np.array(row, kind) for (name, kind), row in zip(kinds.items(), rows, strict=True)
        }
        columns["walk_m2_per_s"] = columns["walk_m2_per_s"].reshape(-1, 2)
        own = np.array([p.information.diagonal()[-NUISANCES:] for p in passes]).reshape(-1, NUISANCES)
        return cls(
            drive=np.array(drive, np.int64),
            knots=np.array([len(p.vector) - NUISANCES for p in passes], np.int64),
            used=own > 0,
            **columns,
        )

    @classmethod
    def together(cls, tables: Sequence[Self]) -> Self:
        """The passes of several tables; a drive may have some in each of them."""
        every = cls.of({}).joined(*tables)
        return every.take(np.lexsort((every.sequence, every.drive)))

    def alike(self) -> list[Ints]:
        """Passes with equal numbers of unknowns, those first that come first; of each the rows, ascending."""
        shape = (self.knots << NUISANCES) + self.used @ (1 << np.arange(NUISANCES))
        _, first, which = np.unique(shape, return_index=True, return_inverse=True)
        return [np.flatnonzero(which == number) for number in np.argsort(first).tolist()]

    def of_drives(self) -> tuple[list[int], list[slice]]:
        """The numbers of the drives, and where the passes of each stand."""
        names, first = np.unique(self.drive, return_index=True)
        ends = [*first.tolist(), len(self)]
        return names.tolist(), [slice(a, b) for a, b in pairwise(ends)]


class _Filed(Sequence[bytes]):
    """Texts of bytes in a file that has no name, and goes with this; there may be hundreds of megabytes."""

    def __init__(self) -> None:
        with TemporaryFile(prefix="versant-passes-") as file:
            self._file, self._end = os.dup(file.fileno()), [0]
        finalize(self, os.close, self._file)

    def append_all(self, texts: Sequence[bytes]) -> None:
        """Put more of them at the end."""
        with open(self._file, "wb", closefd=False) as file:
            file.write(b"".join(texts))
        self._end += (self._end[-1] + np.cumsum([len(text) for text in texts])).tolist()

    def __len__(self) -> int:
        return len(self._end) - 1

    @overload
    def __getitem__(self, at: int) -> bytes: ...
    @overload
    def __getitem__(self, at: slice) -> Sequence[bytes]: ...
    def __getitem__(self, at: int | slice) -> bytes | Sequence[bytes]:
        if isinstance(at, slice):
            return [self[k] for k in range(len(self))[at]]
        k = range(len(self))[at]
        return os.pread(self._file, self._end[k + 1] - self._end[k], self._end[k])

    def __reduce__(self) -> tuple[Any, ...]:
        return list, (list(self),)


class PackedPasses(Sequence[PassFactor]):
    """The passes of a long drive in their stored form, in a file: each is decoded where it is asked for."""

    def __init__(self, table: PassColumns, stored: Sequence[bytes]) -> None:
        """``stored`` (m,) are the passes of the table, as by ``PassFactor.encode``."""
        self.table, self.stored = table, stored

    @classmethod
    def of(cls, portions: Iterable[Sequence[PassFactor]]) -> Self:
        """Of passes in order, of which never are more there than one portion."""
        tables, stored = [], _Filed()
        for portion in portions:
            tables.append(PassColumns.in_order([0] * len(portion), portion))
            stored.append_all(PassFactor.encode_all(portion))
        return cls(PassColumns.of({}).joined(*tables), stored)

    def __len__(self) -> int:
        return len(self.stored)

    @overload
    def __getitem__(self, at: int) -> PassFactor: ...
    @overload
    def __getitem__(self, at: slice) -> PackedPasses: ...
    def __getitem__(self, at: int | slice) -> PassFactor | PackedPasses:
        if isinstance(at, slice):
            return PackedPasses(self.table.take(np.arange(len(self))[at]), self.stored[at])
        return self.decoded([range(len(self))[at]])[0]

    def __iter__(self) -> Iterator[PassFactor]:
        for first in range(0, len(self), PACKED_AT_ONCE):
            yield from self.decoded(range(first, min(first + PACKED_AT_ONCE, len(self))))

    def decoded(self, rows: Iterable[int]) -> list[PassFactor]:
        """Those of these rows."""
        segment, sequence = self.table.segment, self.table.sequence
        return PassFactor.decode_all([(self.stored[k], int(segment[k]), int(sequence[k])) for k in rows])

    def over(self, segment: Ints) -> PackedPasses:
        """The same passes by other numbers (m,) of their segments."""
        return PackedPasses(replace(self.table, segment=segment), self.stored)


def table_of(passes: Sequence[PassFactor]) -> PassColumns:
    """The table of one drive's passes."""
    return (
        passes.table if isinstance(passes, PackedPasses) else PassColumns.in_order([0] * len(passes), passes)
    )


def portions_of(passes: Sequence[PassFactor]) -> Iterator[tuple[slice, Sequence[PassFactor]]]:
    """A drive's passes by the ten thousand."""
    for first in range(0, len(passes), PACKED_AT_ONCE):
        some = slice(first, first + PACKED_AT_ONCE)
        yield some, passes[some]


def encoded(passes: Sequence[PassFactor]) -> Sequence[bytes]:
    """``PassFactor.encode`` of all."""
    return passes.stored if isinstance(passes, PackedPasses) else PassFactor.encode_all(passes)


_KINDS = {"Ints": np.int64, "Floats": np.float64}
