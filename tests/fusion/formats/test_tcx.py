"""TCX."""

from __future__ import annotations

import numpy as np
import pytest

import garmin_files as g
from fusion.errors import EmptyLogError, MalformedLogError
from fusion.formats import read_log

START_S = g.START.timestamp()


def test_points_altitudes_and_speeds() -> None:
    log = read_log(g.tcx([[g.track(0, 5)]]))
    assert (log.fix.time_s - START_S).tolist() == [0, 1, 2, 3, 4]
    assert log.fix.lat_deg == pytest.approx(50.95 + 6e-5 * np.arange(5))
    assert log.fix.lon_deg.tolist() == [1.88] * 5
    assert log.fix.alt_msl_m.tolist() == [112.4] * 5
    assert log.odometry.speed_mps.tolist() == [7.1] * 5
    assert "velocity" in log.missing and not log.skipped and not log.warnings
    second = g.trackpoint(g.START, inner="<Extensions><TPX><Speed>9</Speed></TPX></Extensions>")
    assert read_log(g.tcx([[second]])).odometry.speed_mps.tolist() == [7.1]  # the first counts


def test_pauses_are_gaps_and_laps_are_none() -> None:
    assert len(read_log(g.tcx([[g.track(0, 5)], [g.track(5, 5)]])).outages_s) == 0
    assert (read_log(g.tcx([[g.track(0, 5), g.track(5, 5)]])).outages_s - START_S).tolist() == [5]
    assert (read_log(g.tcx([[g.track(0, 5)], [g.track(50, 5)]])).outages_s - START_S).tolist() == [50]
    assert (
        read_log(g.tcx([[g.track(0, 5), g.track(20, 5)], [g.track(25, 5)]])).outages_s - START_S
    ).tolist() == [20]


def test_points_without_a_position_keep_their_speed() -> None:
    blind = g.trackpoint(g.START).replace("Position", "Nowhere").replace("Degrees", "None")
    log = read_log(g.tcx([[blind, g.track(1, 3)]]))
    assert len(log.fix) == 3 and len(log.odometry) == 4
    assert log.skipped["track points without a position"] == 1


def test_what_nobody_drove_is_refused() -> None:
    with pytest.raises(EmptyLogError, match="planned course"):
        read_log(g.tcx([[g.track(0, 3)]], kind="Course"))
    with pytest.raises(EmptyLogError, match="no track"):
        read_log(g.tcx([]))
    with pytest.raises(EmptyLogError, match=r"None of the 3 track points .* has a position"):
        read_log(g.tcx([[g.track(0, 3)]]).replace(b"Degrees>", b"None>"))
    with pytest.raises(EmptyLogError, match="has a time"):
        read_log(g.tcx([[g.track(0, 3)]]).replace(b"Time>", b"None>"))


def test_damage_costs_what_comes_after_it() -> None:
    whole = g.tcx([[g.track(0, 10)]])
    log = read_log(whole[: whole.index(b"15:34:26")])
    assert len(log.fix) == 6
    assert any("TCX file is broken at line" in w for w in log.warnings)
    with pytest.raises(MalformedLogError, match="before its first track point"):
        read_log(whole[: whole.index(b"<Position>")])
    with pytest.raises(MalformedLogError, match="entities"):
        read_log(b'<!DOCTYPE x [<!ENTITY a "b">]>' + whole[whole.index(b"<Training") :])
