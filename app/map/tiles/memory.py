"""What one process keeps in memory of tiles, up to a number of bytes: what was asked for last stays."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from typing import Generic, Protocol, TypeVar

_BESIDE_BYTES = 500
"""What anything takes beside what it holds."""


class HasSize(Protocol):
    """It knows what it takes in memory."""

    @property
    def size_bytes(self) -> int:
        """About."""


Key = TypeVar("Key", bound=Hashable)
Kept = TypeVar("Kept", bound=HasSize)


class Memory(Generic[Key, Kept]):
    """One of each key, in a state that a tag tells. For one thread."""

    def __init__(self, most_bytes: int) -> None:
        self.most_bytes = most_bytes
        self.bytes = 0
        self.kept: OrderedDict[Key, tuple[str, Kept]] = OrderedDict()

    def get(self, key: Key, tag: str) -> Kept | None:
        """What is kept of the key, where it is in this state."""
        found = self.kept.get(key)
        if found is None or found[0] != tag:
            return None
        self.kept.move_to_end(key)
        return found[1]

    def put(self, key: Key, tag: str, one: Kept) -> None:
        """Keep it in the place of a former one; what was asked for longest ago goes where there is no room."""
        self._forget(self.kept.pop(key, None))
        self.bytes += one.size_bytes + _BESIDE_BYTES
        self.kept[key] = (tag, one)
        while self.bytes > self.most_bytes and self.kept:
            self._forget(self.kept.popitem(last=False)[1])

    def _forget(self, gone: tuple[str, Kept] | None) -> None:
        if gone is not None:
            self.bytes -= gone[1].size_bytes + _BESIDE_BYTES
