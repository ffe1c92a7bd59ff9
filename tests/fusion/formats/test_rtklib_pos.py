"""RTKLIB's solutions: every notation of positions and times."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fusion.errors import EmptyLogError, MalformedLogError
from fusion.formats import read_log
from fusion.frames import ecef_to_geodetic

TAIL = "Q  ns   sd{0}(m)   sd{1}(m)   sd{2}(m)  sd{0}{1}(m)  sd{1}{2}(m)  sd{2}{0}(m) age(s)  ratio"
LLH = f"latitude(deg) longitude(deg)  height(m)   {TAIL.format('n', 'e', 'u')}"
DMS = f"latitude(d'\") longitude(d'\")  height(m)   {TAIL.format('n', 'e', 'u')}"
XYZ = f"x-ecef(m)      y-ecef(m)      z-ecef(m)   {TAIL.format('x', 'y', 'z')}"
ENU = f"e-baseline(m)    n-baseline(m)    u-baseline(m)   {TAIL.format('e', 'n', 'u')}"
REST = "1   9   0.0030   0.0040   0.0100   0.0010  -0.0010   0.0020   1.00    9.9"
UNIX_S = 1525448060.5
"""2018-05-04 15:34:20.5 UTC, 18 s behind GPS time: week 1999, second 488078.5."""


def pos(
    columns: str, row: str, scale: str = "GPST", comment: str = "(lat/lon/height=WGS84/ellipsoidal)"
) -> bytes:
    """A solution of one line."""
    return f"% program   : RTKPOST\n% {comment}\n%  {scale}                  {columns}\n{row}\n".encode()


@pytest.mark.parametrize(
    ("scale", "when"),
    [
        ("GPST", "2018/05/04 15:34:38.500"),
        ("UTC", "2018/05/04 15:34:20.500"),
        ("JST", "2018/05/05 00:34:20.500"),
        ("GPST", "1999 488078.500"),
        ("UTC", "1999 488060.500"),
    ],
)
def test_times_of_every_scale_and_notation(scale: str, when: str) -> None:
    log = read_log(pos(LLH, f"{when}   50.95   1.88   158.25   {REST}", scale))
    assert log.fix.time_s[0] == pytest.approx(UNIX_S, abs=1e-4)


def test_positions_of_every_notation_are_the_same() -> None:
    place = ecef_to_geodetic().transform(-1.88, -50.95, 158.25, direction="INVERSE")
    rows = {
        LLH: "-50.950000000 -1.880000000 158.2500",
        DMS: "-50 57 00.00000 -1 52 48.00000 158.2500",
        XYZ: " ".join(f"{value:.4f}" for value in place),
    }
    for columns, row in rows.items():
        fix = read_log(pos(columns, f"1999 488078.500 {row} {REST}")).fix
        assert (fix.lat_deg[0], fix.lon_deg[0]) == pytest.approx((-50.95, -1.88), abs=1e-8)
        assert fix.height_ell_m[0] == pytest.approx(158.25, abs=1e-3)
    fix = read_log(pos(DMS, f"1999 488078.5 -00 30 00.0 -00 15 00.0 1.0 {REST}")).fix
    assert (fix.lat_deg[0], fix.lon_deg[0]) == pytest.approx((-0.5, -0.25))


def test_accuracies_and_velocities(make: SimpleNamespace) -> None:
    log = read_log(make.rtklib_pos())
    assert log.fix.time_s[0] == make.start_s
    assert (log.fix.h_acc_m[0], log.fix.v_acc_m[0]) == pytest.approx((0.005, 0.01))
    v = log.velocity
    assert (v.vel_n_mps[0], v.vel_e_mps[0], v.vel_d_mps[0]) == (6.9, -1.5, -0.1)
    assert v.s_acc_mps[0] == pytest.approx(np.sqrt((0.03**2 + 0.03**2 + 0.06**2) / 3))
    assert log.geoid == "unknown"


def test_earth_centred_velocities_are_turned() -> None:
    columns = f"{XYZ}    vx(m/s)    vy(m/s)    vz(m/s)      sdvx     sdvy     sdvz"
    row = (
        f"1999 488078.5 6378137.0 0.0 0.0 {REST} 1.0 2.0 3.0 0.1 0.1 0.1"  # at 0, 0: x is up, y east, z north
    )
    v = read_log(pos(columns, row).replace(b"6378137.0 0.0 0.0", b"6378137.0 0.1 0.1")).velocity
    assert (v.vel_n_mps[0], v.vel_e_mps[0], v.vel_d_mps[0]) == pytest.approx((3, 2, -1), abs=1e-6)


def test_velocities_of_zeros_without_accuracy_are_none() -> None:
    columns = f"{LLH} vn(m/s) ve(m/s) vu(m/s) sdvn sdve sdvu"
    assert not len(read_log(pos(columns, f"1999 488078.5 50.95 1.88 1.0 {REST} 0 0 0 0 0 0")).velocity)


def test_geodetic_heights_are_above_a_geoid() -> None:
    log = read_log(
        pos(LLH, f"1999 488078.5 50.95 1.88 112 {REST}", comment="(lat/lon/height=WGS84/geodetic)")
    )
    assert log.fix.alt_msl_m[0] == 112
    assert np.isnan(log.fix.height_ell_m[0])
    assert log.geoid == "as RTKLIB was told"


def test_baselines_are_refused_with_what_to_do() -> None:
    with pytest.raises(MalformedLogError, match=r"baselines .* Let RTKLIB write Lat/Lon/Height"):
        read_log(pos(ENU, f"1999 488078.5 1.0 2.0 3.0 {REST}"))


def test_damaged_lines_cost_themselves_only() -> None:
    good = f"1999 488078.5 50.95 1.88 112 {REST}"
    rows = [
        good,
        good.replace("50.95", "x").replace("78.5", "79.5"),
        "1999 488080.5 50.95",
        "",
        good.replace("78.5", "81.5"),
    ]
    log = read_log(pos(LLH, "\n".join(rows)))
    assert len(log.fix) == 2
    assert log.skipped["lines with another number of cells"] == 1
    assert any("line 6: 3 cells instead of 15" in warning for warning in log.warnings)
    with pytest.raises(EmptyLogError, match="no usable position"):
        read_log(pos(LLH, ""))


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_other_separators_are_read_alike(delimiter: str) -> None:
    row = delimiter.join(f"2018/05/04 15:34:38.500 50.95 1.88 112 {REST}".split())
    assert read_log(pos(LLH, row)).fix.time_s[0] == UNIX_S
