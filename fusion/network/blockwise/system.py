"""The equations of a network as one system that is solved block by block, by whatever hands there are."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.network.blockwise import tasks
from fusion.network.blockwise.owners import Owners, grouped
from fusion.network.blockwise.partition import Partition, PassSource
from fusion.network.blockwise.store import FolderStore, MemoryStore, Store
from fusion.network.blockwise.tasks import Node
from fusion.network.blockwise.work import Job, done
from fusion.network.equations import Asked, Blocks, Forms, Solution
from fusion.network.pass_columns import PassColumns
from fusion.types import Floats, Ints

_NOTHING = np.empty(0, np.int64)


def store_of(partition: Partition) -> Store:
    """Where the work on these blocks leaves what later work needs."""
    return FolderStore(partition.folder) if partition.folder else MemoryStore()


def summaries(source: PassSource, partition: Partition, store: Store) -> list[PassColumns]:
    """What is known of the passes of each block but what they say, in the order of the blocks; that is in the store."""
    blocks = np.unique(partition.block).tolist()
    found = dict(
        done(partition.executor, blocks, {}, lambda k: (tasks.summary, store, source, k), partition.hands)
    )
    return [found[k] for k in blocks]


class BlockedSystem:
    """As ``EquationSystem``, solved block by block; ``home`` (size,) is the block of each unknown, -1 for none.

    ``late`` as there. What equations say is kept with who works on them: afterwards only new weights and vectors
    are looked at. What equations that have numbers say ``summaries`` has left in the ``store``; ``place`` is which of
    its block each is.
    """

    def __init__(
        self,
        size: int,
        blocks: list[Blocks],
        home: Ints,
        partition: Partition,
        late: Ints,
        store: Store | None = None,
        place: Ints = _NOTHING,
    ) -> None:
        self.size, self.executor, self.hands = size, partition.executor, partition.hands
        self.store = store or store_of(partition)
        self.kinds = [b for b in blocks if len(b.variables)]
        self.tree = partition.tree()
        self._bundles = self.tree.bundles(self.hands).tolist()
        self.owners = Owners(size, [b.variables for b in self.kinds], home, self.tree)
        self._rows: dict[int, list[tuple[int, Ints]]] = {}
        """Of each block that has equations the kinds that it has, and which of them"""
        for kind, owner in enumerate(self.owners.of_equations):
            for block, rows in grouped(owner):
                self._rows.setdefault(block, []).append((kind, rows))
        self._inside = dict(grouped(self.owners.node))
        self._borders, self._nodes = self._tree_of_borders()
        self._order = [n for n in self.tree.order if n in self._rows or n in self._nodes]
        self._given = [b.vector for b in self.kinds]
        self._prepare(late, place)

    def _tree_of_borders(self) -> tuple[dict[int, Ints], dict[int, Node]]:
        """The borders of blocks and of nodes, and the nodes that have unknowns."""
        borders = dict.fromkeys(self._rows, _NOTHING) | self.owners.borders(self.kinds)
        nodes: dict[int, Node] = {}
        for number in self.tree.order:
            children = [c for c in self.tree.children[number] if c in borders]
            if not children:
                continue
            every = np.unique(np.concatenate([borders[c] for c in children]))
            own = self.owners.node[every] == number
            unknowns, borders[number] = np.concatenate([every[own], every[~own]]), every[~own]
            where = [(c, tasks.positions(unknowns, borders[c])[0]) for c in children if len(borders[c])]
            nodes[number] = Node(number, int(own.sum()), len(every), where)
        return borders, nodes

    def _prepare(self, late: Ints, place: Ints) -> None:
        late_of = dict(grouped(self.owners.node[late]))

        def job(number: int) -> Job:
            kinds = []
            for kind, rows in self._rows[number]:
                b = self.kinds[kind]
                if b.numbers is None:
                    one = Blocks(
                        b.variables[rows], b.information[rows], b.vector[rows], b.weight[rows], b.asked
                    )
                else:
                    one = Blocks.elsewhere(b.variables[rows], place[b.numbers[rows]])
                    one.asked = b.asked
                kinds.append(one)
            mine = late[late_of.get(number, _NOTHING)]
            return tasks.prepare, self.store, number, self._borders[number], mine, kinds

        for _ in self.each(self._rows, job):
            pass

    def release(self) -> None:
        """Let go of what equations say, which is kept elsewhere by now."""
        for k, b in enumerate(self.kinds):
            b.information, b.vector = b.information[:0].copy(), b.vector[:0].copy()
            self._given[k] = b.vector

    def solve(self, covariances: bool = True) -> Solution:
        """The solution at the present weights; of ``covariances`` only what is asked of equations where they are not
        wanted. Raises ``ValueError`` where some unknown is not determined."""
        children = {n: [c for c, _ in node.children] for n, node in self._nodes.items()}
        for _ in self._done(self._order, children, self._elimination):
            pass
        x = np.zeros(self.size)
        answers = {
            id(b): np.empty((2, len(b.weight)) if b.asked is Asked.MISFIT else len(b.weight))
            for b in self.kinds
            if b.asked is not Asked.NOTHING
        }

        def finish(number: int) -> Job:
            if number in self._nodes:
                return tasks.finish_node, self.store, self._nodes[number]
            return tasks.finish_block, self.store, number, covariances

        parents = {n: [above] for n in self._order if (above := int(self.tree.parent[n])) in self._nodes}
        for number, found in self._done(self._order[::-1], parents, finish):
            inside = self._inside.get(number, _NOTHING)
            x[inside] = found if number in self._nodes else found[0]
            if number in self._rows:
                for (kind, rows), answer in zip(self._rows[number], found[1], strict=True):
                    if answer is not None:
                        answers[id(self.kinds[kind])][..., rows] = answer
        return BlockedSolution(x, BlockedCovariances(self), answers)

    def _elimination(self, number: int) -> Job:
        if number in self._nodes:
            return tasks.eliminate_node, self.store, self._nodes[number]
        learned = []
        for kind, rows in self._rows[number]:
            b = self.kinds[kind]
            learned.append((b.weight[rows], None if b.vector is self._given[kind] else b.vector[rows]))
        return tasks.eliminate_block, self.store, number, learned

    def each(self, blocks: Iterable[int], job: Callable[[int], Job]) -> Iterator[tuple[int, Any]]:
        """What the job of each block returns, as they come."""
        return self._done(sorted(blocks, key=self.tree.rank.__getitem__), {}, job)

    def _done(
        self, order: Sequence[int], before: Mapping[int, Sequence[int]], job: Callable[[int], Job]
    ) -> Iterator[tuple[int, Any]]:
        return done(self.executor, order, before, job, self.hands, self._bundles)

    def by_block(self, rows: Ints) -> Iterator[tuple[int, Ints]]:
        """Blocks, and which of the rows of unknowns (m, k) each of them knows."""
        return grouped(self.owners.of(rows))


@dataclass(frozen=True, eq=False)
class BlockedCovariances:
    """Covariances of unknowns that share an equation, from the block that has it."""

    system: BlockedSystem

    def covariance(self, rows: Ints) -> Floats:
        """Covariances (m, k, k) among unknowns (m, k); NaN for pairs that no block knows together."""
        rows = np.asarray(rows, np.int64)
        out = np.full((*rows.shape, rows.shape[1]), np.nan)
        mine = dict(self.system.by_block(rows))
        for number, found in self.system.each(
            mine, lambda k: (tasks.covariances, self.system.store, k, rows[mine[k]])
        ):
            out[mine[number]] = found
        return out


@dataclass(frozen=True, eq=False)
class BlockedSolution(Solution):
    """A solution that has answered what is asked of it block by block; ``answers`` by ``id`` of the equations."""

    equations: BlockedCovariances
    answers: dict[int, Floats]

    def squares(self, blocks: Blocks) -> Floats:
        """x' information x of each block, (m,)."""
        return np.asarray(self.answers[id(blocks)][0])

    def products(self, blocks: Blocks) -> Floats:
        """x' vector of each block, (m,)."""
        return np.asarray(self.answers[id(blocks)][1])

    def expected_squares(self, blocks: Blocks) -> Floats:
        """The squares expected under the covariance, (m,)."""
        return np.asarray(self.answers[id(blocks)])

    def variances(self, forms: Sequence[Forms]) -> list[Floats]:
        """Of linear forms, as ``Solution`` has them."""
        system = self.equations.system
        mine: dict[int, list[tuple[int, Ints]]] = {}
        for k, (variables, _) in enumerate(forms):
            for number, rows in system.by_block(variables):
                mine.setdefault(number, []).append((k, rows))

        def job(number: int) -> Job:
            asked = [(forms[k][0][rows], forms[k][1][rows]) for k, rows in mine[number]]
            return tasks.variances, system.store, number, asked

        out = [np.empty(weights.shape[:2]) for _, weights in forms]
        for number, found in system.each(mine, job):
            for (k, rows), values in zip(mine[number], found, strict=True):
                out[k][rows] = values
        return out
