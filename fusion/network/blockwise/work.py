"""Who does the work on blocks, and in what order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from heapq import heappop, heappush
from typing import Any

AT_ONCE = 8
"""Tasks that are handed out at once: enough for a few hands, and few enough that what they return never piles up."""

Job = tuple[Any, ...]
"""A function that can be sent to another process, and its arguments."""


def done(
    executor: Executor | None,
    order: Sequence[int],
    before: Mapping[int, Sequence[int]],
    job: Callable[[int], Job],
) -> Iterator[tuple[int, Any]]:
    """The results of the jobs of all numbers in ``order``, as they come; each begins after those ``before`` it.

    ``order`` puts every number behind those before it; where there is a choice what comes first in it begins first.
    """
    if executor is None:
        for number in order:
            work, *arguments = job(number)
            yield number, work(*arguments)
        return
    rank = {number: k for k, number in enumerate(order)}
    left = {number: len(before.get(number, ())) for number in order}
    after: dict[int, list[int]] = {number: [] for number in order}
    for number, former in ((n, f) for n in order for f in before.get(n, ())):
        after[former].append(number)
    ready = [rank[number] for number in order if not left[number]]  # ascending is a heap
    flying: dict[Future[Any], int] = {}
    while ready or flying:
        while ready and len(flying) < AT_ONCE:
            number = order[heappop(ready)]
            flying[executor.submit(*job(number))] = number
        for future in wait(flying, return_when=FIRST_COMPLETED).done:
            number = flying.pop(future)
            yield number, future.result()
            for following in after[number]:
                left[following] -= 1
                if not left[following]:
                    heappush(ready, rank[following])
