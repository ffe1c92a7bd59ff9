"""An archive of years of rides as people have them: exports of several programs in one folder, and what is no ride.

Every file is small and made here. Rides are days apart, so that none goes on in another.
"""

from __future__ import annotations

import gzip
import io
import zipfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path

import garmin_files as garmin
from log_samples import drive_nmea

FIRST = datetime.fromisoformat("2015-03-01T08:00:00+00:00")
POINTS = 12
HEADER = "Aktivitäts-ID,Datum der Aktivität,Name der Aktivität,Aktivitätsart,Beschreibung,Verstrichene Zeit,Dateiname"


@dataclass
class RideArchive:
    """What was made: ``files`` in all, how many of each kind, and how many drives they are."""

    root: Path
    files: int = 0
    kinds: Counter[str] = field(default_factory=Counter)
    drives: int = 0


def fit_ride(start: datetime, sport: int = 2) -> bytes:
    """A FIT file with a session that tells the sport (2: cycling, 5: swimming)."""
    moments = [start + timedelta(seconds=k) for k in range(POINTS)]
    told: list[garmin.Field] = [(5, "E", sport), (6, "E", 0), (9, "I", 12300)]
    session = (garmin.SESSION, [(253, "I", garmin.stamp(moments[-1])), *told])
    records = (garmin.record(when, 50.95 + 6e-5 * k) for k, when in enumerate(moments))
    return garmin.fit([garmin.file_id(), *records, session])


def gpx_ride(start: datetime, sport: str = "") -> bytes:
    """A GPX track."""
    points = "".join(
        f'<trkpt lat="{50.95 + 6e-5 * k:.6f}" lon="1.88"><ele>{100 + k}</ele>'
        f"<time>{start + timedelta(seconds=k):%Y-%m-%dT%H:%M:%SZ}</time></trkpt>"
        for k in range(POINTS)
    )
    kind = f"<type>{sport}</type>" if sport else ""
    return (
        f'<?xml version="1.0"?><gpx version="1.1"><trk>{kind}<trkseg>{points}</trkseg></trk></gpx>'.encode()
    )


def tcx_ride(start: datetime) -> bytes:
    """A TCX activity."""
    points = (garmin.trackpoint(start + timedelta(seconds=k), 50.95 + 6e-5 * k) for k in range(POINTS))
    return garmin.tcx([["".join(points)]])


def tcx_treadmill(start: datetime) -> bytes:
    """A TCX activity without a place."""
    points = "".join(
        f"<Trackpoint><Time>{start + timedelta(seconds=k):%Y-%m-%dT%H:%M:%SZ}</Time></Trackpoint>"
        for k in range(POINTS)
    )
    return garmin.tcx([[points]]).replace(b"Biking", b"Running")


def csv_ride(start: datetime) -> bytes:
    """A Versant CSV."""
    first_s = int(start.timestamp())
    rows = (f"{first_s + k},{50.95 + 6e-5 * k:.6f},1.88,{100 + k}\n" for k in range(POINTS))
    return ("time_s,lat_deg,lon_deg,alt_msl_m\n" + "".join(rows)).encode()


JUNK = (b"\xff\xd8\xff\xe0 a picture", b"hello there", b'{"locations": [{"latitudeE7": 1}]}')
OF_TEN = ("gpx", "fit", "tcx", "csv", "nmea", "swim", "treadmill", "junk", "again", "jog")


def made_file(number: int) -> tuple[str, bytes, str]:
    """The path of a file of an archive, its bytes, and what a manifest says that it is."""
    kind, start = OF_TEN[number % 10], FIRST + timedelta(days=number)
    makers: dict[str, tuple[Callable[[datetime], bytes], str, str]] = {
        "gpx": (gpx_ride, f"strava/activities/{number}.gpx", "drive"),
        "jog": (gpx_ride, f"strava/activities/{number}.gpx", "not-on-roads"),
        "fit": (fit_ride, f"strava/activities/{number}.fit.gz", "drive"),
        "swim": (partial(fit_ride, sport=5), f"{number}.fit", "not-on-roads"),
        "tcx": (tcx_ride, f"takeout/Fit/{number}.tcx", "drive"),
        "treadmill": (tcx_treadmill, f"takeout/Fit/{number}.tcx", "empty-log"),
        "junk": (lambda _: JUNK[number // 10 % 3], f"takeout/{number}.dat", "unknown-format"),
        "nmea": (partial(drive_nmea, POINTS), f"recorder/{number}.nmea", "drive"),
        "again": (lambda _: csv_ride(start - timedelta(days=5)), f"recorder/z{number}.csv.gz", "repeated"),
        "csv": (csv_ride, f"recorder/{number}.csv", "drive"),
    }
    make, name, told = makers[kind]
    data = make(start)
    return name, gzip.compress(data) if name.endswith(".gz") else data, told


def make_archive(root: Path, files: int) -> RideArchive:
    """Write so many files below ``root``, ten kinds in turn, those of Garmin as zips in a zip; and Strava's list."""
    made, listed, inner = RideArchive(root), [HEADER], dict[str, bytes]()
    for number in range(files):
        name, data, told = made_file(number)
        if name.startswith("strava"):
            sport = "Lauf" if told == "not-on-roads" else "Radfahrt"
            listed.append(f'{number},"1. März, 08:00","Fahrt, die {number}.",{sport},,12,{name[7:]}')
        made.kinds[told] += 1
        made.drives += told == "drive"
        if "/" not in name:
            inner[name] = data
            continue
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    (root / "garmin.zip").write_bytes(zipped({"DI_CONNECT/UploadedFiles_0-_Part1.zip": zipped(inner)}))
    (root / "strava" / "activities.csv").write_text("\n".join(listed), encoding="utf-8")
    made.kinds["unknown-format"] += 1
    made.files = files + 1
    return made


def zipped(files: dict[str, bytes]) -> bytes:
    """A zip of these files."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return out.getvalue()
