"""What the mosaics of one elevation model keep in memory: open files, blocks read and local grids, each bounded.

Knows nothing of what a block holds or where it lies.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Any, Generic, TypeVar

from fusion.terrain.raster import Raster, open_raster

MAX_BLOCKS = 128  # of 0.5 MB each
MAX_OPEN_FILES = 32
_MAX_LOCAL_GRIDS = 1024  # of 1 kB each

T = TypeVar("T")


class DemCache:
    """Three bounded caches behind one lock: rasterio's datasets must not be used by two threads at once."""

    def __init__(self, before_read: Callable[[], object] = lambda: None) -> None:
        """``before_read`` is called before each block that is read; what it raises ends the reading."""
        self._lock, self._before_read = Lock(), before_read
        self._files: _LruCache[Any] = _LruCache(MAX_OPEN_FILES, lambda dataset: dataset.close())
        self._blocks: _LruCache[Any] = _LruCache(MAX_BLOCKS)
        self._local_grids: _LruCache[Any] = _LruCache(_MAX_LOCAL_GRIDS)
        self._closed = False

    def dataset(self, raster: Raster) -> Any:
        """The open dataset of a raster. Only for what ``block`` calls, under the lock."""
        return self._files.get(raster, lambda: open_raster(raster.path, trusted=raster.trusted)[1])

    def block(self, key: Hashable, make: Callable[[], T]) -> T:
        """What ``make`` read from the files before, or reads now; ``ValueError`` once the model is closed."""

        def read() -> T:
            self._before_read()
            return make()

        with self._lock:
            if self._closed:
                raise ValueError("the elevation model is closed")
            block: T = self._blocks.get(key, read)
            return block

    def local_grid(self, key: Hashable, make: Callable[[], T]) -> T:
        """What ``make`` computed before, or computes now."""
        with self._lock:
            local_grid: T = self._local_grids.get(key, make)
            return local_grid

    def close(self) -> None:
        """Close every file and forget everything."""
        with self._lock:
            self._closed = True
            for cache in (self._files, self._blocks, self._local_grids):
                cache.clear()


class _LruCache(Generic[T]):
    """At most ``limit`` things by key. A thing that is missing is made when it is asked for."""

    def __init__(self, limit: int, drop: Callable[[T], object] | None = None) -> None:
        """``drop`` is called with each thing that has to go."""
        self._limit, self._drop = limit, drop
        self._things: OrderedDict[Hashable, T] = OrderedDict()

    def __len__(self) -> int:
        return len(self._things)

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """The thing of this key; the one that was not used for longest makes room for a new one."""
        if key not in self._things:
            self._things[key] = make()
            if len(self._things) > self._limit:
                self._discard(self._things.popitem(last=False)[1])
        self._things.move_to_end(key)
        return self._things[key]

    def clear(self) -> None:
        """Drop everything."""
        while self._things:
            self._discard(self._things.popitem(last=False)[1])

    def _discard(self, thing: T) -> None:
        if self._drop is not None:
            self._drop(thing)
