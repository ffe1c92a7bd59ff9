"""An archive of made-up logs over a real map, in mixed formats, some of them broken."""

from __future__ import annotations

import gzip
import zipfile
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from accuracy.logs import Columns, only, write_columns
from fusion.roads.table import RoadTable
from fusion.types import Floats
from profile_speed import record
from service.logs import HOURS, columns_of

APART_S = 600.0
"""Between the beginnings of two drives: some are on the road at once."""
STEP_M = 0.2
"""Of an altimeter's heights."""
LAG_S = 3.0
BROKEN = (
    ("picture.gpx", b"\x89PNG\r\n\x1a\n" + bytes(500)),
    ("columns.csv", b"time_s,speed_mps\n1,2\n"),
    ("empty.nmea", b""),
    ("cut.csv.gz", gzip.compress(b"time_s,lat_deg,lon_deg\n", mtime=0)[:12]),
    ("page.tcx", b"<!DOCTYPE html><html><body>Not found</body></html>"),
)
"""What archives hold beside logs."""


def make_log(roads: RoadTable, seed: int, length_m: float, folder: Path) -> Path:
    """One drive, in the format whose turn it is."""
    columns = columns_of(record(roads, HOURS, seed)[0], seed * APART_S, length_m)
    suffix, write = FORMS[seed % len(FORMS)]
    # A few hundred a folder, as archives have them.
    place = folder / f"{seed // 200:03d}" / f"drive-{seed:05d}{suffix}"
    place.parent.mkdir(parents=True, exist_ok=True)
    write(columns, place)
    return place


def make_broken(count: int, folder: Path) -> list[Path]:
    """So many files that are no logs, none like another."""
    made = []
    for k in range(count):
        name, data = BROKEN[k % len(BROKEN)]
        place = folder / "broken" / f"{k:03d}-{name}"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(data + (b"\n# %d" % k if data else b""))
        made.append(place)
    return made


def _csv(columns: Columns, place: Path) -> None:
    write_columns(columns, place)


def _packed(columns: Columns, place: Path) -> None:
    plain = place.with_suffix("")
    write_columns(columns, plain)
    place.write_bytes(gzip.compress(plain.read_bytes(), mtime=0))
    plain.unlink()


def _bundle(columns: Columns, place: Path) -> None:
    """Positions and motion in two files of one zip."""
    where = only(columns, ("time_s", "lat_deg", "lon_deg", "alt_msl_m", "h_acc_m", "v_acc_m"))
    with zipfile.ZipFile(place, "w") as bundle:
        for name, part in (("positions.csv", where), ("all.csv", columns)):
            plain = place.with_suffix(f".{name}")
            write_columns(part, plain)
            bundle.writestr(zipfile.ZipInfo(name), plain.read_bytes())
            plain.unlink()


def _gpx(columns: Columns, place: Path) -> None:
    _write_gpx(columns, columns["alt_msl_m"], place)


def _altimeter(columns: Columns, place: Path) -> None:
    """Heights as a bicycle computer's: late, and in steps."""
    time_s, height_m = columns["time_s"], columns["alt_msl_m"]
    late = np.interp(time_s - LAG_S, time_s, height_m)
    _write_gpx(columns, STEP_M * np.round(late / STEP_M), place)


def _write_gpx(columns: Columns, height_m: Floats, place: Path) -> None:
    points = "".join(
        f'<trkpt lat="{lat:.7f}" lon="{lon:.7f}"><ele>{height:.1f}</ele><time>{_utc(t).isoformat()}</time></trkpt>\n'
        for t, lat, lon, height in _rows(columns, height_m)
    )
    place.write_text(
        '<?xml version="1.0"?><gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>\n'
        f"{points}</trkseg></trk></gpx>\n"
    )


def _nmea(columns: Columns, place: Path) -> None:
    lines = []
    for t, lat, lon, height in _rows(columns, columns["alt_msl_m"]):
        clock, day = _utc(t).strftime("%H%M%S.%f")[:9], _utc(t).strftime("%d%m%y")
        at = f"{_minutes(lat, 2)},N,{_minutes(lon, 3)},E"
        lines.append(_checked(f"GPRMC,{clock},A,{at},,,{day},,,A"))
        lines.append(_checked(f"GPGGA,{clock},{at},1,12,0.8,{height:.1f},M,48.0,M,,"))
    place.write_text("".join(lines))


def _rows(columns: Columns, height_m: Floats) -> list[tuple[float, float, float, float]]:
    names = ("time_s", "lat_deg", "lon_deg")
    return list(zip(*(columns[name].tolist() for name in names), height_m.tolist(), strict=True))


def _utc(time_s: float) -> datetime:
    return datetime.fromtimestamp(round(time_s, 2), UTC)


def _minutes(degrees: float, digits: int) -> str:
    whole = int(degrees)
    return f"{whole:0{digits}d}{60 * (degrees - whole):09.6f}"


def _checked(body: str) -> str:
    total = 0
    for byte in body.encode():
        total ^= byte
    return f"${body}*{total:02X}\r\n"


FORMS: tuple[tuple[str, Callable[[Columns, Path], None]], ...] = (
    (".csv", _csv),
    (".gpx", _gpx),
    (".csv.gz", _packed),
    (".nmea", _nmea),
    (".zip", _bundle),
    (".alt.gpx", _altimeter),
)
