"""Compiling hot loops, in a way that keeps their types for the type checker."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])

# Sums may be taken in another order and products fused, so that loops run on whole vector registers; infinities
# and NaN keep their meaning, and the same build gives the same digits.
_VECTOR_MATH = {"reassoc", "contract", "arcp", "nsz"}


def compiled(function: F) -> F:
    """Compile with numba at first call, without the GIL; kept on disk, so that no request waits for it.

    The cache on disk watches only the file of the function: after a change to a kernel that another file
    calls, ``make clean`` throws the caches away.
    """
    return cast(F, njit(cache=True, nogil=True)(function))


def compiled_vector(function: F) -> F:
    """As ``compiled``, for arithmetic over arrays: division by zero gives infinity and sums may be regrouped."""
    return cast(F, njit(cache=True, nogil=True, error_model="numpy", fastmath=_VECTOR_MATH)(function))


def compiled_parallel(function: F) -> F:
    """As ``compiled_vector``, with ``prange`` loops spread over the cores."""
    options = {
        "cache": True,
        "nogil": True,
        "error_model": "numpy",
        "fastmath": _VECTOR_MATH,
        "parallel": True,
    }
    return cast(F, njit(**options)(function))
