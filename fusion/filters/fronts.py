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
def solve_forward(tree: Tree, open_fronts: int, panels: Floats, x: Floats) -> None:
    """The right-hand side over L, in place; what is left for the open fronts stands at their places."""
    for s in range(len(tree.first) - 1 - open_fronts):
        begin, end = tree.first[s], tree.first[s + 1]
        rows = tree.rows[tree.row_start[s] : tree.row_start[s + 1]]
        k = end - begin
        panel = panels[tree.panel_start[s] : tree.panel_start[s + 1]].reshape(k + len(rows), k)
        for j in range(k):
            for p in range(j):
                x[begin + j] -= panel[j, p] * x[begin + p]
            x[begin + j] /= panel[j, j]
        for i in range(len(rows)):
            total = 0.0
            for j in range(k):
                total += panel[k + i, j] * x[begin + j]
            x[rows[i]] -= total


@compiled
def solve_backward(tree: Tree, open_fronts: int, panels: Floats, x: Floats) -> None:
    """From what ``solve_forward`` left to the solution, in place; that of the open fronts is there already."""
    for s in range(len(tree.first) - 2 - open_fronts, -1, -1):
        begin, end = tree.first[s], tree.first[s + 1]
        rows = tree.rows[tree.row_start[s] : tree.row_start[s + 1]]
        k = end - begin
        panel = panels[tree.panel_start[s] : tree.panel_start[s + 1]].reshape(k + len(rows), k)
        for i in range(len(rows)):
            for j in range(k):
                x[begin + j] -= panel[k + i, j] * x[rows[i]]
        for j in range(k - 1, -1, -1):
            x[begin + j] /= panel[j, j]
            for p in range(j):
                x[begin + p] -= panel[j, p] * x[begin + j]


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
        block = inverse[tree.panel_start[s] : tree.panel_start[s + 1]].reshape(k + r, k)
        if s < fronts - open_fronts:
            _inverse_panel(panel, rest, block, k)
        if children[s]:
            begin[s] = top
            m = k + r
            front = stack[top : top + m * m].reshape(m, m)
            front[:, :k] = block
            front[:k, k:] = block[k:].T
            front[k:, k:] = rest
            top += m * m


@compiled_vector
def _inverse_panel(panel: Floats, rest: Floats, inverse: Floats, k: int) -> None:
    """With Y = L21 / L11 and Z the inverse of the ``rest``: -Z Y below, 1 / (L11 L11') + Y' Z Y above."""
    r = len(rest)
    lower = _inverse_of_lower(panel, k)
    across = np.zeros((k, r))  # Y'
    for i in range(r):
        for p in range(k):
            here = panel[k + i, p]
            for j in range(p + 1):
                across[j, i] += here * lower[p, j]
    spread = _times(across, rest)  # (Z Y)'
    inverse[k:] = -spread.T
    for i in range(k):
        for j in range(i + 1):
            total = 0.0
            for p in range(i, k):
                total += lower[p, i] * lower[p, j]
            for p in range(r):
                total += across[i, p] * spread[j, p]
            inverse[i, j] = total
            inverse[j, i] = total


@compiled_vector
def _inverse_of_lower(panel: Floats, k: int) -> Floats:
    """1 / L11, (k, k)."""
    lower = np.zeros((k, k))
    for j in range(k):
        lower[j, j] = 1.0 / panel[j, j]
        for i in range(j + 1, k):
            total = 0.0
            for p in range(j, i):
                total -= panel[i, p] * lower[p, j]
            lower[i, j] = total / panel[i, i]
    return lower


@compiled_vector
def _times(left: Floats, right: Floats) -> Floats:
    """The product of matrices."""
    k, r = left.shape
    out = np.zeros((k, r))
    if r * r * k > BLAS_FROM:
        out[:] = np.dot(left, right)
        return out
    for j in range(k):
        for p in range(r):
            here = left[j, p]
            for i in range(r):
                out[j, i] += here * right[p, i]
    return out
