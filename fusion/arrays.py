"""Names for the arrays that everything is made of, and tables of them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class ColumnTable:
    """Base of tables whose fields are columns of one length, (n, ...) each."""

    def __len__(self) -> int:
        return len(getattr(self, fields(self)[0].name))

    def take(self, keep: NDArray[Any] | slice) -> Self:
        """The rows selected by a mask, an index array or a slice."""
        return type(self)(**{spec.name: getattr(self, spec.name)[keep] for spec in fields(self)})

    def joined(self, *others: Self) -> Self:
        """These rows, then those of the others."""
        tables = (self, *others)
        return type(self)(
            **{spec.name: np.concatenate([getattr(t, spec.name) for t in tables]) for spec in fields(self)}
        )
