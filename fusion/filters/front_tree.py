"""How a sparse matrix is eliminated: a tree of small dense matrices (fronts), found from its pattern alone.

Columns of the factor with the same pattern form a front of k columns over m = k + r unknowns; its part of the factor
is a panel (m, k), and what it leaves to its r later unknowns goes to the front of its parent in the elimination tree
(multifrontal elimination, Duff and Reid 1983). Fronts are numbered children first. Values are not known here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fusion.compiled import compiled
from fusion.types import Floats, Ints

SMALL_FRONT = 16
"""Fronts of up to so many columns are joined with their child where that adds few zeros."""
ZERO_SHARE = 0.3


class Tree(NamedTuple):
    """f fronts over n unknowns in the order of elimination.

    ``first`` (f + 1,): the first column of each front. ``row_start`` (f + 1,), ``rows``: its later unknowns, ascending.
    ``parent`` (f,): -1 for roots. ``relative``: where each of ``rows`` stands in the parent's front. ``panel_start``
    (f + 1,): where its panel begins among all. ``stack``: numbers that are held at most while going up and down.
    """

    first: Ints
    row_start: Ints
    rows: Ints
    parent: Ints
    relative: Ints
    panel_start: Ints
    stack: tuple[int, int]


@compiled
def elimination_tree(start: Ints, index: Ints, interior: int) -> Ints:
    """Parent (n,) of each of the first ``interior`` columns (Liu 1990), from the upper triangle by columns."""
    n = len(start) - 1
    parent, ancestor = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    for k in range(n):
        for p in range(start[k], start[k + 1]):
            i = index[p]
            while i < k and i < interior:
                following = ancestor[i]
                ancestor[i] = k
                if following < 0:
                    parent[i] = k
                    break
                if following == k:
                    break
                i = following
    return parent


@compiled
def postorder(parent: Ints, interior: int) -> Ints:
    """The first ``interior`` columns, children before parents and each subtree in one run."""
    head, following = np.full(interior + 1, -1, np.int64), np.full(interior, -1, np.int64)
    for j in range(interior - 1, -1, -1):
        above = parent[j] if 0 <= parent[j] < interior else interior
        following[j] = head[above]
        head[above] = j
    out, stack = np.empty(interior, np.int64), np.empty(interior + 1, np.int64)
    count, depth = 0, 0
    stack[0] = interior
    while depth >= 0:
        at = stack[depth]
        child = head[at]
        if child >= 0:
            head[at] = following[child]
            depth += 1
            stack[depth] = child
        else:
            depth -= 1
            if at < interior:
                out[count] = at
                count += 1
    return out


@compiled
def column_counts(start: Ints, index: Ints, parent: Ints, interior: int) -> Ints:
    """Entries below the diagonal of each of the first ``interior`` columns of the factor."""
    n = len(start) - 1
    seen, count = np.full(n, -1, np.int64), np.zeros(interior, np.int64)
    for k in range(n):
        seen[k] = k
        for p in range(start[k], start[k + 1]):
            i = index[p]
            while i < k and i < interior and seen[i] != k:
                count[i] += 1
                seen[i] = k
                i = parent[i]
    return count


@compiled
def front_columns(parent: Ints, count: Ints) -> Ints:
    """Where fronts begin: columns of one pattern, and chains that cost few zeros more."""
    n = len(count)
    first, zeros = np.empty(n + 1, np.int64), np.zeros(n + 1, np.int64)
    fronts, j = 0, 0
    while j < n:
        last = j
        while last + 1 < n and parent[last] == last + 1 and count[last] == count[last + 1] + 1:
            last += 1
        first[fronts], zeros[fronts] = j, 0
        if fronts > 0 and parent[j - 1] == j:
            k_before, k = j - first[fronts - 1], last + 1 - j
            merged = k_before + k + count[last]
            added = k_before * (k + count[last] - count[j - 1]) + zeros[fronts - 1]
            if k <= SMALL_FRONT and added < ZERO_SHARE * (k_before + k) * merged:
                fronts -= 1
                zeros[fronts] = added
        fronts += 1
        j = last + 1
    first[fronts] = n
    return first[: fronts + 1].copy()


@compiled
def front_rows(first: Ints, count: Ints, start: Ints, index: Ints) -> tuple[Ints, Ints, Ints]:
    """``row_start``, ``rows`` and ``parent`` of ``Tree``; ``start``, ``index``: the lower triangle by columns."""
    fronts, n = len(first) - 1, len(start) - 1
    front_of = np.empty(n, np.int64)
    row_start = np.zeros(fronts + 1, np.int64)
    above = np.full(fronts, -1, np.int64)
    for s in range(fronts):
        front_of[first[s] : first[s + 1]] = s
        last = first[s + 1] - 1
        row_start[s + 1] = row_start[s] + (count[last] if last < len(count) else 0)
    rows = np.empty(row_start[-1], np.int64)
    child, sibling = np.full(fronts, -1, np.int64), np.full(fronts, -1, np.int64)
    seen = np.full(n, -1, np.int64)
    for s in range(fronts):
        end = first[s + 1]
        at = row_start[s]
        at = _add_new(index, start[first[s]], start[end], end, s, seen, rows, at)
        c = child[s]
        while c >= 0:
            at = _add_new(rows, row_start[c], row_start[c + 1], end, s, seen, rows, at)
            c = sibling[c]
        if at > row_start[s]:
            rows[row_start[s] : at] = np.sort(rows[row_start[s] : at])
            above[s] = front_of[rows[row_start[s]]]
            sibling[s] = child[above[s]]
            child[above[s]] = s
    return row_start, rows, above


@compiled
def _add_new(found: Ints, begin: int, until: int, end: int, s: int, seen: Ints, rows: Ints, at: int) -> int:
    """Append to ``rows`` from ``at`` what is ``found`` from ``end`` on and front ``s`` has not seen; the new end."""
    for q in range(begin, until):
        i = found[q]
        if i >= end and seen[i] != s:
            seen[i] = s
            rows[at] = i
            at += 1
    return at


@compiled
def relative_rows(first: Ints, row_start: Ints, rows: Ints, parent: Ints) -> Ints:
    """Where each of a front's ``rows`` stands in the front of its parent."""
    out = np.empty(len(rows), np.int64)
    for s in range(len(parent)):
        if parent[s] >= 0:
            p = parent[s]
            k = first[p + 1] - first[p]
            theirs = rows[row_start[p] : row_start[p + 1]]
            for q in range(row_start[s], row_start[s + 1]):
                i = rows[q]
                out[q] = i - first[p] if i < first[p + 1] else k + np.searchsorted(theirs, i)
    return out


@compiled
def stack_sizes(first: Ints, row_start: Ints, parent: Ints) -> tuple[int, int]:
    """Numbers that the stacks of ``factorise`` and ``selected_inverse`` hold at most."""
    fronts = len(first) - 1
    children = np.zeros(fronts, np.int64)
    held, most = 0, 0
    freed = np.zeros(fronts, np.int64)
    for s in range(fronts):
        size = (row_start[s + 1] - row_start[s]) ** 2
        most = max(most, held + size)
        held += size - freed[s]
        if parent[s] >= 0:
            children[parent[s]] += 1
            freed[parent[s]] += size
        else:
            held -= size
    held, down = 0, 0
    left = children.copy()
    for s in range(fronts - 1, -1, -1):
        size = (first[s + 1] - first[s] + row_start[s + 1] - row_start[s]) ** 2
        p = parent[s]
        if p >= 0:
            left[p] -= 1
            if left[p] == 0:
                held -= (first[p + 1] - first[p] + row_start[p + 1] - row_start[p]) ** 2
        if children[s]:
            held += size
        down = max(down, held)
    return most, down


@compiled
def triangle(start: Ints, index: Ints, order: Ints, place: Ints, upper: bool) -> tuple[Ints, Ints]:
    """Column starts and rows of a strict triangle of a symmetric pattern, put into another order."""
    n = len(order)
    begin, rows = np.zeros(n + 1, np.int64), np.empty(len(index), np.int64)
    at = 0
    for k in range(n):
        for p in range(start[order[k]], start[order[k] + 1]):
            i = place[index[p]]
            if (i < k) if upper else (i > k):
                rows[at] = i
                at += 1
        begin[k + 1] = at
    return begin, rows[:at].copy()


@compiled
def slot(tree: Tree, front_of: Ints, a: int, b: int) -> int:
    """Where the panels hold the entry of places ``a`` and ``b``; -1 outside the pattern."""
    column, row = min(a, b), max(a, b)
    s = front_of[column]
    begin, end = tree.first[s], tree.first[s + 1]
    local = row - begin
    if row >= end:
        low, high = tree.row_start[s], tree.row_start[s + 1]
        while low < high:  # numba's search takes thrice as long
            middle = (low + high) // 2
            if tree.rows[middle] < row:
                low = middle + 1
            else:
                high = middle
        if low == tree.row_start[s + 1] or tree.rows[low] != row:
            return -1
        local = end - begin + low - tree.row_start[s]
    return int(tree.panel_start[s] + local * (end - begin) + column - begin)


@compiled
def slots_of(where: Ints, tree: Tree, front_of: Ints) -> Ints:
    """Slots (m, k (k + 1) / 2) of the lower triangles of blocks over places ``where`` (m, k), row by row."""
    k = where.shape[1]
    out = np.empty((len(where), k * (k + 1) // 2), np.int64)
    for m in range(len(where)):
        at = 0
        for a in range(k):
            for b in range(a + 1):
                out[m, at] = slot(tree, front_of, where[m, a], where[m, b])
                at += 1
    return out


@compiled
def add_blocks(panels: Floats, slots: Ints, information: Floats, weight: Floats) -> None:
    """Add blocks ``information`` (m, k, k) times ``weight`` (m,) to where ``slots_of`` says."""
    k = information.shape[1]
    for m in range(len(slots)):
        at = 0
        for a in range(k):
            for b in range(a + 1):
                panels[slots[m, at]] += weight[m] * information[m, a, b]
                at += 1


@compiled
def gather_blocks(where: Ints, tree: Tree, front_of: Ints, inverse: Floats, out: Floats) -> None:
    """Collect blocks of the selected inverse for rows of places ``where`` (m, k) into ``out`` (m, k, k)."""
    for m in range(where.shape[0]):
        for a in range(where.shape[1]):
            for b in range(a + 1):
                at = slot(tree, front_of, where[m, a], where[m, b])
                value = inverse[at] if at >= 0 else np.nan
                out[m, a, b] = value
                out[m, b, a] = value
