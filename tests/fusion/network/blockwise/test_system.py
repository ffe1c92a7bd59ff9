"""A network in blocks is the network: the same solution and the same covariances, whoever does the work."""

from __future__ import annotations

import pickle
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.network.adjust import Adjustment, adjust, adjust_from
from fusion.network.blockwise.partition import Partition, bisected, halved
from fusion.network.blockwise.store import MemoryStore
from fusion.network.blockwise.system import BlockedSystem
from fusion.network.control import ControlHeights
from fusion.network.equations import Asked, Blocks, EquationSystem
from fusion.network.terrain import Terrain
from fusion.network.unknowns import knot_positions
from network_draws import Drives, driven_town


def random_system(seed: int, size: int, home: np.ndarray) -> list[Blocks]:
    """Well-determined observations of one, two and three unknowns, mostly of one home."""
    rng = np.random.default_rng(seed)
    out = [Blocks.of_rows(np.arange(size)[:, None], np.ones((size, 1)), rng.normal(size=size), 4.0)]
    for k in (2, 3):
        near = np.argsort(home + rng.uniform(0, 1.2, size))
        variables = np.array([near[i : i + k] for i in range(size - k)])
        out.append(
            Blocks.of_rows(variables, rng.normal(size=variables.shape), rng.normal(size=len(variables)), 0.5)
        )
    out[-1].weight = rng.uniform(0.1, 2.0, len(out[-1].variables))
    return out


def some_tree(rng: np.random.Generator, count: int, shape: str) -> np.ndarray:
    """A tree over so many blocks: halves, a chain, one root above all, or joined at random."""
    if shape == "halves":
        return halved(count)
    parent, open_nodes = [-1] * count, list(range(count))
    while len(open_nodes) > 1:
        most = {"flat": len(open_nodes), "chain": 2}.get(shape, int(rng.integers(2, 4)))
        joined = open_nodes[:most] if shape != "random" else rng.permutation(open_nodes)[:most].tolist()
        for node in joined:
            parent[node] = len(parent)
        open_nodes = [len(parent), *(n for n in open_nodes if n not in joined)]
        parent.append(-1)
    return np.array(parent)


@pytest.mark.parametrize("shape", ["halves", "chain", "flat", "random"])
@given(seed=st.integers(0, 2**31), count=st.sampled_from([1, 2, 5, 20]), size=st.integers(8, 60))
def test_equations_in_blocks_against_all_at_once(shape: str, seed: int, count: int, size: int) -> None:
    """Whatever the tree; some unknowns have no home, some are everywhere, and most of twenty blocks are empty."""
    rng = np.random.default_rng(seed)
    home = rng.integers(0, count, size)
    home[rng.random(size) < 0.2] = -1
    blocks = random_system(seed, size, home)
    late = np.sort(rng.permutation(size)[: size // 6])
    everywhere = np.column_stack([np.full(size - 1, size - 1), np.arange(size - 1)])
    blocks.append(Blocks.of_rows(everywhere, rng.normal(size=2), 0.0, 9.0))
    for one, asked in zip(blocks, (Asked.EXPECTED, Asked.MISFIT, Asked.EXPECTED, Asked.NOTHING), strict=True):
        one.asked = asked
    system = BlockedSystem(size, blocks, home, Partition(home, parent=some_tree(rng, count, shape)), late)
    for _ in range(2):  # the second time with other weights and vectors
        whole = EquationSystem(size, blocks, late).solve()
        found = system.solve()
        assert found.x == pytest.approx(whole.x, rel=1e-9, abs=1e-9)
        for one in blocks:
            expected = whole.equations.covariance(one.variables)
            assert found.equations.covariance(one.variables) == pytest.approx(expected, rel=1e-9, abs=1e-12)
            forms = [(one.variables, rng.normal(size=(len(one.weight), 2, one.variables.shape[1])))]
            assert found.variances(forms)[0] == pytest.approx(whole.variances(forms)[0], rel=1e-9, abs=1e-12)
        for k in (0, 2):
            assert found.expected_squares(blocks[k]) == pytest.approx(
                whole.expected_squares(blocks[k]), rel=1e-8
            )
        assert found.squares(blocks[1]) == pytest.approx(whole.squares(blocks[1]), rel=1e-8, abs=1e-12)
        assert found.products(blocks[1]) == pytest.approx(whole.products(blocks[1]), rel=1e-8, abs=1e-12)
        blocks[1].weight = rng.uniform(0.5, 2.0, len(blocks[1].variables))
        blocks[0].vector = rng.normal(size=blocks[0].vector.shape)


@pytest.mark.parametrize("count", [1, 3])
def test_an_unknown_that_is_not_determined_is_said(count: int) -> None:
    home = np.arange(6) % count
    blocks = random_system(1, 6, home)
    partition, late = Partition(home), np.empty(0, np.int64)
    with pytest.raises(ValueError, match="no equation"):
        BlockedSystem(7, blocks, np.append(home, 0), partition, late)
    for one in blocks:
        one.weight = np.zeros(len(one.weight))
    with pytest.raises(ValueError, match="not determined"):
        BlockedSystem(6, blocks, home, partition, late).solve()


def apart(left: Adjustment, right: Adjustment) -> float:
    """The largest difference of slopes, in sigmas."""
    return float(np.abs((left.slope_percent - right.slope_percent) / right.slope_sigma_percent).max())


@pytest.mark.parametrize("count", [1, 2, 5, 20])
def test_a_town_in_blocks_is_the_town(count: int) -> None:
    table, drives = driven_town()
    lon, lat = knot_positions(table)
    terrain = Terrain(200.0 + 3e3 * (lon - 8.5) + 2e3 * (lat - 49.0))
    whole = adjust(table, drives, terrain)
    partition = bisected(table, -(-len(table) // count))
    assert len(np.unique(partition.block)) >= count
    found = adjust(table, drives, terrain, blocks=partition)
    assert apart(found, whole) < 1e-9
    assert found.slope_sigma_percent == pytest.approx(whole.slope_sigma_percent, rel=1e-9)
    assert found.accepted == whole.accepted


@dataclass(frozen=True)
class Stored:
    """Passes of a town as files of blocks would have them."""

    drives: Drives
    block: np.ndarray

    def passes(self, block: int) -> Drives:
        """Those of a block."""
        mine = {d: [p for p in passes if self.block[p.segment] == block] for d, passes in self.drives.items()}
        return {d: passes for d, passes in mine.items() if passes}


@pytest.mark.parametrize("shape", ["halves", "chain", "flat", "random"])
def test_passes_that_are_read_where_the_work_is_done(shape: str) -> None:
    """Never all together, and given in any order; the drives cross most of the blocks."""
    table, drives = driven_town()
    rng = np.random.default_rng(3)
    block = bisected(table, 12).block
    partition = Partition(block, parent=some_tree(rng, int(block.max()) + 1, shape))
    assert max(len(set(block[[p.segment for p in d]])) for d in drives.values()) > 4
    turned = {d: passes[::-1] for d, passes in sorted(drives.items(), reverse=True)}
    lon, lat = knot_positions(table)
    terrain = Terrain(200.0 + 3e3 * (lon - 8.5) + 2e3 * (lat - 49.0))
    control = ControlHeights(
        np.array([3, 40]),
        np.array([5.0, 10.0]),
        np.array([200.0, 205.0]),
        np.array([0.1, 0.1]),
        np.array(["a", "b"]),
    )
    whole = adjust(table, drives, terrain, control)
    found = adjust_from(Stored(turned, block), table, partition, terrain, control)
    assert apart(found, whole) < 1e-8
    assert found.slope_sigma_percent == pytest.approx(whole.slope_sigma_percent, rel=1e-8)
    assert found.height_sigma_m == pytest.approx(whole.height_sigma_m, rel=1e-8, nan_ok=True)
    assert (found.accepted, found.lag_s) == (whole.accepted, pytest.approx(whole.lag_s, rel=1e-6))


def test_blocks_without_segments_are_passed_over() -> None:
    table, drives = driven_town()
    block = 3 * bisected(table, 30).block + 1
    assert apart(adjust(table, drives, blocks=Partition(block)), adjust(table, drives)) < 1e-9


@pytest.mark.slow
def test_many_hands_do_the_same_work(tmp_path: Path) -> None:
    """The same bytes whoever does it, and in whatever order it is done."""
    table, drives = driven_town()
    partition = bisected(table, 12)
    source = Stored(drives, partition.block)
    alone = adjust_from(source, table, partition)
    with ThreadPoolExecutor(3) as threads:
        found = adjust_from(source, table, replace(partition, executor=threads))
    assert found.slope_percent.tobytes() == alone.slope_percent.tobytes()
    several = []
    for count in (1, 2):
        folder = tmp_path / str(count)
        folder.mkdir()
        with ProcessPoolExecutor(count, mp_context=get_context("spawn")) as processes:
            hands = replace(partition, executor=processes, folder=folder)
            several.append(adjust_from(source, table, hands))
    for name in ("slope_percent", "slope_sigma_percent", "height_from_m"):
        one, two = (getattr(a, name).tobytes() for a in several)
        assert one == two
    assert apart(several[0], alone) < 1e-9


def test_hands_in_other_processes_need_a_folder() -> None:
    with pytest.raises(TypeError, match="name a folder"):
        pickle.dumps(MemoryStore())


def test_blocks_without_drives_and_drives_in_one_block_only() -> None:
    table, drives = driven_town()
    some = {0: drives[0][:3], 4: drives[4][-2:]}
    whole = adjust(table, some)
    assert apart(adjust(table, some, blocks=bisected(table, 6)), whole) < 1e-9
