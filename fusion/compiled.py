"""Compiling hot loops: one set of decorators, typed, with a cache on disk that is never stale.

Knows numba and files; knows nothing of what is computed.

A compiled function holds the machine code of the functions that it calls, and the constants that it reads, wherever
they are written. numba's own cache looks at the file of the function alone, so that after an update of a callee the
old machine code would run on. Here a cached function is fresh as long as its file **and every file of its package that
it imports, directly or through others,** have the content that they had: names reach a compiled function by imports.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit
from numba.core import caching, config

try:
    import fcntl
except ImportError:  # no POSIX system
    fcntl = None  # type: ignore[assignment]

F = TypeVar("F", bound=Callable[..., Any])

# Sums may be taken in another order and products fused, so that loops run on whole vector registers; infinities
# and NaN keep their meaning. The process that compiles such a loop may get other last digits than those that load it
# from the cache, since what is inlined there differs; from then on the same build gives the same digits.
_VECTOR_MATH = {"reassoc", "contract", "arcp", "nsz"}

_STAMP_LENGTH = 16  # hex digits in a file's name

_IMPORT = re.compile(r"^\s*(?:from|import)\s+([\w.]+)(?:\s+import\s+(\([^)]*\)|[^\n]*))?", re.MULTILINE)


def compiled(function: F) -> F:
    """Compile with numba at first call, without the GIL; kept on disk, so that no request waits for it."""
    return _compile(function)


def compiled_vector(function: F) -> F:
    """As ``compiled``, for arithmetic over arrays: division by zero gives infinity and sums may be regrouped."""
    return _compile(function, error_model="numpy", fastmath=_VECTOR_MATH)


def compiled_parallel(function: F) -> F:
    """As ``compiled_vector``, with ``prange`` loops spread over the cores."""
    return _compile(function, error_model="numpy", fastmath=_VECTOR_MATH, parallel=True)


def inlined(function: F) -> F:
    """As ``compiled``, pasted into its callers: handing over dozens of arrays costs more than most bodies."""
    return cast(F, njit(inline="always")(function))


def _compile(function: F, **options: Any) -> F:
    # numba asks for the kind of its cache once, when caching is switched on for a function.
    former = config.CACHE_LOCATOR_CLASSES
    config.CACHE_LOCATOR_CLASSES = _LOCATORS
    loop = njit(nogil=True, **options)(function)
    try:
        with suppress(RuntimeError):  # no folder can be written to: each process compiles for itself
            loop._cache = _Cache(function)  # as numba's cache=True does
    finally:
        config.CACHE_LOCATOR_CLASSES = former
    return cast(F, loop)


def cache_folder(function: Callable[..., Any]) -> Path | None:
    """Where the machine code of a compiled function is kept; None where it cannot be."""
    path = cast(Any, function)._cache.cache_path
    return None if path is None else Path(path)


class _Cache(caching.FunctionCache):  # type: ignore[misc]
    """What cannot be written (read-only, no room) is compiled again by the next process, and no error."""

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code of one signature.

        One process at a time: numba looks which names of files are taken and takes the next one, so that of two that
        do so at once one would have the machine code of the other's signature under its own.
        """
        with suppress(OSError), _alone_in(self.cache_path):
            super().save_overload(sig, data)


@contextmanager
def _alone_in(folder: str) -> Iterator[None]:
    """Keep other processes out of such a block; not where the system or the folder knows no such locks."""
    if fcntl is None:
        yield
        return
    held = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):
            fcntl.flock(held, fcntl.LOCK_EX)
        yield
    finally:
        os.close(held)


class _StampedByContent(caching._CacheLocator):  # type: ignore[misc]
    """Where a function's machine code is kept, and by what it is known to be fresh.

    The stamp is in the files' names too: numba reads a file before it looks at the stamp inside, and one that an older
    version wrote may name classes that have moved since.
    """

    _py_file: str
    _lineno: int

    def ensure_cache_path(self) -> None:
        """Raise ``OSError`` where nothing can be kept; a read-only folder serves if somebody has filled it before."""
        try:
            super().ensure_cache_path()
        except OSError:
            if not any(Path(self.get_cache_path()).glob("*.nbi")):
                raise

    def get_source_stamp(self) -> str:
        """SHA-256 of all that the function may be compiled from."""
        return content_stamp(Path(self._py_file))

    def get_disambiguator(self) -> str:
        """What tells files of functions of one name apart. Files that other contents left behind are removed."""
        stamp = self.get_source_stamp()[:_STAMP_LENGTH]
        _remove_superseded(Path(self.get_cache_path()), Path(self._py_file).stem, stamp)
        return f"{self._lineno}-{stamp}"


class InChosenFolder(_StampedByContent, caching.UserProvidedCacheLocator):  # type: ignore[misc]
    """In the folder that NUMBA_CACHE_DIR names, where it names one."""


class BesideSource(_StampedByContent, caching.InTreeCacheLocator):  # type: ignore[misc]
    """In ``__pycache__`` beside the source, where that can be written to."""


class InHome(_StampedByContent, caching.UserWideCacheLocator):  # type: ignore[misc]
    """In the user's own cache folder."""


_LOCATORS = ",".join(f"{__name__}.{kind.__name__}" for kind in (InChosenFolder, BesideSource, InHome))


@cache
def _remove_superseded(folder: Path, module: str, stamp: str) -> None:
    """Delete the machine code of a module's functions that was made from other contents."""
    for file in folder.glob(f"{module}.*.nb[ic]"):
        if f"-{stamp}." not in file.name:
            with suppress(OSError):  # not ours to delete, or another process was faster
                file.unlink()


@cache
def content_stamp(file: Path) -> str:
    """SHA-256 (hex) over the contents of ``file`` and of all files of its top-level package that it imports.

    Imports of imports count as well. A file outside any package stands for itself.
    """
    digest = hashlib.sha256()
    for source in sorted(_reach(file.resolve())):
        digest.update(_read(source).encode())
    return digest.hexdigest()


def _reach(file: Path) -> set[Path]:
    """The file and all that it imports of its own package, directly or not."""
    imported, waiting = {file}, [file]
    while waiting:
        new = _imports(waiting.pop()) - imported
        imported |= new
        waiting += new
    return imported


@cache
def _read(file: Path) -> str:
    return file.read_text(encoding="utf-8")


@cache
def _imports(file: Path) -> frozenset[Path]:
    """Files of the same top-level package that ``file`` names in an import statement, wherever in it."""
    package = _top_package(file)
    if package is None:
        return frozenset()
    named: set[str] = set()
    for module, names in _IMPORT.findall(_read(file)):
        if module.split(".")[0] == package.name:
            named.add(module)
            named |= {f"{module}.{name}" for name in re.findall(r"\w+", names)}  # a name may be a module
    paths = (package.parent.joinpath(*name.split(".")) for name in named)
    known = (place for path in paths for place in (path.with_suffix(".py"), path / "__init__.py"))
    return frozenset(place for place in known if place.exists())


def _top_package(file: Path) -> Path | None:
    """The folder of the outermost package that holds the file."""
    inside = [folder for folder in file.parents if (folder / "__init__.py").exists()]
    return inside[-1] if inside else None
