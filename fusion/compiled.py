"""Compiling hot loops, in a way that keeps their types for the type checker."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile with numba at first call, without the GIL; kept on disk, so that no request waits for it.

    The cache on disk watches only the file of the function: after a change to a kernel that another file
    calls, ``make clean`` throws the caches away.
    """
    return cast(F, njit(cache=True, nogil=True)(function))


def compiled_parallel(function: F) -> F:
    """As ``compiled``, with ``prange`` loops spread over the cores."""
    return cast(F, njit(cache=True, nogil=True, parallel=True)(function))
