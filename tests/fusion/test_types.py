"""Sensor tables: sorting, repeated times, unknown values, and what a log lacks."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.types import DriveLog, GnssFix, Odometry, Pressure

times = st.lists(st.one_of(st.floats(0, 100), st.just(float("nan"))), max_size=40)


@given(times)
def test_assembled_tables_increase_strictly_and_keep_each_first_sample(time_s: list[float]) -> None:
    time = np.array(time_s)
    value = np.arange(len(time), dtype=float)
    table = Pressure.assemble(time, pressure_pa=value)
    assert np.all(np.diff(table.time_s) > 0)
    assert set(table.time_s.tolist()) == {t for t in time_s if np.isfinite(t)}
    for t, v in zip(table.time_s, table.pressure_pa, strict=True):
        assert v == np.flatnonzero(time == t)[0]


def test_repairs_are_counted() -> None:
    repairs: Counter[str] = Counter()
    Pressure.assemble(np.array([3.0, 1.0, 2.0, 2.0]), repairs, pressure_pa=np.ones(4))
    assert repairs == {"Pressure: out of order": 1, "Pressure: repeated time": 1}


def test_rows_without_any_value_are_dropped_and_columns_not_given_are_unknown() -> None:
    table = Odometry.assemble(np.array([0.0, 1.0]), speed_mps=np.array([np.nan, 4.0]))
    assert table.time_s.tolist() == [1.0]
    assert np.isnan(table.wheel_left_rad).all()
    assert table.has("speed_mps")
    assert not table.has("speed_mps", "wheel_left_rad")


def test_a_table_refuses_columns_of_other_lengths_and_times_that_stand_still() -> None:
    with pytest.raises(ValueError, match="shape"):
        Pressure(np.array([0.0, 1.0]), np.array([1.0]), np.array([1.0, 2.0]))
    with pytest.raises(ValueError, match="increase strictly"):
        Pressure(np.array([0.0, 0.0]), np.array([1.0, 1.0]), np.array([1.0, 1.0]))


def test_a_log_says_what_it_lacks() -> None:
    fix = GnssFix.assemble(np.arange(3.0), lat_deg=np.full(3, 48.0), lon_deg=np.array([8.0, 8.1, 8.2]))
    log = DriveLog("gpx", fix)
    assert "attitude" in log.missing
    assert "fix.alt_msl_m" in log.missing
    assert "fix.lat_deg" not in log.missing
    assert log.bounds_deg() == (8.0, 48.0, 8.2, 48.0)
