"""An order of elimination with little fill: approximate minimum degree (Amestoy, Davis and Duff 1996).

The graph of what is left is kept as a quotient graph: an eliminated unknown is an *element*, a list of the unknowns
that it joined. Unknowns that nothing tells apart any more become one. Values play no part.
"""

from __future__ import annotations

import numpy as np

from fusion.compiled import compiled
from fusion.types import Ints

_VARIABLE, _ELEMENT, _GONE = 0, 1, 2


@compiled
def minimum_degree(start: Ints, index: Ints) -> Ints:  # noqa: C901, PLR0912, PLR0915 (one loop nest)
    """The order (n,) for a symmetric pattern by columns; entries on the diagonal do not matter."""
    n = len(start) - 1
    begin, length, elements = np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros(n, np.int64)
    lists = np.empty(2 * len(index) + n + 1, np.int64)
    end = 0
    for i in range(n):
        begin[i] = end
        for p in range(start[i], start[i + 1]):
            if index[p] != i:
                lists[end] = index[p]
                end += 1
        length[i] = end - begin[i]
    kind, weight, degree = np.zeros(n, np.int8), np.ones(n, np.int64), length.copy()
    into, rank = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    head, after, before = np.full(n + 1, -1, np.int64), np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    mark, level = np.zeros(n, np.int64), 1
    bucket, in_bucket = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    hashed = np.zeros(n, np.int64)
    for i in range(n - 1, -1, -1):
        _insert(head, after, before, i, degree[i])
    eliminated, pivots, least = 0, 0, 0
    while eliminated < n:
        while head[least] < 0:
            least += 1
        pivot = head[least]
        _remove(head, after, before, pivot, degree[pivot])
        own = weight[pivot]
        eliminated += own
        rank[pivot] = pivots
        pivots += 1
        # The unknowns that the pivot joins: of its elements, which it takes over, and of its own list.
        most = length[pivot]
        for q in range(begin[pivot], begin[pivot] + elements[pivot]):
            most += length[lists[q]]
        if end + most > len(lists):
            wider = np.empty(2 * len(lists) + most, np.int64)
            wider[:end] = lists[:end]
            lists = wider
        first = end
        weight[pivot] = 0
        size = 0
        for q in range(begin[pivot], begin[pivot] + length[pivot]):
            one = lists[q]
            is_element = q < begin[pivot] + elements[pivot]
            low, high = (begin[one], begin[one] + length[one]) if is_element else (q, q + 1)
            for r in range(low, high):
                i = lists[r]
                if weight[i] > 0:
                    size += weight[i]
                    weight[i] = -weight[i]
                    lists[end] = i
                    end += 1
                    _remove(head, after, before, i, degree[i])
            if is_element:
                kind[one] = _GONE
        kind[pivot] = _ELEMENT
        begin[pivot], elements[pivot] = first, 0
        # How much of every element lies outside of the new one.
        for q in range(first, end):
            i = lists[q]
            for r in range(begin[i], begin[i] + elements[i]):
                e = lists[r]
                if kind[e] == _ELEMENT:
                    if mark[e] < level:
                        mark[e] = degree[e] + level
                    mark[e] += weight[i]
        # Lists of its unknowns: the new element first, then the others, then what no element covers.
        for q in range(first, end):
            i = lists[q]
            at = begin[i]
            total, code = 0, 0
            for r in range(begin[i], begin[i] + elements[i]):
                e = lists[r]
                if kind[e] != _ELEMENT:
                    continue
                outside = mark[e] - level
                if outside > 0:
                    total += outside
                    code += e
                    lists[at] = e
                    at += 1
                else:
                    kind[e] = _GONE
            others = at
            for r in range(begin[i] + elements[i], begin[i] + length[i]):
                j = lists[r]
                if weight[j] > 0:
                    total += weight[j]
                    code += j
                    lists[at] = j
                    at += 1
            if total == 0:  # it goes with the pivot
                into[i] = pivot
                size += weight[i]
                own -= weight[i]
                eliminated -= weight[i]
                weight[i] = 0
                kind[i] = _GONE
                continue
            degree[i] = min(degree[i], total)
            # There is room: the pivot itself or one of its elements was in the list.
            lists[at] = lists[others]
            lists[others] = lists[begin[i]]
            lists[begin[i]] = pivot
            elements[i], length[i] = others + 1 - begin[i], at + 1 - begin[i]
            code %= n
            hashed[i] = code
            in_bucket[i] = bucket[code]
            bucket[code] = i
        degree[pivot] = size
        level += n + 1
        # Unknowns with equal lists become one.
        for q in range(first, end):
            i = lists[q]
            if weight[i] == 0:
                continue
            i, bucket[hashed[i]] = bucket[hashed[i]], -1
            while i >= 0:
                j, last = in_bucket[i], i
                if j >= 0:
                    level += 1
                    for r in range(begin[i] + 1, begin[i] + length[i]):
                        mark[lists[r]] = level
                while j >= 0:
                    same = length[j] == length[i] and elements[j] == elements[i]
                    r = begin[j] + 1
                    while same and r < begin[j] + length[j]:
                        same = mark[lists[r]] == level
                        r += 1
                    if same:
                        into[j] = i
                        weight[i] += weight[j]
                        weight[j] = 0
                        kind[j] = _GONE
                        in_bucket[last] = in_bucket[j]
                    else:
                        last = j
                    j = in_bucket[j]
                i = in_bucket[i]
        level += n + 1
        at = first
        for q in range(first, end):
            i = lists[q]
            if weight[i] == 0:
                continue
            weight[i] = -weight[i]
            degree[i] = max(min(degree[i] + size - weight[i], n - eliminated - weight[i]), 0)
            _insert(head, after, before, i, degree[i])
            least = min(least, degree[i])
            lists[at] = i
            at += 1
        end = at
        length[pivot] = end - first
    key = np.empty(n, np.int64)
    for i in range(n):
        root = i
        while into[root] >= 0:
            root = into[root]
        key[i] = rank[root]
    return np.argsort(key, kind="mergesort")


@compiled
def _insert(head: Ints, after: Ints, before: Ints, i: int, degree: int) -> None:
    following = head[degree]
    after[i], before[i] = following, -1
    if following >= 0:
        before[following] = i
    head[degree] = i


@compiled
def _remove(head: Ints, after: Ints, before: Ints, i: int, degree: int) -> None:
    if before[i] >= 0:
        after[before[i]] = after[i]
    else:
        head[degree] = after[i]
    if after[i] >= 0:
        before[after[i]] = before[i]
