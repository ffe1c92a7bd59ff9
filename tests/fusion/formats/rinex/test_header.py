"""Headers: kinds of files that are read and not, and headers that are not whole."""

from __future__ import annotations

import pytest

from fusion.errors import MalformedLogError
from fusion.formats.rinex.header import Header, read_header
from fusion.formats.rinex.lines import split_lines


def read(*lines: tuple[str, str]) -> Header:
    """The header of a file with these contents and labels."""
    return read_header(split_lines("".join(f"{content:60}{label}\n" for content, label in lines).encode()))


def first(version: str, kind: str, system: str = "") -> tuple[str, str]:
    """A first line."""
    return f"{version:>9}{'':11}{kind:20}{system:20}", "RINEX VERSION / TYPE"


END = ("", "END OF HEADER")


@pytest.mark.parametrize(
    ("line", "kind", "system"),
    [
        (first("3.04", "OBSERVATION DATA", "M (MIXED)"), "O", "M"),
        (first("2.11", "OBSERVATION DATA", ""), "O", "G"),
        (first("2.11", "OBSERVATION DATA", "R"), "O", "R"),
        (first("2", "NAVIGATION DATA"), "N", "G"),
        (first("2.01", "GLONASS NAV DATA"), "N", "R"),
        (first("2.10", "H: GEO NAV MSG DATA"), "N", "S"),
        (first("2.12", "N: GNSS NAV DATA", "M: MIXED"), "N", "M"),
        (first("3.05", "N: GNSS NAV DATA", "E: GALILEO"), "N", "E"),
        (first("4.01", "NAVIGATION DATA", "M"), "N", "M"),
    ],
)
def test_the_first_line_says_kind_and_system(line: tuple[str, str], kind: str, system: str) -> None:
    types = ("G    1 C1C", "SYS / # / OBS TYPES")
    header = read(line, types, END)
    assert (header.kind, header.system, header.lines) == (kind, system, 3)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (first("3.04", "METEOROLOGICAL DATA"), "meteorological"),
        (first("3.04", "C"), "clock corrections"),
        (first("5.00", "OBSERVATION DATA"), "version '5.00'"),
        (first("1.00", "OBSERVATION DATA"), "version"),
        (first("x", "OBSERVATION DATA"), "version 'x'"),
        (first("3.04", "?"), "neither observations nor"),
    ],
)
def test_other_kinds_are_refused_by_name(line: tuple[str, str], says: str) -> None:
    with pytest.raises(MalformedLogError, match=says):
        read(line, END)


def test_half_a_header_is_refused_with_the_line_where_it_ends() -> None:
    with pytest.raises(MalformedLogError, match="no line up to line 2 is labelled END OF HEADER"):
        read(first("3.04", "OBSERVATION DATA", "M"), ("G    1 C1C", "SYS / # / OBS TYPES"))
    with pytest.raises(MalformedLogError, match="which observations follow"):
        read(first("3.04", "OBSERVATION DATA", "M"), END)
    with pytest.raises(MalformedLogError):
        read_header(split_lines(b""))


def test_what_stands_in_the_header_is_taken() -> None:
    header = read(
        first("3.04", "OBSERVATION DATA", "M"),
        ("G   14 C1C L1C D1C S1C C2W L2W D2W S2W C5Q L5Q D5Q S5Q C1W", "SYS / # / OBS TYPES"),
        ("       L1W", "SYS / # / OBS TYPES"),
        ("R    1 C1C", "SYS / # / OBS TYPES"),
        ("R  100   1 C1C", "SYS / SCALE FACTOR"),
        (" 10 R01  1 R02 -4 R03  5 R04  6 R05  1 R06 -4 R07  5 R08  6", "GLONASS SLOT / FRQ #"),
        ("    R09 -2 R10 -7", "GLONASS SLOT / FRQ #"),
        ("  2023    11    07    23    43   15.0000000     BDT", "TIME OF FIRST OBS"),
        ("  4146524.1277   613137.7231  4791517.3069", "APPROX POSITION XYZ"),
        ("        0.0580        0.0000       -0.0100", "ANTENNA: DELTA H/E/N"),
        ("GPSA   1.0000D-08  2.0000E-08 -6.0000D-08 -1.2000D-07", "IONOSPHERIC CORR"),
        ("GPSB   9.0000D+04  5.0000D+04 -1.3000D+05 -3.3000D+05", "IONOSPHERIC CORR"),
        END,
    )
    assert len(header.types["G"]) == 14
    assert header.types["R"] == ["C1C"]
    assert header.scale_factor == {("R", "C1C"): 100.0}
    assert header.channel == {1: 1, 2: -4, 3: 5, 4: 6, 5: 1, 6: -4, 7: 5, 8: 6, 9: -2, 10: -7}
    assert header.scale == "BDT"
    assert header.klobuchar == (1e-8, 2e-8, -6e-8, -1.2e-7, 9e4, 5e4, -1.3e5, -3.3e5)
    assert header.place_m == (4146524.1277, 613137.7231, 4791517.3069)
    assert header.antenna_m == (0.058, 0.0, -0.01)


@pytest.mark.parametrize("beta", ["", "  x", "GPSB   0.0000D+00"])
def test_half_an_ionosphere_is_none(beta: str) -> None:
    alpha = ("GPSA   1.0000D-08  2.0000E-08 -6.0000D-08 -1.2000D-07", "IONOSPHERIC CORR")
    assert read(first("3.04", "N", "M"), alpha, (beta, "IONOSPHERIC CORR"), END).klobuchar is None
