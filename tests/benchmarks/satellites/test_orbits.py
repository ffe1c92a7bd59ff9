"""The benchmark of orbits: what it compares, on the measured files."""

from __future__ import annotations

import numpy as np

from gnss_support import gnss_file
from satellites import orbits
from satellites.library import navigation_of
from satellites.precise import read_clk


def test_the_library_agrees_with_every_record() -> None:
    rows = orbits.beside_library(gnss_file("brdc1370.20n")) + orbits.beside_library(gnss_file("brdc1370.20g"))
    assert [(row["system"], row["span"], row["records"]) for row in rows] == [
        ("G", "valid", 6),
        ("G", "day", 6),
        ("R", "valid", 4),
    ]
    assert all(row["position_m"] < 0.01 and row["clock_ns"] < 1e-6 for row in rows)


def test_broadcast_orbits_and_clocks_lie_near_precise_ones() -> None:
    product = gnss_file("COD0OPSRAP_20230730000_01D_05M_ORB.SP3")
    clocks = read_clk(gnss_file("COD0OPSRAP_20230730000_01D_30S_CLK.CLK"))
    rows = orbits.beside_precise(
        product, clocks, navigation_of(gnss_file("BRDC00WRD_S_20230730000_01D_MN.rnx"))
    )
    assert [(row["system"], row["satellites"], row["epochs"]) for row in rows] == [
        ("G", 2, 3),
        ("R", 2, 3),
        ("E", 2, 3),
    ]
    assert all(row["max_level_m"] < 3.0 and row["clock_max_ns"] < 10.0 for row in rows)


def test_gps_of_a_quarter_of_a_day_lies_within_the_goal_but_for_single_satellites() -> None:
    product = gnss_file("COD0MGXFIN_20211180000_01D_05M_ORB.SP3")
    (row,) = orbits.beside_precise(product, {}, navigation_of(gnss_file("brdc1180.21n")))
    assert row["satellites"] == 31
    assert row["rms_m"] < 3.0
    assert row["within_goal"] > 0.95
    assert row["clock_max_ns"] < 10.0
    assert row["worst"] == "G14"  # its broadcast lags by 4 to 5 m along its orbit


def test_a_product_of_another_day_has_no_rows() -> None:
    product = gnss_file("GFZ0MGXRAP_20201380000_01D_05M_ORB.SP3")
    assert orbits.beside_precise(product, {}, navigation_of(gnss_file("brdc1370.20n"))) == []


def test_offsets_of_time_scales_are_taken_off_by_epoch() -> None:
    clock = np.array([1.0, 3.0, 7.0, np.nan, 5.0])
    gps_s = np.array([0.0, 0.0, 1.0, 1.0, 2.0])
    assert np.array_equal(
        orbits._median_by_epoch(clock, gps_s), [2.0, 2.0, np.nan, np.nan, np.nan], equal_nan=True
    )
