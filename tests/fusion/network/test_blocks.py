"""A network in blocks is the network: the same solution and the same covariances, whoever does the work."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.network.adjust import Adjustment, adjust
from fusion.network.blocks import BlockedSystem, Partition, bisected
from fusion.network.equations import Blocks, EquationSystem
from fusion.network.terrain import Terrain
from fusion.network.unknowns import knot_positions
from network_draws import driven_town, town


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


@given(seed=st.integers(0, 2**31), count=st.sampled_from([1, 2, 5, 20]), size=st.integers(8, 60))
def test_equations_in_blocks_against_all_at_once(seed: int, count: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    home = rng.integers(0, count, size)
    home[rng.random(size) < 0.2] = -1
    blocks = random_system(seed, size, home)
    whole = EquationSystem(size, blocks, np.empty(0, np.int64)).solve()
    system = BlockedSystem(size, blocks, home, None)
    for _ in range(2):  # the second time with other weights
        found = system.solve()
        assert found.x == pytest.approx(whole.x, rel=1e-9, abs=1e-9)
        for one in blocks:
            expected = whole.equations.covariance(one.variables)
            assert found.equations.covariance(one.variables) == pytest.approx(expected, rel=1e-9, abs=1e-12)
        blocks[1].weight = rng.uniform(0.5, 2.0, len(blocks[1].variables))
        whole = EquationSystem(size, blocks, np.empty(0, np.int64)).solve()


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


@pytest.mark.slow
def test_many_hands_do_the_same_work() -> None:
    table, drives = driven_town()
    alone = adjust(table, drives, blocks=bisected(table, 20))
    with ThreadPoolExecutor(2) as threads:
        found = adjust(table, drives, blocks=bisected(table, 20, threads))
    assert np.array_equal(found.slope_percent, alone.slope_percent)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        found = adjust(table, drives, blocks=bisected(table, 20, processes))
    assert apart(found, alone) < 1e-9


def test_blocks_without_drives_and_drives_in_one_block_only() -> None:
    table, drives = driven_town()
    some = {0: drives[0][:3], 4: drives[4][-2:]}
    whole = adjust(table, some)
    assert apart(adjust(table, some, blocks=bisected(table, 6)), whole) < 1e-9


@given(width=st.integers(1, 9), height=st.integers(2, 9), most=st.integers(1, 40))
def test_no_block_is_larger_than_was_asked_for(width: int, height: int, most: int) -> None:
    partition = bisected(town(width, height), most)
    sizes = np.bincount(partition.block)
    assert sizes.min() >= 1
    assert sizes.max() <= most


def test_a_partition_names_its_hands() -> None:
    assert Partition(np.zeros(3, np.int64)).executor is None
