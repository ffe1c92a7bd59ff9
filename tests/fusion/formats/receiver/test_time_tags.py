"""Sensor counters against the receiver's time: restarts, wraps, wrong rates, wrong tags, interruptions."""

from __future__ import annotations

from collections import Counter
from datetime import timedelta
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.formats import read_log
from fusion.formats.receiver.time_tags import LOST, MEAS_HZ, RAW_HZ, Marks, align

PERIOD_S = 0.1


def stream(true_s: np.ndarray, mark_s: np.ndarray) -> tuple[np.ndarray, Marks]:
    """Byte offsets (100 apart) of samples and marks written in the order of their times."""
    order = np.argsort(np.concatenate([true_s, mark_s]), kind="stable")
    offset = np.empty(len(order), np.int64)
    offset[order] = 100 * np.arange(len(order))
    return offset[: len(true_s)], Marks(offset[len(true_s) :], mark_s)


@settings(max_examples=40, deadline=None)
@given(
    duration=st.integers(5, 900),
    hz=st.one_of(st.just(1000.0), st.just(25600.0), st.floats(900, 1100), st.floats(25000, 26200)),
    start_tick=st.integers(0, 2**32 - 1),
    bits=st.sampled_from([24, 32]),
    phase=st.floats(0.01, 0.09),
)
def test_any_rate_start_and_wrap_is_aligned(
    duration: int, hz: float, start_tick: int, bits: int, phase: float
) -> None:
    true_s = 1.5e9 + phase + np.arange(0, duration, PERIOD_S)
    mark_s = 1.5e9 + np.arange(0.0, duration)
    offset, marks = stream(true_s, mark_s)
    tick = (start_tick + np.round((true_s - 1.5e9) * hz).astype(np.int64)) % 2**bits
    counts: Counter[str] = Counter()
    found = align(tick, offset, marks, 1000.0 if hz < 5000 else 25600.0, counts)
    assert not counts
    # a pair is right to half a period; a log of few pairs knows its rate no better than the nominal one
    slack = PERIOD_S / 2 + (abs(hz / round(hz, -2) - 1) + 0.1) * duration if duration < 8 else PERIOD_S
    assert np.abs(found - true_s).max() < slack


def test_a_restart_a_pause_and_wrong_tags_harm_only_themselves() -> None:
    first = 1.5e9 + 0.05 + np.arange(0, 120, PERIOD_S)
    second = first + 700.0  # paused for ten minutes, the receiver restarted
    true_s = np.concatenate([first, second])
    mark_s = np.concatenate([1.5e9 + np.arange(0.0, 120), 1.5e9 + 700 + np.arange(0.0, 120)])
    offset, marks = stream(true_s, mark_s)
    tick = np.concatenate([500_000 + (first - first[0]) * 1000, 40 + (second - second[0]) * 1000])
    tick = np.round(tick).astype(np.int64)
    wrong = np.array([300, 301, 1700])
    tick[wrong] = [4_000_000_000, 7, 90_000_000]
    counts: Counter[str] = Counter()
    found = align(tick, offset, marks, MEAS_HZ, counts)
    right = np.setdiff1d(np.arange(len(tick)), wrong)
    assert np.nanmax(np.abs(found - true_s)[right]) < PERIOD_S
    assert np.isnan(found[wrong]).all()
    assert counts[LOST] == 3


def test_a_paused_recording_with_a_running_counter_stays_aligned() -> None:
    true_s = 1.5e9 + 0.05 + np.concatenate([np.arange(0, 60, PERIOD_S), np.arange(660, 720, PERIOD_S)])
    mark_s = 1.5e9 + np.concatenate([np.arange(0.0, 60), np.arange(660.0, 720)])
    offset, marks = stream(true_s, mark_s)
    tick = np.round((true_s - 1.5e9) * RAW_HZ).astype(np.int64) % 2**24
    found = align(tick, offset, marks, RAW_HZ, Counter())
    assert np.abs(found - true_s).max() < PERIOD_S


def test_without_marks_or_without_order_nothing_is_invented() -> None:
    tick = np.arange(0, 5000, 100)
    offset = 100 * np.arange(50)
    counts: Counter[str] = Counter()
    assert np.isnan(align(tick, offset, Marks(np.empty(0, np.int64), np.empty(0)), MEAS_HZ, counts)).all()
    sorted_by_kind = Marks(10_000 + 100 * np.arange(5), 1.5e9 + np.arange(5.0))
    assert np.isnan(align(tick, offset, sorted_by_kind, MEAS_HZ, counts)).all()
    assert counts[LOST] == 100


@pytest.mark.parametrize("latency_s", [0.0, 0.08])
def test_latency_shifts_all_samples_alike(make: SimpleNamespace, latency_s: float) -> None:
    """Navigation messages written late, as receivers do, make sensor times early by the latency, no worse."""
    true_s = 0.03 + np.arange(0, 60, PERIOD_S)
    out: list[tuple[float, bytes]] = [
        (t, make.esf_meas(70_000 + round(t * 1000), [(16, k), (17, 0), (18, 10042)]))
        for k, t in enumerate(true_s)
    ]
    out += [(k + latency_s, make.pvt(make.start + timedelta(seconds=k))) for k in range(60)]
    log = read_log(b"".join(message for _, message in sorted(out)))
    error = log.force.time_s - make.start_s - true_s
    assert np.ptp(error) < 1e-3
    assert error.mean() == pytest.approx(-latency_s, abs=PERIOD_S / 2 + 0.01)
