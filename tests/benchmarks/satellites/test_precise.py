"""Readers of precise orbits and clocks."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fusion.signals import GLONASS, GPS
from satellites.precise import read_clk, read_sp3

TIME_S = 1_362_787_200.0
"""2023-03-14 00:00:00, GPS week 2253, day 2."""


def test_places_and_clocks_of_an_orbit_file(tmp_path: Path) -> None:
    path = tmp_path / "some.sp3"
    path.write_text(
        "#dP2023  3 14  0  0  0.00000000       1 d\n"
        "*  2023  3 14  0  5  0.00000000\n"
        "PG01  21831.572967  14746.989380  -4963.026791    203.089254\n"
        "PR24   7073.429172   9359.927764  22658.338727 999999.999999\n"
        "EOF\n"
    )
    found = read_sp3(path)
    assert found.gps_s.tolist() == [TIME_S + 300.0] * 2
    assert found.system.tolist() == [GPS, GLONASS]
    assert found.number.tolist() == [1, 24]
    assert np.allclose(found.position_m[0], [21_831_572.967, 14_746_989.380, -4_963_026.791])
    assert found.clock_s[0] == 203.089254e-6
    assert np.isnan(found.clock_s[1])


def test_clocks_of_a_clock_file(tmp_path: Path) -> None:
    path = tmp_path / "some.clk"
    path.write_text(
        "     2.00           CLOCK DATA\n"
        "AR WAB2 2023 03 14 00 00 00.000000  1    0.1E-08\n"
        "AS G05  2023 03 14 00 00 30.000000  2   -0.164526087371E-04  0.159030617577E-10\n"
    )
    assert read_clk(path) == {(GPS, 5, TIME_S + 30.0): -0.164526087371e-4}
