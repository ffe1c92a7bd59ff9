"""What a driver is told of navigation data that are not there."""

from __future__ import annotations

import numpy as np

from fusion.gnss.missing_navigation import ROLL_OVER_S, navigation_warnings
from fusion.signals import BEIDOU, GALILEO, GLONASS, GPS, SBAS, Navigation, Signals
from gnss_support import TOE_S, even_sky


def log_of(*systems: int, after_s: float = 0.0) -> Signals:
    """Ten epochs with a satellite of each system."""
    gps_s = np.repeat(TOE_S + after_s + np.arange(10.0), len(systems))
    system = np.tile(np.array(systems), 10)
    return Signals.assemble(gps_s, system, np.ones(len(system)), pseudorange_m=np.full(len(system), 2.2e7))


def test_nothing_is_said_where_all_is_there() -> None:
    sky = even_sky(GPS, GALILEO, BEIDOU, GLONASS)
    assert navigation_warnings(log_of(GPS, GLONASS, BEIDOU, SBAS), sky) == []


def test_no_navigation_at_all() -> None:
    (said,) = navigation_warnings(log_of(GPS, GALILEO), Navigation())
    assert "no navigation data" in said
    assert "2021-03-17" in said


def test_systems_without_navigation_are_named_together() -> None:
    (said,) = navigation_warnings(log_of(GPS, GLONASS, BEIDOU), even_sky(GPS))
    assert said == "There are no navigation data of GLONASS and BeiDou: 20 measurements are left out."


def test_another_day_is_said_with_both_dates() -> None:
    said = navigation_warnings(log_of(GPS, GLONASS, after_s=3 * 86_400.0), even_sky(GPS, GLONASS))
    assert len(said) == 2
    assert "GPS are of 2021-03-17, the log is of 2021-03-20" in said[0]
    assert "GLONASS" in said[1]
    assert not any("weeks" in sentence for sentence in said)


def test_a_lost_count_of_weeks_is_said() -> None:
    (said,) = navigation_warnings(log_of(GPS, after_s=-ROLL_OVER_S), even_sky(GPS))
    assert "1024 weeks apart" in said


def test_a_drive_that_begins_before_the_navigation_meets_it() -> None:
    signals = log_of(GPS, after_s=-7_205.0)
    assert navigation_warnings(signals, even_sky(GPS)) == []
