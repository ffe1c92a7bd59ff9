"""Tables of raw signals, and the scales of time that they are written in."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.signals import (
    GPS_EPOCH_S,
    GlonassEphemerides,
    KeplerEphemerides,
    Navigation,
    Signals,
    gps_from_unix,
    satellite_name,
    unix_from_gps,
)


@pytest.mark.parametrize(
    ("day", "ahead_s"),
    [
        ("1980-01-06", 0),
        ("1981-07-01", 1),
        ("1999-01-01", 13),
        ("2016-12-31", 17),
        ("2017-01-01", 18),
        ("2026-01-01", 18),
    ],
)
def test_leap_seconds(day: str, ahead_s: int) -> None:
    unix = np.array([np.datetime64(day, "s").astype(np.int64)], float)
    gps = gps_from_unix(unix)
    assert gps[0] - (unix[0] - GPS_EPOCH_S) == ahead_s
    assert unix_from_gps(gps)[0] == unix[0]


@given(st.floats(315964800, 3e9))
def test_scales_there_and_back(unix_s: float) -> None:
    assert unix_from_gps(gps_from_unix(np.array([unix_s])))[0] == pytest.approx(unix_s, abs=1e-6)


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 3), st.integers(1, 9)), max_size=40))
def test_rows_in_any_order_make_the_same_table(rows: list[tuple[int, int, int]]) -> None:
    table = np.array(sorted(set(rows)), float).reshape(-1, 3)
    order = np.random.default_rng(len(rows)).permutation(len(table))
    columns = {"pseudorange_m": table @ [1.0, 10.0, 100.0]}
    one = Signals.assemble(table[:, 0], table[:, 1], table[:, 2], **columns)
    two = Signals.assemble(*table[order].T, pseudorange_m=columns["pseudorange_m"][order])
    assert np.array_equal(one.pseudorange_m, two.pseudorange_m)
    assert np.array_equal(one.gps_s, np.unique(table[:, 0]))
    assert np.array_equal(np.repeat(one.gps_s, np.diff(one.first)), table[:, 0])


def test_doubled_and_empty_rows_are_dropped() -> None:
    one = Signals.assemble(
        np.array([1.0, 1.0, np.nan, 2.0]),
        np.zeros(4, int),
        np.full(4, 7),
        pseudorange_m=np.array([5.0, 6, 7, np.nan]),
    )
    assert one.gps_s.tolist() == [1.0]
    assert one.pseudorange_m.tolist() == [5.0]


def test_taking_rows_keeps_the_epochs() -> None:
    one = Signals.assemble(
        np.array([1.0, 1, 2, 3]), np.zeros(4, int), np.array([1, 2, 1, 1]), pseudorange_m=np.arange(4.0)
    )
    rest = one.take_rows(np.array([False, False, True, True]))
    assert rest.first.tolist() == [0, 0, 1, 2]
    assert rest.epoch.tolist() == [1, 2]
    assert len(Signals.empty()) == 0


def test_shapes_and_order_are_checked() -> None:
    one = Signals.empty()
    with pytest.raises(ValueError, match="shape"):
        Signals(**{**vars(one), "pseudorange_m": np.zeros(2)})
    with pytest.raises(ValueError, match="increase"):
        Signals(**{**vars(one), "gps_s": np.array([2.0, 1.0]), "first": np.zeros(3, int)})


def test_navigation_joins() -> None:
    both = Navigation(klobuchar=None).joined(Navigation(klobuchar=(1.0,) * 8))
    assert both.klobuchar == (1.0,) * 8
    assert len(both) == 0
    assert len(KeplerEphemerides.empty().joined(KeplerEphemerides.empty())) == 0
    assert GlonassEphemerides.empty().position_m.shape == (0, 3)


def test_names() -> None:
    assert satellite_name(2, 5) == "E05"
