"""Small FIT, TCX and GPX files, written here by the published formats, so that readers meet a foreign writer."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta

START = datetime(2018, 5, 4, 15, 34, 20, tzinfo=UTC)
FIT_EPOCH_S = 631065600

Field = tuple[int, str, object]
"""(number in the profile, format of ``struct``, value or values as they stand in the file)."""
Message = tuple[int, list[Field]]
"""(number in the profile, its fields)."""

BASE_TYPES = {"B": 0x02, "b": 0x01, "H": 0x84, "h": 0x83, "i": 0x85, "I": 0x86, "f": 0x88, "E": 0x00}
FILE_ID, SESSION, RECORD, EVENT, GPS_METADATA, GYROSCOPE, ACCELEROMETER, BAROMETER = (
    0,
    18,
    20,
    21,
    160,
    164,
    165,
    209,
)
ACTIVITY, SETTINGS, COURSE = 4, 2, 6
TIMER, STARTED, STOPPED = 0, 0, 4


def stamp(when: datetime) -> int:
    """A FIT ``date_time``."""
    return round(when.timestamp()) - FIT_EPOCH_S


def semicircles(degrees: float) -> int:
    """An angle as FIT has it."""
    return round(degrees * 2**31 / 180)


def crc16(data: bytes) -> int:
    """The checksum of FIT, bit by bit."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


def _message(number: int, fields: list[Field]) -> bytes:
    """A definition and the data message after it, both local message 0."""
    head = struct.pack("<BBBHB", 0x40, 0, 0, number, len(fields))
    data = b"\x00"
    for field, kind, value in fields:
        values = value if isinstance(value, tuple) else (value,)
        packed = struct.pack(f"<{len(values)}{kind.replace('E', 'B')}", *values)
        head += struct.pack("<BBB", field, len(packed), BASE_TYPES[kind])
        data += packed
    return head + data


def fit(messages: Iterable[Message]) -> bytes:
    """A FIT file of these messages."""
    body = b"".join(_message(*message) for message in messages)
    head = struct.pack("<BBHI4s", 14, 0x10, 2132, len(body), b".FIT")
    whole = head + struct.pack("<H", crc16(head)) + body
    return whole + struct.pack("<H", crc16(whole))


def file_id(kind: int = ACTIVITY) -> Message:
    """The first message of every file."""
    return FILE_ID, [(0, "E", kind), (1, "H", 1)]


def timer(when: datetime, kind: int) -> Message:
    """The timer is started or stopped."""
    return EVENT, [(253, "I", stamp(when)), (0, "E", TIMER), (1, "E", kind)]


def record(when: datetime, lat: float = 50.95, lon: float = 1.88, **more: Field) -> Message:
    """A position with altitude, speed and temperature; ``more`` are further fields."""
    return RECORD, [
        (253, "I", stamp(when)), (0, "i", semicircles(lat)), (1, "i", semicircles(lon)), (2, "H", (112 + 500) * 5),
        (6, "H", 7100), (13, "b", 20), *more.values(),
    ]  # fmt: skip


def drive_fit(records: int = 20, start: datetime = START) -> bytes:
    """A ride at one record a second."""
    seconds = [start + timedelta(seconds=k) for k in range(records)]
    return fit([
        file_id(),
        timer(start, STARTED),
        *(record(when, 50.95 + 6e-5 * k) for k, when in enumerate(seconds)),
        timer(seconds[-1], STOPPED),
    ])  # fmt: skip


def trackpoint(when: datetime, lat: float = 50.95, inner: str = "") -> str:
    """A track point of TCX, with altitude and speed."""
    return (
        f"<Trackpoint><Time>{when:%Y-%m-%dT%H:%M:%S.000Z}</Time><Position><LatitudeDegrees>{lat:.7f}</LatitudeDegrees>"
        "<LongitudeDegrees>1.88</LongitudeDegrees></Position><AltitudeMeters>112.4</AltitudeMeters>"
        "<DistanceMeters>5.0</DistanceMeters><HeartRateBpm><Value>120</Value></HeartRateBpm>"
        f"<Extensions><ns3:TPX><ns3:Speed>7.1</ns3:Speed></ns3:TPX></Extensions>{inner}</Trackpoint>"
    )


def tcx(laps: Iterable[Iterable[str]], kind: str = "Activity") -> bytes:
    """A TCX file of laps, which have tracks, which have points."""
    body = "".join(f"<Lap>{''.join(f'<Track>{track}</Track>' for track in tracks)}</Lap>" for tracks in laps)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<TrainingCenterDatabase '
        'xmlns="http://www.garmin.com/xmlschemas/TrainingCenterDatabase/v2" '
        'xmlns:ns3="http://www.garmin.com/xmlschemas/ActivityExtension/v2">\n'
        f'<Activities><{kind} Sport="Biking"><Id>2018-05-04T15:34:20.000Z</Id>{body}</{kind}></Activities>\n'
        "</TrainingCenterDatabase>\n"
    ).encode()


def track(first: int, count: int) -> str:
    """Track points, one a second."""
    seconds = range(first, first + count)
    return "\n".join(trackpoint(START + timedelta(seconds=k), 50.95 + 6e-5 * k) for k in seconds)


def gpx(points: int = 20, segments: int = 2, version: str = "1.1", inner: str = "") -> bytes:
    """A GPX track."""
    namespace = f"http://www.topografix.com/GPX/{version.replace('.', '/')}"
    out = [f'<?xml version="1.0"?>\n<gpx version="{version}" xmlns="{namespace}"><trk>']
    for s in range(segments):
        out.append("<trkseg>")
        for k in range(points):
            when = START + timedelta(seconds=100 * s + k)
            out.append(
                f'<trkpt lat="{50.95 + 6e-5 * (100 * s + k):.7f}" lon="1.88"><ele>{112 + k / 10}</ele>'
                f"<time>{when:%Y-%m-%dT%H:%M:%SZ}</time>{inner}</trkpt>"
            )
        out.append("</trkseg>")
    return "\n".join([*out, "</trk></gpx>\n"]).encode()
