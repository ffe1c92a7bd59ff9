"""Blocks and the tree over them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.network.blockwise.partition import MOST_BUNDLED, BlockTree, Partition, bisected, halved
from fusion.network.blockwise.work import EACH_WAITING
from network_draws import town


def below(tree: BlockTree, node: int) -> set[int]:
    """A node and all that are below it."""
    return {node}.union(*(below(tree, child) for child in tree.children[node]))


@given(width=st.integers(1, 9), height=st.integers(2, 9), most=st.integers(1, 40))
def test_no_block_is_larger_than_was_asked_for(width: int, height: int, most: int) -> None:
    partition = bisected(town(width, height), most)
    sizes = np.bincount(partition.block)
    assert sizes.min() >= 1
    assert sizes.max() <= most


@given(most=st.integers(1, 60))
def test_the_tree_of_a_bisection_joins_halves(most: int) -> None:
    """Below each of its nodes lies one part of the network, in two halves."""
    partition = bisected(town(8, 7), most)
    tree, sizes = partition.tree(), np.bincount(partition.block)
    assert [len(c) for c in tree.children] == [0] * len(sizes) + [2] * (len(sizes) - 1)
    for node in range(len(sizes), len(tree.parent)):
        halves = [sum(sizes[k] for k in below(tree, c) if k < len(sizes)) for c in tree.children[node]]
        assert abs(halves[0] - halves[1]) <= 1


@given(count=st.integers(1, 40))
def test_halves_of_numbers_are_a_tree(count: int) -> None:
    tree = BlockTree(halved(count))
    assert below(tree, tree.root) == set(range(2 * count - 1))
    assert all(len(c) == 2 * (n >= count) for n, c in enumerate(tree.children))
    assert tree.depth.max() == int(np.ceil(np.log2(count)))


@given(seed=st.integers(0, 2**31), count=st.integers(2, 30))
def test_the_lowest_node_above_two(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    parent = np.array([-1, *(int(rng.integers(0, k)) for k in range(1, count))])
    tree = BlockTree(parent)
    left, right = rng.integers(0, count, (2, 50))
    for a, b, found in zip(left, right, tree.lowest_above(left, right), strict=True):
        above = [n for n in range(count) if {int(a), int(b)} <= below(tree, n)]
        assert found == max(above, key=lambda n: tree.depth[n])


@given(seed=st.integers(0, 2**31), count=st.integers(1, 30))
def test_children_come_before_parents_and_each_subtree_in_one_run(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    tree = BlockTree(np.array([-1, *(int(rng.integers(0, k)) for k in range(1, count))]))
    for node in range(count):
        ranks = sorted(tree.rank[list(below(tree, node))].tolist())
        assert ranks == list(range(ranks[0], ranks[-1] + 1))
        assert tree.rank[node] == ranks[-1]


@given(count=st.integers(1, 200), hands=st.integers(1, 20))
def test_bundles_are_small_subtrees_of_which_all_hands_have_enough(count: int, hands: int) -> None:
    tree = BlockTree(halved(count))
    bundles = tree.bundles(hands)
    for root in np.unique(bundles).tolist():
        own = set(np.flatnonzero(bundles == root).tolist())
        assert own in ({root}, below(tree, root)), "an upper node by itself, or a whole subtree"
        assert len([n for n in own if n < count]) <= MOST_BUNDLED
    of_blocks = len(np.unique(bundles[:count]))
    assert of_blocks >= min(count, EACH_WAITING * hands)


def test_a_tree_has_one_root() -> None:
    with pytest.raises(ValueError, match="unpack"):
        BlockTree(np.array([-1, -1]))


def test_a_partition_names_its_hands() -> None:
    assert Partition(np.zeros(3, np.int64)).executor is None
