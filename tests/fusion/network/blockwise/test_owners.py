"""Which block has an equation, and where an unknown is eliminated."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fusion.network.blockwise.owners import Owners, grouped
from fusion.network.blockwise.partition import BlockTree, halved
from fusion.network.equations import Blocks


@given(seed=st.integers(0, 2**31), count=st.integers(1, 12), size=st.integers(3, 40))
def test_unknowns_are_eliminated_as_low_as_they_may(seed: int, count: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    home = rng.integers(-1, count, size)
    kinds = [np.arange(size)[:, None], rng.integers(0, size, (size, 3))]
    tree = BlockTree(halved(count))
    owners = Owners(size, kinds, home, tree)
    blocks_of = [set[int]() for _ in range(size)]
    for variables, owner in zip(kinds, owners.of_equations, strict=True):
        for row, block in zip(variables, owner.tolist(), strict=True):
            assert block < count
            known = home[row][home[row] >= 0]
            assert not len(known) or block == known[0]
            for unknown in row.tolist():
                blocks_of[unknown].add(block)
        assert np.array_equal(owners.of(variables), owner)
    borders = owners.borders([Blocks.elsewhere(v, np.arange(len(v))) for v in kinds])
    for unknown, blocks in enumerate(blocks_of):
        node = int(owners.node[unknown])
        up = [lineage(tree, block) for block in sorted(blocks)]
        common = [n for n in up[0] if all(n in one for one in up)]
        assert node == common[0]
        on_border = {block for block, mine in borders.items() if unknown in mine}
        assert on_border == (blocks if len(blocks) > 1 else set())


def lineage(tree: BlockTree, node: int) -> list[int]:
    """The node and all above it, from below."""
    out = [node]
    while tree.parent[out[-1]] >= 0:
        out.append(int(tree.parent[out[-1]]))
    return out


@given(values=st.lists(st.integers(0, 9), max_size=30))
def test_grouped_finds_each_value_once(values: list[int]) -> None:
    found = dict(grouped(np.array(values, np.int64)))
    assert list(found) == sorted(set(values))
    assert all(
        rows.tolist() == [k for k, v in enumerate(values) if v == value] for value, rows in found.items()
    )
