"""What passes elsewhere say of a drive's constants: against dense integration, as sums, and in windows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.filters import symmetric_entries
from fusion.network import drive_constants
from fusion.network.adjust import adjust
from fusion.network.drive_beliefs import DriveBeliefs
from fusion.network.drive_constants import FREE_INFORMATION, ConstantsInformation
from fusion.network.pass_columns import PassColumns
from fusion.network.pass_factor import CONSTANT_SIGMA, CONSTANTS, EAST, LAG, MOUNT, NUISANCES, PassFactor
from fusion.network.road_beliefs import GRADE_SIGMA
from fusion.network.segment_slopes import Adjustment
from fusion.network.unknowns import RoadUnknowns
from fusion.roads.table import RoadTable
from network_draws import Drives, driven_town, within


def some_passes(seed: int, count: int, mounts: int = 1) -> list[PassFactor]:
    """Passes of one drive with a barometer, some of them with another setting of the mount."""
    rng = np.random.default_rng(seed)
    drive = driven_town()[1][2]
    chosen = [drive[k] for k in sorted(rng.choice(len(drive), count, replace=False).tolist())]
    return [replace(p, mount=int(rng.integers(mounts))) for p in chosen]


def integrated(one: PassFactor) -> tuple[np.ndarray, np.ndarray]:
    """A pass's information and vector over the constants: the other unknowns eliminated one by one, in more digits."""
    n = len(one.vector)
    knots = n - NUISANCES
    prior = np.full(n, FREE_INFORMATION)
    prior[1:knots:2] = GRADE_SIGMA**-2
    constants = np.arange(knots, knots + len(CONSTANTS))
    prior[constants] = 0.0
    left = np.column_stack([one.information + np.diag(prior), one.vector]).astype(np.longdouble)
    for k in np.setdiff1d(np.arange(n), constants):
        others = np.arange(n) != k
        left[others] -= np.outer(left[others, k] / left[k, k], left[k])
    return left[np.ix_(constants, constants)].astype(float), left[constants, n].astype(float)


def dense(said: ConstantsInformation) -> np.ndarray:
    every = np.arange(len(said.keys))
    return said.information.dense(every, every)


def assert_same(left: ConstantsInformation, right: ConstantsInformation, rel: float = 1e-9) -> None:
    assert left.keys.tolist() == right.keys.tolist()
    scale = np.sqrt(np.diagonal(dense(right))) + 1e-9
    assert dense(left) / scale / scale[:, None] == pytest.approx(
        dense(right) / scale / scale[:, None], abs=rel
    )
    assert left.vector / scale == pytest.approx(
        right.vector / scale, abs=rel * (1 + np.abs(right.vector / scale).max(initial=0))
    )


@given(seed=st.integers(0, 2**31))
def test_a_pass_as_by_dense_integration(seed: int) -> None:
    one = some_passes(seed, 1)[0]
    said = ConstantsInformation.of_passes([one])
    information, vector = integrated(one)
    kinds = said.keys[:, 0]
    assert set(range(len(CONSTANTS))) - set(kinds.tolist()) == set(
        np.flatnonzero(np.diagonal(information) <= 0).tolist()
    ) or len(kinds) == len(CONSTANTS)
    scale = np.sqrt(np.maximum(np.diagonal(information), 1e-6))
    difference = dense(said) - information[np.ix_(kinds, kinds)]
    assert np.abs(difference / scale[kinds] / scale[kinds][:, None]).max() < 1e-5
    assert (said.vector / scale[kinds]) == pytest.approx(vector[kinds] / scale[kinds], rel=1e-5, abs=1e-5)


@given(seed=st.integers(0, 2**31), cut=st.integers(0, 12), mounts=st.integers(1, 3))
def test_parts_add_up_in_any_order_and_can_be_taken_off(seed: int, cut: int, mounts: int) -> None:
    passes = some_passes(seed, 12, mounts)
    whole = ConstantsInformation.of_passes(passes)
    first, second = ConstantsInformation.of_passes(passes[:cut]), ConstantsInformation.of_passes(passes[cut:])
    assert_same(first + second, whole)
    assert_same(second + first, whole)
    rest = whole - first
    left = [k for k, key in enumerate(rest.keys.tolist()) if key in second.keys.tolist()]
    same_keys = ConstantsInformation(
        rest.keys[left], rest.information.within(np.array(left, int)), rest.vector[left]
    )
    assert_same(same_keys, second, 1e-6)


@pytest.mark.parametrize("whole_up_to", [300, 0])
@pytest.mark.parametrize("count", [0, 1, 9])
def test_bytes_bring_back_every_bit(count: int, whole_up_to: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stored as a whole triangle, or as its entries."""
    said = ConstantsInformation.of_passes(some_passes(1, count, 2))
    monkeypatch.setattr(drive_constants, "WHOLE_UP_TO", whole_up_to)
    again = ConstantsInformation.decode(said.encode())
    for name in ("keys", "vector"):
        assert np.array_equal(getattr(again, name), getattr(said, name))
    assert np.array_equal(dense(again), dense(said))


def test_a_long_drive_is_added_up_in_portions(monkeypatch: pytest.MonkeyPatch) -> None:
    passes = some_passes(4, 12, 3)
    whole = ConstantsInformation.of_passes(passes)
    monkeypatch.setattr(drive_constants, "PASSES_AT_ONCE", 5)
    assert_same(ConstantsInformation.of_passes(passes), whole, 1e-12)


def test_constants_by_the_thousand_are_integrated_out_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    said = ConstantsInformation.of_passes(some_passes(5, 12, 5))
    keys = [*map(tuple, said.keys[::3].tolist()), (MOUNT, 99)]
    information, vector = said.onto(keys)
    monkeypatch.setattr(symmetric_entries, "DENSE_UP_TO", 2)
    monkeypatch.setattr(symmetric_entries, "_COLUMNS_AT_ONCE", 3)
    found, right = said.onto(keys)
    scale = np.sqrt(np.diagonal(information)) + 1e-9
    assert found / scale / scale[:, None] == pytest.approx(information / scale / scale[:, None], abs=1e-9)
    assert right / scale == pytest.approx(vector / scale, rel=1e-7, abs=1e-7)


def test_onto_some_of_the_constants_the_others_are_integrated_out() -> None:
    said = ConstantsInformation.of_passes(some_passes(5, 10, 2))
    keys = [(MOUNT, 1), (LAG, 0), (MOUNT, 7)]
    information, vector = said.onto(keys)
    sigma = np.array(CONSTANT_SIGMA)[said.keys[:, 0]]
    whole = [tuple(key) for key in said.keys.tolist()]
    kept = [whole.index(key) for key in keys[:2]]
    hold = np.where(np.isin(np.arange(len(whole)), kept), 1.0, sigma**-2)
    covariance = np.linalg.inv(dense(said) + np.diag(hold))
    expected = np.linalg.inv(covariance[np.ix_(kept, kept)])
    assert information[:2, :2] + np.eye(2) == pytest.approx(expected, rel=1e-8)
    assert vector[:2] == pytest.approx(expected @ (covariance @ said.vector)[kept], rel=1e-8, abs=1e-8)
    assert not information[2].any()
    assert vector[2] == 0.0


def test_nothing_elsewhere_changes_nothing() -> None:
    table, drives = driven_town()
    plain = adjust(table, drives)
    for elsewhere in ({}, {k: ConstantsInformation.nothing() for k in drives}):
        found = adjust(table, drives, outside=elsewhere)
        assert found.slope_percent == pytest.approx(plain.slope_percent, abs=1e-7)
        assert found.slope_sigma_percent == pytest.approx(plain.slope_sigma_percent, rel=1e-5)


@pytest.mark.parametrize("width", [11, 12, 13])
def test_a_window_knows_of_a_mount_what_the_rest_of_the_drive_does(width: int) -> None:
    """Few drives over a few streets."""
    table, drives = driven_town(width, 10, 3, 5000.0)
    rows = (table.lon0_deg < 8.5015) & (table.lat0_deg < 49.001)
    part, inside, outside = within(table, drives, rows)
    assert 10 < len(part) < len(table) / 4
    said = {k: ConstantsInformation.of_passes(p) for k, p in outside.items()}
    whole, plain, told = (adjust(table, drives), *(adjust(part, inside, outside=e) for e in ({}, said)))
    mount, known = mounts(whole, table, drives, list(inside))
    error = [
        np.sqrt(np.mean(((mounts(f, part, inside, list(inside))[0] - mount) / known) ** 2))
        for f in (plain, told)
    ]
    assert error[1] < 1.0
    assert error[1] < 0.5 * error[0]


def mounts(
    found: Adjustment, table: RoadTable, drives: Drives, names: list[int]
) -> tuple[np.ndarray, np.ndarray]:
    """What a solution knows of the mounts of the drives with these names, and its sigma."""
    said = DriveBeliefs(PassColumns.of(drives), RoadUnknowns(table))
    unknown = np.array([said.unknowns[k].keys[MOUNT, 0] for k in names])
    covariance = found.solution.equations.covariance(unknown[:, None])
    return found.solution.x[unknown], np.sqrt(covariance[:, 0, 0])


def test_of_what_passes_inside_alone_speak_of_nothing_is_left_outside() -> None:
    """Parts of a drive that lie wholly inside of a window are not tied to those outside."""
    passes = [replace(p, place=k // 4) for k, p in enumerate(some_passes(2, 12))]
    left = ConstantsInformation.of_passes(passes) - ConstantsInformation.of_passes(passes[:6])
    assert_same(left, ConstantsInformation.of_passes(passes[6:]), 1e-6)
    assert {int(place) for kind, place in left.keys.tolist() if kind == EAST} == {1, 2}


@pytest.mark.slow
def test_windows_are_nearer_to_the_whole_with_what_is_said_elsewhere() -> None:
    """Few drives over a few streets: what a mount is, the rest of the drive knows. In most towns, not in all: what is
    said of roads' own roughness, and where a drive was, only the roads outside know."""
    off: list[tuple[float, float]] = []
    for count in (2, 3, 4, 5, 6):
        table, drives = driven_town(12, 10, count, 5000.0)
        rows = (table.lon0_deg < 8.5015) & (table.lat0_deg < 49.001)
        part, inside, outside = within(table, drives, rows)
        assert 10 < len(part) < len(table) / 4
        whole = adjust(table, drives)
        said = {k: ConstantsInformation.of_passes(p) for k, p in outside.items()}
        # What lies between hangs on heights outside.
        driven = np.unique([p.segment for d in inside.values() for p in d])
        slope, sigma = whole.slope_percent[rows][driven], whole.slope_sigma_percent[rows][driven]
        without, with_it = (
            np.mean(((adjust(part, inside, outside=e).slope_percent[driven] - slope) / sigma) ** 2)
            for e in ({}, said)
        )
        off.append((float(without), float(with_it)))
    mean_without, mean_with = np.mean(off, axis=0)
    assert mean_with < 0.7 * mean_without, off
