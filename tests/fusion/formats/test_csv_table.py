"""What the columns of a CSV are taken as, as people are shown it, and what they say of it."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

from fusion.formats import FORMATS, columns_of, read_log
from fusion.formats.tables.names import NOT_USED

HEADER = "Timestamp,Latitude,Longitude,Altitude (ft),Speed,Ellipsoid Height,foo,Latitude,"
ROWS = [f"2026-01-01T00:00:0{k}Z,49.000{k},8.4,{1000 + k},,{'' if k < 2 else 340 + k},x,1," for k in range(9)]
CSV = "\n".join([HEADER, *ROWS]).encode()


def taken(data: bytes = CSV, **columns: str) -> dict[str, tuple[str | None, str | None, bool]]:
    return {one.name: (one.taken_as, one.unit, one.guessed) for one in columns_of(data, columns)}


def test_names_units_and_values() -> None:
    assert taken() == {
        "Timestamp": ("time", None, True),
        "Latitude": ("lat_deg", "°", True),
        "Longitude": ("lon_deg", "°", True),
        "Altitude (ft)": ("alt_msl_m", "ft", True),
        "Speed": ("speed_mps", None, True),
        "Ellipsoid Height": ("height_ell_m", "m", True),
        "foo": (None, None, False),
    }
    values = {one.name: one.values for one in columns_of(CSV)}
    assert values["Altitude (ft)"] == ("1000", "1001", "1002")
    assert values["Ellipsoid Height"] == ("342", "343", "344"), "the first that there are"
    assert values["Speed"] == ()


def test_what_a_person_says_counts_and_what_the_file_has_not_is_passed_over() -> None:
    found = taken(height_ell_m="Altitude (ft)", speed_mps=NOT_USED, pressure_hpa="gone")
    assert found["Altitude (ft)"] == ("height_ell_m", "ft", False)
    assert found["Ellipsoid Height"] == (None, None, False)
    assert found["Speed"] == (None, None, False)


def test_a_column_that_is_not_to_be_used_is_not_read() -> None:
    assert read_log(CSV).fix.has("alt_msl_m")
    without = read_log(CSV, columns={"alt_msl_m": NOT_USED})
    assert not without.fix.has("alt_msl_m")
    assert without.fix.has("height_ell_m")
    own = b"time_s,lat_deg,lon_deg,alt_msl_m\n1700000000,49,8.4,3\n1700000001,49,8.4,3\n"
    assert not read_log(own, columns={"alt_msl_m": NOT_USED}).fix.has("alt_msl_m")


def test_as_it_is_read() -> None:
    """Units that are shown are those that values are read in."""
    fix = read_log(CSV).fix
    assert np.allclose(fix.alt_msl_m[:3], np.array([1000, 1001, 1002]) * 0.3048)


@pytest.mark.parametrize(
    ("head", "names"),
    [
        ("time;lat;lon;höhe\n1700000000;49,1;8,4;3\n1700000001;49,2;8".encode("utf-16"), 4),
        (b"Device Time,GPS Time,Latitude,Longitude,Vehicle Speed(km/h),G(x)\n1,2,49,8,50,0.1\n", 6),
        (b"lat,lon\n", 2),
        (b'lat,lon,"a\n', 3),
    ],
)
def test_any_beginning_of_a_table(head: bytes, names: int) -> None:
    found = columns_of(head)
    assert len(found) == names
    assert all(len(one.values) <= 3 for one in found)


def test_units_of_a_car() -> None:
    head = b"Device Time,GPS Time,Latitude,Longitude,Vehicle Speed(km/h),G(x)\n1,2,49,8,50,0.1\n"
    found = taken(head)
    assert found["Vehicle Speed(km/h)"] == ("odo_speed_mps", "km/h", True)
    assert found["G(x)"] == ("device_acceleration", None, True)
    assert found["Device Time"][0] == "time"


def test_what_is_no_table_has_no_columns() -> None:
    assert "csv" in FORMATS
    for head in (b"", b"<gpx></gpx>", gzip.compress(CSV), b"\x00\x01\x02", b"$GPGGA,,,\n"):
        assert columns_of(head) == ()
