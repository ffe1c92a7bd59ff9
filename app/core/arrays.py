"""NumPy's vectors as PostgreSQL's arrays, in binary: number by number as text, a window's thousands of ids cost more
than the statement that they are for. What a masked vector masks is NULL.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import psycopg
from numpy.typing import NDArray
from psycopg.adapt import Buffer, Dumper, PyFormat
from psycopg.pq import Format

_HEADER = np.dtype(">i4")


class ArrayDumper(Dumper):
    """Chooses by the kind of numbers; raises ``psycopg.DataError`` for what has no array type of PostgreSQL here."""

    format = Format.BINARY

    def get_key(self, obj: NDArray[Any], format: PyFormat) -> Any:  # noqa: A002 - psycopg's name
        """One dumper for each kind of numbers."""
        return (self.cls, obj.dtype.kind)

    def upgrade(self, obj: NDArray[Any], format: PyFormat) -> Dumper:  # noqa: A002 - psycopg's name
        """The dumper of these numbers."""
        vector = _OF_KIND.get(obj.dtype.kind)
        if vector is None or obj.ndim != 1:
            raise psycopg.DataError(
                f"PostgreSQL gets vectors of numbers, not {obj.ndim} dimensions of {obj.dtype}"
            )
        return vector(self.cls)

    def dump(self, obj: NDArray[Any]) -> Buffer | None:
        """Never called: ``upgrade`` has chosen another."""
        raise NotImplementedError


class _Vector(ArrayDumper):
    """PostgreSQL's binary form: dimensions, whether there are nulls, the element's type, length, first index; then size
    and value of each, a null as a size of -1 and no value."""

    element_oid: ClassVar[int]
    value: ClassVar[np.dtype[Any]]

    def dump(self, obj: NDArray[Any]) -> Buffer:
        """The whole array."""
        if not len(obj):
            return np.array([0, 0, self.element_oid], _HEADER).tobytes()
        null = np.ma.getmaskarray(obj)
        elements = np.empty(len(obj), [("size", _HEADER), ("value", self.value)])
        elements["size"] = np.where(null, -1, self.value.itemsize)
        elements["value"] = np.ma.getdata(obj)
        written = np.ones((len(obj), elements.itemsize), bool)
        written[null, _HEADER.itemsize :] = False
        header = np.array([1, null.any(), self.element_oid, len(obj), 1], _HEADER)
        return header.tobytes() + elements.view(np.uint8).reshape(written.shape)[written].tobytes()


class _BigInts(_Vector):
    oid, element_oid, value = 1016, 20, np.dtype(">i8")


class _Doubles(_Vector):
    oid, element_oid, value = 1022, 701, np.dtype(">f8")


class _Booleans(_Vector):
    oid, element_oid, value = 1000, 16, np.dtype("?")


_OF_KIND: dict[str, type[_Vector]] = {"i": _BigInts, "f": _Doubles, "b": _Booleans}


def register() -> None:
    """Let every connection that is opened from now on take NumPy's vectors."""
    for vector in (np.ndarray, np.ma.MaskedArray):
        psycopg.adapters.register_dumper(vector, ArrayDumper)
