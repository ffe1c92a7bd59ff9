"""Made-up logs of any number of records of every format, and how the libraries that readers lean on read the same."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from typing import Any
from xml.etree.ElementTree import iterparse

import numpy as np
import pyarrow as pa
from fitdecode import FitReader
from fitdecode.utils import compute_crc as fit_checksum
from pyarrow import csv

from fusion.formats.receiver.ubx_frames import frame
from fusion.signals import Signals
from fusion.simulate.write import rinex_file

START = datetime(2024, 5, 4, 10, 0, 0, tzinfo=UTC)
START_S = START.timestamp()
SATELLITES = 8
_FIT_EPOCH_S = 631_065_600


def _places(records: int, step_s: float = 0.1) -> Iterator[tuple[int, datetime, float, float]]:
    """Number, time, latitude and longitude of a drive that turns back now and then."""
    for k in range(records):
        yield k, START + timedelta(seconds=k * step_s), 50.0 + 1e-6 * (k % 500_000), 8.0 + 1e-7 * k


def _text(header: str, rows: Iterator[str]) -> bytes:
    return (header + "\n".join(rows) + "\n").encode()


def csv_log(records: int) -> bytes:
    """Versant CSV."""
    head = (
        "time_s,lat_deg,lon_deg,alt_msl_m,speed_mps,heading_deg,acc_x_mps2,acc_y_mps2,acc_z_mps2,pitch_deg\n"
    )
    return _text(
        head,
        (f"{START_S + k / 10:.2f},{lat:.7f},{lon:.7f},{100 + k % 97 / 10},7.1,348,0.1,0.2,9.8,1.5"
         for k, _, lat, lon in _places(records)),
    )  # fmt: skip


def torque(records: int) -> bytes:
    """A log of Torque."""
    head = (
        "GPS Time, Device Time, Longitude, Latitude,GPS Speed (Meters/second), Altitude, Bearing, G(x), G(y), G(z),"
        "Speed (OBD)(km/h)\n"
    )
    return _text(
        head,
        (f"{when:%a %b %d %H:%M:%S} GMT+00:00 {when:%Y},{when:%d-%b-%Y %H:%M:%S}.{k % 10}00,{lon:.7f},{lat:.7f},7.1,"
         f"{100 + k % 97 / 10},348,0.01,0.99,0.1,25.6" for k, when, lat, lon in _places(records)),
    )  # fmt: skip


def sensor_logger(records: int) -> bytes:
    """A Location.csv of Sensor Logger."""
    head = (
        "time,seconds_elapsed,bearingAccuracy,speedAccuracy,verticalAccuracy,horizontalAccuracy,speed,bearing,altitude,"
        "longitude,latitude\n"
    )
    return _text(
        head,
        (f"{round((START_S + k / 10) * 1e9)},{k / 10},5,0.3,3.2,4.1,7.1,348,{158 + k % 97 / 10},{lon:.7f},{lat:.7f}"
         for k, _, lat, lon in _places(records)),
    )  # fmt: skip


def rtklib_pos(records: int) -> bytes:
    """A solution of RTKLIB."""
    head = (
        "% (lat/lon/height=WGS84/ellipsoidal)\n%  GPST latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) "
        "sdu(m) sdne(m) sdeu(m) sdun(m) age(s) ratio\n"
    )
    return _text(
        head,
        (f"{when:%Y/%m/%d %H:%M:%S}.{k % 10}00   {lat:.9f}    {lon:.9f}   158.2500   1   9   0.0040   0.0030   0.0100"
         "   0.0010  -0.0010   0.0020   1.00    9.9" for k, when, lat, lon in _places(records)),
    )  # fmt: skip


def gnsslogger(records: int) -> bytes:
    """Half ``Fix`` lines, half ``Accel`` lines."""
    head = (
        "# Version: v3.0.6.4\n# Accel,utcTimeMillis,elapsedRealtimeNanos,AccelXMps2,AccelYMps2,AccelZMps2\n"
        "# Fix,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,AccuracyMeters,BearingDegrees,"
        "UnixTimeMillis,SpeedAccuracyMps,BearingAccuracyDegrees,elapsedRealtimeNanos,VerticalAccuracyMeters\n"
    )

    def lines() -> Iterator[str]:
        for k, _, lat, lon in _places(max(records // 2, 1)):
            ms = round((START_S + k / 10) * 1e3)
            yield f"Fix,GPS,{lat:.7f},{lon:.7f},158.2,7.1,3.8,348,{ms},0.2,,{k * 10**8},5.0"
            yield f"Accel,{ms},{k * 10**8},0.11,9.79,0.31"

    return _text(head, lines())


def gpx(records: int) -> bytes:
    """Track points with elevations."""
    head = (
        '<?xml version="1.0"?>\n<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>\n'
    )
    points = (
        f'<trkpt lat="{lat:.7f}" lon="{lon:.7f}"><ele>{112 + k % 97 / 10}</ele>'
        f"<time>{when:%Y-%m-%dT%H:%M:%S}.{k % 10}Z</time></trkpt>"
        for k, when, lat, lon in _places(records)
    )
    return _text(head, points) + b"</trkseg></trk></gpx>\n"


def tcx(records: int) -> bytes:
    """Track points with altitude, distance and speed, in one lap."""
    head = (
        '<?xml version="1.0" encoding="UTF-8"?>\n<TrainingCenterDatabase '
        'xmlns="http://www.garmin.com/xmlschemas/TrainingCenterDatabase/v2" '
        'xmlns:x="http://www.garmin.com/xmlschemas/ActivityExtension/v2"><Activities><Activity Sport="Biking">'
        "<Lap><Track>\n"
    )
    points = (
        f"<Trackpoint><Time>{when:%Y-%m-%dT%H:%M:%S}.{k % 10}00Z</Time><Position><LatitudeDegrees>{lat:.7f}"
        f"</LatitudeDegrees><LongitudeDegrees>{lon:.7f}</LongitudeDegrees></Position><AltitudeMeters>"
        f"{112 + k % 97 / 10}</AltitudeMeters><DistanceMeters>{0.7 * k:.1f}</DistanceMeters><Extensions><x:TPX>"
        "<x:Speed>7.1</x:Speed></x:TPX></Extensions></Trackpoint>"
        for k, when, lat, lon in _places(records)
    )
    return _text(head, points) + b"</Track></Lap></Activity></Activities></TrainingCenterDatabase>\n"


def fit(records: int) -> bytes:
    """Records with altitude and speed, one a second, of one definition."""
    fields = ((253, 4, 0x86), (0, 4, 0x85), (1, 4, 0x85), (2, 2, 0x84), (6, 2, 0x84))  # number, size, type
    body = bytearray(struct.pack("<BBBHBBBB", 0x40, 0, 0, 0, 1, 0, 1, 0) + b"\x00\x04")  # an activity
    body += struct.pack("<BBBHB", 0x40, 0, 0, 20, len(fields)) + b"".join(
        struct.pack("<BBB", *f) for f in fields
    )
    turn = 2**31 / 180
    for k, when, lat, lon in _places(records, 1.0):
        stamp = round(when.timestamp()) - _FIT_EPOCH_S
        body += struct.pack(
            "<BIiiHH", 0, stamp, round(lat * turn), round(lon * turn), (612 + k % 97) * 5, 7100
        )
    head = struct.pack("<BBHI4s", 14, 0x10, 2132, len(body), b".FIT")
    whole = head + struct.pack("<H", fit_checksum(head)) + body
    return bytes(whole + struct.pack("<H", fit_checksum(whole)))


def _sentence(body: str) -> str:
    total = 0
    for byte in body.encode():
        total ^= byte
    return f"${body}*{total:02X}"


def nmea(records: int) -> bytes:
    """Half RMC, half GGA sentences."""

    def sentences() -> Iterator[str]:
        for k, when, lat, lon in _places(max(records // 2, 1)):
            clock = f"{when:%H%M%S}.{k % 10}0"
            place = f"{int(lat):02d}{lat % 1 * 60:08.5f},N,{int(lon):03d}{lon % 1 * 60:08.5f},E"
            yield _sentence(f"GNRMC,{clock},A,{place},13.915,347.91,{when:%d%m%y},,,A")
            yield _sentence(f"GNGGA,{clock},{place},1,12,0.79,112.3,M,45.6,M,,")

    return _text("", sentences())


def ubx(records: int) -> bytes:
    """NAV-PVT messages."""
    out = bytearray()
    for _, when, lat, lon in _places(records):
        itow = (
            round((when - datetime(2024, 4, 28, tzinfo=UTC)).total_seconds() * 1000) + 18_000
        ) % 604_800_000
        out += frame(1, 7, struct.pack(
            "<IHBBBBBBIiBBBBiiiiIIiiiiiIIH6xihH", itow, when.year, when.month, when.day, when.hour, when.minute,
            when.second, 0x37, 20, when.microsecond * 1000, 3, 1, 0, 14, round(lon * 1e7), round(lat * 1e7), 158_000,
            112_000, 971, 1636, 7000, -1500, -210, 7159, 34_790_000, 115, 240_000, 159, 0, 0, 0,
        ))  # fmt: skip
    return bytes(out)


def _signals(records: int) -> Signals:
    epochs = max(records // SATELLITES, 1)
    rows = epochs * SATELLITES
    gps_s = np.repeat(1.4e9 + np.arange(epochs), SATELLITES)
    number = np.tile(np.arange(1, SATELLITES + 1), epochs)
    rng = np.random.default_rng(1)
    return Signals.assemble(
        gps_s, np.zeros(rows, np.int64), number, pseudorange_m=rng.uniform(2e7, 2.5e7, rows),
        range_rate_mps=rng.uniform(-800, 800, rows), cn0_dbhz=rng.uniform(25, 50, rows),
        frequency_hz=np.full(rows, 1_575_420_000.0),
    )  # fmt: skip


def rinex(records: int) -> bytes:
    """Observations of eight satellites an epoch; a record is a satellite's line."""
    return rinex_file.observations(_signals(records)).encode()


def pseudoranges_csv(records: int) -> bytes:
    """Pseudoranges with their satellites' names."""
    signals = _signals(records)
    return _text(
        "time_s,sv,pseudorange_m,cn0_dbhz\n",
        (f"{signals.time_s[k]:.3f},G{signals.number[r]:02d},{signals.pseudorange_m[r]:.3f},{signals.cn0_dbhz[r]:.2f}"
         for r, k in enumerate(signals.epoch)),
    )  # fmt: skip


def ucenter(records: int) -> bytes:
    """NAV-PVT and ESF-MEAS listings, one record each."""

    def listings() -> Iterator[str]:
        for k, _, lat, lon in _places(max(records // 2, 1)):
            place = f"{round(lon * 1e7)}  {round(lat * 1e7)}"
            yield (
                f"-----\n01 07 NAV-PVT    - 8C 3B : 8C 3B 100\nNAV-PVT {401_678_000 + 100 * k}      -8451 3\n"
                f"    {place}      38091      -7563      971      1636\n"
                "        0        1        -10        1  18558394      115      237647\n    1.59 14"
            )
            tag = 346_160 + 100 * k
            yield (
                f"-----\n10 02 ESF-MEAS   - AC 7A : AC 7A 32\nESF-MEAS      {tag} TTAG:   346.160 FLAGS:1818 ID:0000\n"
                "calibTtagValid\n\n    16 Accelerometer X      FFFD76      -0.635\n\n"
                f"    {tag}    346.160 calibtTag (Receiver Time Tag)"
            )

    return _text("", listings())


MAKERS: dict[str, Callable[[int], bytes]] = {
    "rinex": rinex, "gnsslogger": gnsslogger, "ubx": ubx, "u-center": ucenter, "nmea": nmea, "gpx": gpx,
    "fit": fit, "tcx": tcx, "pseudoranges-csv": pseudoranges_csv, "sensor-logger": sensor_logger,
    "rtklib-pos": rtklib_pos, "torque": torque, "csv": csv_log,
}  # fmt: skip


def _by_pyarrow(data: bytes) -> Any:
    return csv.read_csv(pa.py_buffer(data), csv.ReadOptions(use_threads=False))


def _by_expat(data: bytes) -> Any:
    for _, element in iterparse(io.BytesIO(data)):  # noqa: S314 - of our own making
        element.clear()


def _by_pyubx2(data: bytes) -> Any:
    from pyubx2 import UBXReader  # noqa: PLC0415 - for tests and benchmarks alone

    return sum(1 for _ in UBXReader(io.BytesIO(data)))


def _by_pynmeagps(data: bytes) -> Any:
    from pynmeagps import NMEAReader  # noqa: PLC0415 - for tests and benchmarks alone

    return sum(1 for _ in NMEAReader(io.BytesIO(data)))


def _by_fitdecode(data: bytes) -> Any:
    return sum(1 for _ in FitReader(io.BytesIO(data)))


LIBRARIES: dict[str, tuple[str, Callable[[bytes], Any]]] = {
    "csv": ("pyarrow.csv", _by_pyarrow),
    "pseudoranges-csv": ("pyarrow.csv", _by_pyarrow),
    "sensor-logger": ("pyarrow.csv", _by_pyarrow),
    "gpx": ("xml.etree (expat)", _by_expat),
    "tcx": ("xml.etree (expat)", _by_expat),
    "fit": ("fitdecode", _by_fitdecode),
    "ubx": ("pyubx2", _by_pyubx2),
    "nmea": ("pynmeagps", _by_pynmeagps),
}
