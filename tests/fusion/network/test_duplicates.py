"""One drive in two logs is a duplicate; two drives are not, however alike their ways and times."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.network.duplicates import DriveTrace, find_duplicates, is_duplicate

T0_S = 1_700_000_000.0
SEGMENTS = 40
SPEED_MPS = 10.0
LENGTH_M = 30.0


def drive(
    *,
    begin_s: float = T0_S,
    pace: float = 1.0,
    phase_s: float = 0.0,
    period_s: float = 1.0,
    digits_m: float = 0.0,
    laps: int = 1,
    segments: range = range(SEGMENTS),
    measurements: int = 1000,
    seed: int | None = None,
) -> DriveTrace:
    """A drive over a street; entries are wrong by what positions are rounded to, or by a receiver's error (a seed)."""
    rng = np.random.default_rng(seed or 0)
    order = np.tile(np.array(segments), laps)
    entry = begin_s + pace * LENGTH_M / SPEED_MPS * (np.arange(len(order)) + segments.start)
    entry += digits_m * rng.uniform(-0.5, 0.5, len(entry)) / SPEED_MPS
    if seed is not None:
        entry += rng.normal(0, 1.5, len(entry)) / SPEED_MPS
    epochs = np.arange(begin_s + phase_s, entry[-1] + 3, period_s)
    return DriveTrace(order, entry, epochs, measurements)


LOG = drive()


@pytest.mark.parametrize(
    "other",
    [
        pytest.param(drive(), id="the same bytes"),
        pytest.param(drive(digits_m=1.0, measurements=300), id="GPX with five decimals"),
        pytest.param(drive(period_s=5.0, measurements=80), id="every fifth epoch"),
        pytest.param(drive(segments=range(30), measurements=750), id="cut off"),
        pytest.param(DriveTrace(LOG.segment, LOG.enter_s, np.empty(0), 1000), id="without its epochs"),
    ],
)
def test_a_drive_in_two_logs_is_one(other: DriveTrace) -> None:
    assert is_duplicate(LOG, other)
    assert is_duplicate(other, LOG)


@pytest.mark.parametrize(
    "other",
    [
        pytest.param(drive(begin_s=T0_S + 3600), id="an hour later"),
        pytest.param(drive(begin_s=T0_S + 2), id="in convoy"),
        pytest.param(drive(pace=1.03), id="a bit slower"),
        pytest.param(drive(segments=range(100, 140)), id="elsewhere"),
        pytest.param(drive(segments=range(35, 75)), id="a small part together"),
        pytest.param(drive(phase_s=0.4), id="other epochs"),
        pytest.param(DriveTrace(np.empty(0, np.int64), np.empty(0), np.empty(0), 0), id="nothing"),
    ],
)
def test_another_drive_is_another(other: DriveTrace) -> None:
    assert not is_duplicate(LOG, other)
    assert not is_duplicate(other, LOG)


def test_two_receivers_in_a_vehicle_are_two_drives() -> None:
    receivers = {seed: drive(seed=seed) for seed in range(1, 21)}
    assert find_duplicates(receivers) == {}


def test_laps_of_one_drive_are_one_drive() -> None:
    """A log of three laps is one drive, and so is a log of its last lap."""
    laps = drive(laps=3)
    last = DriveTrace(
        laps.segment[80:], laps.enter_s[80:], laps.epoch_s[laps.epoch_s > laps.enter_s[80]], 300
    )
    assert find_duplicates({0: laps}) == {}
    assert find_duplicates({0: last, 1: laps}) == {0: 1}


def test_the_one_with_more_measurements_counts() -> None:
    poor, rich, other = (
        drive(digits_m=1.0, measurements=300),
        drive(measurements=2000),
        drive(begin_s=T0_S + 900),
    )
    assert find_duplicates({0: poor, 1: rich, 2: other}) == {0: 1}
    assert find_duplicates({0: rich, 1: other, 2: poor, 3: poor}) == {2: 0, 3: 0}


@settings(max_examples=30)
@given(st.permutations(range(6)))
def test_the_order_of_logs_has_no_part_in_it(order: list[int]) -> None:
    logs = [drive(measurements=100 * k, begin_s=T0_S + 900 * (k % 3)) for k in range(6)]
    found = find_duplicates({place: logs[k] for place, k in enumerate(order)})
    assert {order[a]: order[b] for a, b in found.items()} == {0: 3, 1: 4, 2: 5}


def test_a_thousand_drives_are_compared_in_seconds() -> None:
    """Only those that entered a segment at about one time: all with all would be half a million comparisons."""
    drives = {k: drive(begin_s=T0_S + 60.0 * k, seed=k + 1) for k in range(1000)}
    started = time.process_time()
    assert find_duplicates(drives | {1000: drives[500], 1001: drive(begin_s=T0_S - 1e6)}) == {1000: 500}
    assert time.process_time() - started < 5.0
