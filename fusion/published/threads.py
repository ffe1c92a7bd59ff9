"""How many threads parallel loops may take: little work is done before threads have met at a barrier."""

from collections.abc import Iterator
from contextlib import contextmanager

from numba import get_num_threads, set_num_threads


@contextmanager
def at_most_threads(count: int) -> Iterator[None]:
    """At most ``count``, at least one, and no more than there were."""
    before = get_num_threads()
    set_num_threads(max(1, min(before, count)))
    try:
        yield
    finally:
        set_num_threads(before)
