"""Which record is used: the nearest that is valid, whatever the order of the file, and none of another day."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.gnss.orbits.satellites import LIMIT_S, choose_glonass, choose_kepler
from fusion.signals import BEIDOU, GALILEO, GPS, QZSS, WEEK_S
from gnss_support import TOE_S, glonass_row_of, kepler_row_of
from satellites.library import glonass_table, kepler_table

SYSTEMS = (GPS, GALILEO, BEIDOU, QZSS)


def chosen(rows: list[dict[str, Any]], system: int, number: int, gps_s: float) -> int:
    return int(
        choose_kepler(kepler_table(rows), np.array([system]), np.array([number]), np.array([gps_s]))[0]
    )


@given(
    st.lists(st.tuples(st.sampled_from(SYSTEMS), st.integers(1, 3), st.integers(-9, 9)), max_size=12),
    st.sampled_from(SYSTEMS),
    st.integers(1, 3),
    st.floats(-8 * 3600.0, 8 * 3600.0),
)  # fmt: skip
def test_the_nearest_of_the_satellite_within_the_limit(
    made: list[tuple[int, int, int]], system: int, number: int, when: float
) -> None:
    rows = [kepler_row_of(s, k, toe_s=TOE_S + 1800.0 * half) for s, k, half in made]
    found = chosen(rows, system, number, TOE_S + when) if rows else -1
    away = [abs(r["toe_s"] - TOE_S - when) for r in rows if (r["system"], r["number"]) == (system, number)]
    if not away or min(away) > LIMIT_S[system] + 1.0:
        assert found == -1
    else:
        assert (rows[found]["system"], rows[found]["number"]) == (system, number)
        assert abs(rows[found]["toe_s"] - TOE_S - when) == pytest.approx(min(away), abs=1e-6)


def test_of_duplicates_the_healthy_then_the_last_sent_whatever_the_order() -> None:
    sick = kepler_row_of(GPS, 3) | {"healthy": False, "sent_s": TOE_S}
    early = kepler_row_of(GPS, 3) | {"sent_s": np.nan, "af0_s": 3.0}
    late = kepler_row_of(GPS, 3) | {"sent_s": TOE_S - 60.0, "af0_s": 1.0}
    for rows in ([sick, early, late], [late, sick, early], [early, late, sick]):
        assert rows[chosen(rows, GPS, 3, TOE_S + 100.0)] is late


def test_nothing_of_another_day_or_of_another_era_of_weeks() -> None:
    rows = [kepler_row_of(GPS, 3)]
    assert chosen(rows, GPS, 3, TOE_S + 86_400.0) == -1
    assert chosen(rows, GPS, 3, TOE_S + 1024 * WEEK_S) == -1
    assert chosen(rows, GPS, 4, TOE_S) == -1
    assert chosen(rows, GALILEO, 3, TOE_S) == -1


def test_a_week_that_ends_between_record_and_signal_is_no_matter() -> None:
    end_s = np.ceil(TOE_S / WEEK_S) * WEEK_S
    rows = [kepler_row_of(GPS, 3, toe_s=end_s)]
    assert chosen(rows, GPS, 3, end_s - 600.0) == 0
    assert chosen(rows, GPS, 3, end_s + 600.0) == 0


def test_glonass_records_serve_half_an_hour() -> None:
    eph = glonass_table([glonass_row_of(5), glonass_row_of(5, TOE_S + 3_600.0), glonass_row_of(6)])
    gps_s = TOE_S + np.array([0.0, 1_799.0, 1_810.0, -1_900.0, 6_000.0])
    assert choose_glonass(eph, np.full(5, 5), gps_s).tolist() == [0, 0, 1, -1, -1]
    assert choose_glonass(glonass_table([]), np.array([5]), gps_s[:1]).tolist() == [-1]


def test_rows_without_a_time_have_no_record() -> None:
    assert chosen([kepler_row_of(GPS, 3)], GPS, 3, np.nan) == -1
