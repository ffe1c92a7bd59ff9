"""Where the work on blocks leaves what later work needs: a folder that all hands reach, or this process's memory."""

from __future__ import annotations

import pickle
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol
from uuid import uuid4

_TRIES, _WAIT_S = 50, 0.02
"""How often a value is looked for that is not there."""

Key = tuple[str, int]
"""What it is, and of which node."""


class Store(Protocol):
    """Values by keys. To put a value again replaces it: work that is done twice does no harm."""

    def put(self, key: Key, value: Any) -> None: ...

    def get(self, key: Key) -> Any: ...


@dataclass(frozen=True)
class MemoryStore:
    """For work in one process."""

    _values: dict[Key, Any] = field(default_factory=dict)

    def __reduce__(self) -> tuple[Any, ...]:
        raise TypeError("hands in other processes do not reach this one's memory: name a folder")

    def put(self, key: Key, value: Any) -> None:
        """Keep a value."""
        self._values[key] = value

    def get(self, key: Key) -> Any:
        """The value of a key."""
        return self._values[key]


@dataclass(frozen=True)
class FolderStore:
    """One file for each value; who gets a value may change it."""

    folder: Path

    def put(self, key: Key, value: Any) -> None:
        """Write a value. Never is half of one read: hands that were taken for dead may write a second one at once."""
        place, partial = self._file(key), self.folder / f".{uuid4().hex}"
        with partial.open("wb") as file:
            pickle.dump(value, file, pickle.HIGHEST_PROTOCOL)
        # Put over a file that is there, it would go to the disk at once, as would whatever is wanted for a second only.
        place.unlink(missing_ok=True)
        partial.replace(place)

    def get(self, key: Key) -> Any:
        """Read the value of a key, which is away for a moment while a second one is written."""
        for _ in range(_TRIES):
            with suppress(FileNotFoundError), self._file(key).open("rb") as file:
                return pickle.load(file)  # noqa: S301 - our own files
            time.sleep(_WAIT_S)
        raise KeyError(key)

    def _file(self, key: Key) -> Path:
        return self.folder / f"{key[0]}-{key[1]}"
