"""Files as devices write them: every one in the folder of shared data is read, or refused for its reason."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fusion.errors import EmptyLogError, LogError, UnknownFormatError
from fusion.formats import FORMATS, read_log
from fusion.types import Floats

READ: dict[str, tuple[str, dict[str, int]]] = {
    "gnsslogger_Pixel4_GnssLog.txt": ("gnsslogger", {"fix": 2, "velocity": 2}),
    "gnsslogger_pixel6.txt": ("gnsslogger", {"fix": 94, "velocity": 94}),
    "gnsslogger_Pixel4_ground_truth.csv": ("csv", {"fix": 199, "velocity": 199}),
    "pixel6.nmea": ("nmea", {"fix": 48, "velocity": 48}),
}
"""File -> format, and how many samples each sensor has."""
REFUSED: dict[str, tuple[type[LogError], str]] = {
    "LICENSE-fit.txt": (UnknownFormatError, "no format that is known"),
    "gnsslogger_all_sensors.txt": (EmptyLogError, "no usable position"),
}
"""File -> why it is no log."""


def folder_of(shared_data: Path) -> Path:
    folder = shared_data / "formats"
    if not folder.is_dir():
        pytest.skip("no files of devices beside the project")
    return folder


@pytest.mark.parametrize("name", READ)
def test_it_is_read(shared_data: Path, name: str) -> None:
    log = read_log(folder_of(shared_data) / name)
    assert (log.source_format, {n: len(t) for n, t in log.tables().items() if len(t)}) == READ[name]


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused(shared_data: Path, name: str) -> None:
    kind, why = REFUSED[name]
    with pytest.raises(kind, match=why):
        read_log(folder_of(shared_data) / name)


def test_any_other_file_is_read_or_refused_in_a_sentence(shared_data: Path) -> None:
    """Further files may come beside those of the tables at any time."""
    for path in folder_of(shared_data).iterdir():
        if path.is_dir() or path.name in {*READ, *REFUSED}:
            continue
        try:
            log = read_log(path)
        except LogError as error:
            assert str(error).endswith(".")
        else:
            assert log.source_format in FORMATS
            assert len(log.fix)


def metres_apart(lat_deg: Floats, lon_deg: Floats, other_lat_deg: Floats, other_lon_deg: Floats) -> Floats:
    """Between places that are near each other, (n,)."""
    east = (lon_deg - other_lon_deg) * np.cos(np.radians(lat_deg))
    return np.asarray(111_200.0 * np.hypot(lat_deg - other_lat_deg, east))


def test_a_phones_positions_are_within_ten_metres_of_its_reference(shared_data: Path) -> None:
    folder = folder_of(shared_data)
    fix = read_log(folder / "gnsslogger_Pixel4_GnssLog.txt").fix
    truth = read_log(folder / "gnsslogger_Pixel4_ground_truth.csv").fix
    lat, lon = (np.interp(fix.time_s, truth.time_s, c) for c in (truth.lat_deg, truth.lon_deg))
    assert np.all((fix.time_s >= truth.time_s[0]) & (fix.time_s <= truth.time_s[-1]))
    assert metres_apart(fix.lat_deg, fix.lon_deg, lat, lon).max() < 10
    assert (
        np.abs(np.abs(fix.height_ell_m) - np.interp(fix.time_s, truth.time_s, truth.height_ell_m)).max() < 5
    )


def test_a_phones_sentences_and_positions_agree(shared_data: Path) -> None:
    folder = folder_of(shared_data)
    logs = [read_log(folder / name).fix for name in ("gnsslogger_pixel6.txt", "pixel6.nmea")]
    lat, lon = (np.interp(logs[1].time_s, logs[0].time_s, c) for c in (logs[0].lat_deg, logs[0].lon_deg))
    inside = (logs[1].time_s > logs[0].time_s[0]) & (logs[1].time_s < logs[0].time_s[-1])
    assert inside.sum() > 30
    assert np.median(metres_apart(logs[1].lat_deg, logs[1].lon_deg, lat, lon)[inside]) < 10
