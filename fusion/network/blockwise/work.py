"""Who does the work on blocks, and in what order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from heapq import heappop, heappush
from typing import Any

EACH_WAITING = 4
"""Tasks that are handed out for each of the hands: none waits for the next, and what they return never piles up."""

Job = tuple[Any, ...]
"""A function that can be sent to another process, and its arguments."""


def done(
    executor: Executor | None,
    order: Sequence[int],
    before: Mapping[int, Sequence[int]],
    job: Callable[[int], Job],
    hands: int = 2,
    bundle: Sequence[int] | None = None,
) -> Iterator[tuple[int, Any]]:
    """The results of the jobs of all numbers in ``order``, as they come; each begins after those ``before`` it.

    ``order`` puts every number behind those before it; where there is a choice what comes first in it begins first.
    ``hands``: how many tasks are worked on at once. Jobs of one ``bundle``, by number, are one task: to hand out a task
    costs 10 ms and more.
    """
    if executor is None:
        for number in order:
            work, *arguments = job(number)
            yield number, work(*arguments)
        return
    bundles: dict[int, list[int]] = {}
    for number in order:
        bundles.setdefault(number if bundle is None else int(bundle[number]), []).append(number)
    of = {number: one for one, numbers in bundles.items() for number in numbers}
    rank = {one: k for k, one in enumerate(bundles)}
    former = {
        one: {of[f] for n in numbers for f in before.get(n, ())} - {one} for one, numbers in bundles.items()
    }
    after: dict[int, list[int]] = {one: [] for one in bundles}
    for one, first in ((one, first) for one, every in former.items() for first in every):
        after[first].append(one)
    left = {one: len(every) for one, every in former.items()}
    by_rank = [*bundles]
    ready = [rank[one] for one in bundles if not left[one]]  # ascending is a heap
    flying: dict[Future[Any], int] = {}
    while ready or flying:
        while ready and len(flying) < EACH_WAITING * hands:
            one = by_rank[heappop(ready)]
            flying[executor.submit(in_turn, [job(number) for number in bundles[one]])] = one
        for future in wait(flying, return_when=FIRST_COMPLETED).done:
            one = flying.pop(future)
            yield from zip(bundles[one], future.result(), strict=True)
            for following in after[one]:
                left[following] -= 1
                if not left[following]:
                    heappush(ready, rank[following])


def in_turn(jobs: Sequence[Job]) -> list[Any]:
    """What several jobs return, one after the other."""
    return [work(*arguments) for work, *arguments in jobs]
