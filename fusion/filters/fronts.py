"""The compiled arithmetic of ``sparse_inverse``: Cholesky factors and selected inverses, front by front.

Which front is what, and where its panel is, says ``front_tree``.
"""

from __future__ import annotations

import numpy as np

from fusion.compiled import compiled, compiled_vector
from fusion.filters.front_tree import Tree
from fusion.types import Floats, Ints

BLAS_FROM = 100_000
"""Products of more multiplications than this go to BLAS; for smaller ones calling it costs more than it saves."""


@compiled_vector
def factorise(tree: Tree, open_fronts: int, panels: Floats) -> bool:
    """Turn ``panels`` into the Cholesky factor, but for the last ``open_fronts``; False where a pivot is not positive.

    A front that stays open is left as it is after all others are eliminated (its lower triangle).
    """
    first, row_start, parent = tree.first, tree.row_start, tree.parent
    fronts = len(first) - 1
    stack = np.empty(tree.stack[0])
    begin = np.empty(fronts, np.int64)
    child, sibling = np.full(fronts, -1, np.int64), np.full(fronts, -1, np.int64)
    top = 0
    for s in range(fronts):
        k, r = first[s + 1] - first[s], row_start[s + 1] - row_start[s]
        panel = panels[tree.panel_start[s] : tree.panel_start[s + 1]].reshape(k + r, k)
        update = stack[top : top + r * r].reshape(r, r)
        update[:] = 0.0
        c, bottom = child[s], top
        while c >= 0:
            _extend(stack, begin[c], tree.relative[row_start[c] : row_start[c + 1]], k, panel, update)
            bottom = begin[c]
            c = sibling[c]
        if s < fronts - open_fronts:
            if not _eliminate(panel, k):
                return False
            _downdate(panel, update, k)
        # The children's parts are gone: this front's takes their place.
        if bottom < top:
            for q in range(r * r):
                stack[bottom + q] = stack[top + q]
        begin[s] = bottom
        top = bottom + r * r
        if parent[s] >= 0:
            sibling[s] = child[parent[s]]
            child[parent[s]] = s
        else:
            top = bottom
    return True


@compiled_vector
def _extend(stack: Floats, begin: int, place: Ints, k: int, panel: Floats, update: Floats) -> None:
    r = len(place)
    for i in range(r):
        a, row = place[i], begin + i * r
        for j in range(i + 1):
            b = place[j]
            if b < k:
                panel[a, b] += stack[row + j]
            else:
                update[a - k, b - k] += stack[row + j]


@compiled_vector
def _eliminate(panel: Floats, k: int) -> bool:
    """Cholesky of the first k rows, and the others over it, row by row."""
    for i in range(len(panel)):
        for j in range(min(i + 1, k)):
            total = panel[i, j]
            for p in range(j):
                total -= panel[i, p] * panel[j, p]
            if i > j:
                panel[i, j] = total / panel[j, j]
            elif total > 0.0:
                panel[i, i] = np.sqrt(total)
            else:
                return False
    return True


@compiled_vector
def _downdate(panel: Floats, update: Floats, k: int) -> None:
    """Take off what the eliminated columns carry: the lower triangle of L21 L21'."""
    r = len(update)
    if r * r * k > BLAS_FROM:
        across = np.ascontiguousarray(panel[k:].T)
        update -= np.dot(panel[k:], across)
        return
    across = np.ascontiguousarray(panel[k:].T)
    p = 0
    while p + 1 < k:
        for i in range(r):
            u, v = panel[k + i, p], panel[k + i, p + 1]
            for j in range(i + 1):
                update[i, j] -= u * across[p, j] + v * across[p + 1, j]
        p += 2
    if p < k:
        for i in range(r):
            u = panel[k + i, p]
            for j in range(i + 1):
                update[i, j] -= u * across[p, j]


@compiled
def solve_in_place(tree: Tree, open_fronts: int, panels: Floats, x: Floats, forward: bool) -> None:
    """Forward: the right-hand side over L, what is left for the open fronts among it. Else: back from the open's x."""
    first, row_start = tree.first, tree.row_start
    fronts = len(first) - 1 - open_fronts
    for number in range(fronts):
        s = number if forward else fronts - 1 - number
        k, r = first[s + 1] - first[s], row_start[s + 1] - row_start[s]
        panel = panels[tree.panel_start[s] : tree.panel_start[s + 1]].reshape(k + r, k)
        mine, rows = x[first[s] : first[s + 1]], tree.rows[row_start[s] : row_start[s + 1]]
        if forward:
            for j in range(k):
                for p in range(j):
                    mine[j] -= panel[j, p] * mine[p]
                mine[j] /= panel[j, j]
            for i in range(r):
                total = 0.0
                for j in range(k):
                    total += panel[k + i, j] * mine[j]
                x[rows[i]] -= total
        else:
            for i in range(r):
                here = x[rows[i]]
                for j in range(k):
                    mine[j] -= panel[k + i, j] * here
            for j in range(k - 1, -1, -1):
                mine[j] /= panel[j, j]
                for p in range(j):
                    mine[p] -= panel[j, p] * mine[j]


@compiled_vector
def selected_inverse(tree: Tree, open_fronts: int, panels: Floats, inverse: Floats) -> None:
    """Fill ``inverse``, panels of the inverse, from the last front to the first (after Takahashi, Fagan, Chin 1973).

    Of open fronts the inverse is there already.
    """
    first, row_start, parent = tree.first, tree.row_start, tree.parent
    fronts = len(first) - 1
    children, begin = np.zeros(fronts, np.int64), np.zeros(fronts, np.int64)
    for s in range(fronts):
        if parent[s] >= 0:
            children[parent[s]] += 1
    left = children.copy()
    stack = np.empty(tree.stack[1])
    top = 0
    for s in range(fronts - 1, -1, -1):
        k, r = first[s + 1] - first[s], row_start[s + 1] - row_start[s]
        rest = np.empty((r, r))
        p = parent[s]
        if p >= 0:
            m = first[p + 1] - first[p] + row_start[p + 1] - row_start[p]
            place = tree.relative[row_start[s] : row_start[s + 1]]
            for i in range(r):
                at = begin[p] + place[i] * m
                for j in range(r):
                    rest[i, j] = stack[at + place[j]]
            left[p] -= 1
            if left[p] == 0:
                top = begin[p]
        panel = panels[tree.panel_start[s] : tree.panel_start[s + 1]].reshape(k + r, k)
        found = inverse[tree.panel_start[s] : tree.panel_start[s + 1]].reshape(k + r, k)
        if s < fronts - open_fronts:
            _inverse_panel(panel, rest, found, k)
        if children[s]:
            begin[s] = top
            m = k + r
            whole = stack[top : top + m * m].reshape(m, m)
            whole[:, :k] = found
            whole[:k, k:] = found[k:].T
            whole[k:, k:] = rest
            top += m * m


@compiled_vector
def _inverse_panel(panel: Floats, rest: Floats, found: Floats, k: int) -> None:
    """With Y = L21 / L11 and Z the inverse of the ``rest``: -Z Y below, 1 / (L11 L11') + Y' Z Y above."""
    r = len(rest)
    lower = np.zeros((k, k))  # 1 / L11
    for j in range(k):
        lower[j, j] = 1.0 / panel[j, j]
        for i in range(j + 1, k):
            total = 0.0
            for p in range(j, i):
                total -= panel[i, p] * lower[p, j]
            lower[i, j] = total / panel[i, i]
    across = np.zeros((k, r))  # Y'
    for i in range(r):
        for p in range(k):
            here = panel[k + i, p]
            for j in range(p + 1):
                across[j, i] += here * lower[p, j]
    if r * r * k > BLAS_FROM:
        found[k:] = -np.dot(rest, np.ascontiguousarray(across.T))
    else:
        for i in range(r):
            for j in range(k):
                total = 0.0
                for p in range(r):
                    total += rest[i, p] * across[j, p]
                found[k + i, j] = -total
    for i in range(k):
        for j in range(i + 1):
            total = 0.0
            for p in range(i, k):
                total += lower[p, i] * lower[p, j]
            for p in range(r):
                total -= across[i, p] * found[k + p, j]
            found[i, j] = total
            found[j, i] = total
