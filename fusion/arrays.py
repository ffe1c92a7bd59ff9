"""Names for the arrays that everything is made of, tables of them, and how rows are found and counted."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class ColumnTable:
    """Base of tables whose fields are columns of one length, (n, ...) each."""

    VECTORS: ClassVar[tuple[str, ...]] = ()
    """The columns of shape (n, 3); the others have (n,)."""

    def __len__(self) -> int:
        return len(getattr(self, fields(self)[0].name))

    @classmethod
    def empty(cls) -> Self:
        """A table without rows."""
        kinds = {"Ints": np.int64, "Bools": np.bool_}
        return cls(
            **{
                spec.name: np.empty(
                    (0, 3) if spec.name in cls.VECTORS else 0, kinds.get(str(spec.type), np.float64)
                )
                for spec in fields(cls)
            }
        )

    def take(self, keep: NDArray[Any] | slice) -> Self:
        """The rows selected by a mask, an index array or a slice."""
        return type(self)(**{spec.name: getattr(self, spec.name)[keep] for spec in fields(self)})

    def joined(self, *others: Self) -> Self:
        """These rows, then those of the others."""
        tables = (self, *others)
        return type(self)(
            **{spec.name: np.concatenate([getattr(t, spec.name) for t in tables]) for spec in fields(self)}
        )


def nearest(known: Floats, wanted: Floats) -> Ints:
    """For each of ``wanted`` (m,) where in ``known`` (n,), ascending and not empty, the nearest number stands.

    Of two that are equally near it is the later one.
    """
    right = np.clip(np.searchsorted(known, wanted), 0, len(known) - 1)
    left = np.maximum(right - 1, 0)
    return np.where(wanted - known[left] < known[right] - wanted, left, right)


def counted(count: Ints) -> tuple[Ints, Ints]:
    """For each of ``count`` (n,) things of every row: the row, and its number there."""
    row = np.repeat(np.arange(len(count)), count)
    return row, np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
