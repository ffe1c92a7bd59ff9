"""The work on one block or one node of the tree: functions of what can be sent to another process.

What a block's equations say, its factor and what borders tell each other is left in a store (``store``), so that
between the rounds only what was learned is sent. A task that is done twice does no harm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.filters.dense_front import DenseFront
from fusion.filters.sparse_inverse import Elimination, NormalEquations, covariance_at
from fusion.network.blockwise.partition import PassSource
from fusion.network.blockwise.store import Store
from fusion.network.drive_beliefs import said_by
from fusion.network.equations import (
    RIDGE,
    Asked,
    Blocks,
    Forms,
    factorised,
    form_variances,
    order_with_late,
    pattern_of,
    right_hand_side,
)
from fusion.network.pass_columns import PassColumns, in_order
from fusion.types import Bools, Floats, Ints

Learned = list[tuple[Floats, Floats | None]]
"""For each kind of a block's equations their weights, and their vectors where these are others than before."""


@dataclass(frozen=True, eq=False)
class Block:
    """A block's equations, by kinds, over its own ``unknowns``: those inside first, then ``border`` ones, each of both
    ascending; and how they are eliminated."""

    unknowns: Ints
    border: int
    how: Elimination
    kinds: list[Blocks]
    slots: list[Ints]

    @property
    def interior(self) -> int:
        """How many unknowns are inside."""
        return len(self.unknowns) - self.border

    def local(self, variables: Ints) -> tuple[Ints, Bools]:
        """Where unknowns stand among the block's, and whether they are there."""
        return positions(self.unknowns, variables)


@dataclass(frozen=True, eq=False)
class Node:
    """An inner node of the tree: it eliminates ``own`` of ``size`` unknowns onto its border.

    ``children`` are numbers of nodes, and where their borders stand among its unknowns.
    """

    number: int
    own: int
    size: int
    children: list[tuple[int, Ints]]


def positions(unknowns: Ints, variables: Ints) -> tuple[Ints, Bools]:
    """Where variables stand among unknowns (n,), and whether they are there."""
    order = np.argsort(unknowns)
    at = order[np.minimum(np.searchsorted(unknowns, variables, sorter=order), len(order) - 1)]
    return at, unknowns[at] == variables


def summary(store: Store, source: PassSource, block: int) -> PassColumns:
    """All that is known of a block's passes but what they say, which is kept for ``prepare``."""
    drive, factors = in_order(source.passes(block))
    columns = PassColumns.in_order(drive, factors)
    said = [(alike, said_by([factors[k] for k in alike.tolist()])) for alike in columns.alike()]
    store.put(("said", block), said)
    return columns


def prepare(store: Store, number: int, border: Ints, late: Ints, kinds: list[Blocks]) -> None:
    """Keep a block's equations, and find out how they are eliminated onto ``border``; ``late`` of those inside wait for
    all that they occur with. What numbered ones say is taken from ``summary``."""
    if any(one.numbers is not None for one in kinds):
        said: list[tuple[Ints, tuple[Floats, Floats]]] = store.get(("said", number))
        for one in kinds:
            if one.numbers is not None:
                one.information, one.vector = _said(said, one.numbers)
    used = np.unique(np.concatenate([one.variables.ravel() for one in kinds]))
    unknowns = np.concatenate([np.setdiff1d(used, border, assume_unique=True), border])
    for one in kinds:
        one.variables = positions(unknowns, one.variables)[0]
    pattern = pattern_of(len(unknowns), [one.variables for one in kinds])
    interior = len(unknowns) - len(border)
    order = order_with_late(pattern[:interior][:, :interior], positions(unknowns, late)[0])
    how = Elimination(pattern, np.concatenate([order, np.arange(interior, len(unknowns))]), len(border))
    store.put(
        ("block", number),
        Block(unknowns, len(border), how, kinds, [how.slots(one.variables) for one in kinds]),
    )


def _said(said: list[tuple[Ints, tuple[Floats, Floats]]], numbers: Ints) -> tuple[Floats, Floats]:
    """Information and vectors of passes that are all of one shape."""
    for alike, (information, vector) in said:
        at = np.minimum(np.searchsorted(alike, numbers), len(alike) - 1)
        if alike[at[0]] == numbers[0]:
            return information[at], vector[at]
    raise ValueError(f"nothing is known of pass {numbers[0]}")


def eliminate_block(store: Store, number: int, learned: Learned) -> None:
    """Eliminate a block's interior, with what was learned of its equations; its factor and what it tells are kept."""
    block: Block = store.get(("block", number))
    for one, (weight, vector) in zip(block.kinds, learned, strict=True):
        one.weight = weight
        one.vector = one.vector if vector is None else vector
    normal = factorised(block.how, block.kinds, block.slots)
    reduced = normal.reduced(right_hand_side(len(block.unknowns), block.kinds))
    store.put(("factor", number), (normal.panels, reduced))
    store.put(("told", number), (normal.border_matrix(), reduced[block.interior :]))


def eliminate_node(store: Store, node: Node) -> None:
    """Add what the children tell of their borders, and eliminate what is a border no more above."""
    matrix, vector = np.zeros((node.size, node.size)), np.zeros(node.size)
    for child, at in node.children:
        theirs, right = store.get(("told", child))
        matrix[np.ix_(at, at)] += theirs
        vector[at] += right
    try:
        front, left, right = DenseFront.eliminate(matrix, vector, node.own)
    except ValueError:
        matrix[np.diag_indices(node.own)] *= 1 + RIDGE
        front, left, right = DenseFront.eliminate(matrix, vector, node.own)
    store.put(("factor", node.number), front)
    store.put(("told", node.number), (left, right))


def finish_node(store: Store, node: Node) -> Floats:
    """Solution and covariances of the node's unknowns from its border's, handed on; the solution of its own."""
    front: DenseFront = store.get(("factor", node.number))
    x, covariance = front.solve(*_from_above(store, node.number, node.size - node.own))
    for child, at in node.children:
        store.put(("above", child), (x[at], covariance[np.ix_(at, at)]))
    return x[: node.own]


def finish_block(store: Store, number: int, keep: bool) -> tuple[Floats, list[Floats | None]]:
    """The solution of what is inside, and what is asked about each kind of equations; ``keep`` the covariances."""
    block: Block = store.get(("block", number))
    panels, reduced = store.get(("factor", number))
    normal = NormalEquations.of_factor(block.how, panels)
    border, covariance = _from_above(store, number, block.border)
    inverse = normal.set_border_covariance(covariance)
    x = normal.solve_inside(reduced, border)
    if keep:
        store.put(("inverse", number), inverse)
    answers = [_answer(one, x, inverse, slots) for one, slots in zip(block.kinds, block.slots, strict=True)]
    return x[: block.interior], answers


def covariances(store: Store, number: int, rows: Ints) -> Floats:
    """Covariances (m, k, k) among unknowns (m, k) of a block, NaN where it does not know a pair together."""
    block: Block = store.get(("block", number))
    return _covariances(block, store.get(("inverse", number)), rows)


def variances(store: Store, number: int, forms: list[Forms]) -> list[Floats]:
    """Variances of linear forms over unknowns of a block (``Solution.variances``)."""
    block: Block = store.get(("block", number))
    inverse = store.get(("inverse", number))
    return [form_variances(_covariances(block, inverse, rows), weights) for rows, weights in forms]


def _covariances(block: Block, inverse: Floats, rows: Ints) -> Floats:
    at, there = block.local(rows)
    known = NormalEquations.of_factor(block.how, inverse, inverse).covariance(at)
    return np.where(there[:, :, None] & there[:, None, :], known, np.nan)


def _answer(one: Blocks, x: Floats, inverse: Floats, slots: Ints) -> Floats | None:
    if one.asked is Asked.EXPECTED:
        return one.expected_squares(x, covariance_at(slots, one.variables.shape[1], inverse))
    if one.asked is Asked.MISFIT:
        return np.array([one.squares(x), one.products(x)])
    return None


def _from_above(store: Store, number: int, border: int) -> Any:
    """Solution and covariance of a node's border."""
    return store.get(("above", number)) if border else (np.zeros(0), np.zeros((0, 0)))
