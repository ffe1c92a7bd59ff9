"""The messages of a FIT file that a drive is made of, as columns, up to where the file is damaged.

fitdecode decodes; its profile names messages and fields and has their scales. A file may hold several FIT files one
after the other ("chained"): each is decoded by itself, so that damage in one costs nothing of the next.
"""

from __future__ import annotations

import io
import math
import struct
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from fitdecode import CrcCheck, ErrorHandling, FitDataMessage, FitEOFError, FitReader
from fitdecode.profile import FIELD_TYPES
from fitdecode.utils import compute_crc

from fusion.errors import MalformedLogError
from fusion.formats.base import Data, Notes
from fusion.messages import say
from fusion.types import Floats, Progress

MAGIC = b".FIT"
HEAD_BYTES = 12
"""The least that a header has; two bytes more where it has a checksum of its own."""
PROGRESS_EVERY = 1 << 12
MOST_ROWS = 10_000_000
"""Of a hundred days at one a second: a small file may declare messages of one byte."""

SAMPLED: dict[str, tuple[str, ...]] = {
    "barometer_data": ("baro_pres",),
    "accelerometer_data": ("calibrated_accel_x", "calibrated_accel_y", "calibrated_accel_z"),
    "gyroscope_data": ("calibrated_gyro_x", "calibrated_gyro_y", "calibrated_gyro_z"),
}
"""Messages of several samples, each with its own ``sample_time_offset``, and the fields with one number a sample."""
COLUMNS: dict[str, tuple[str, ...]] = {
    "record": (
        "timestamp", "time128", "position_lat", "position_long", "enhanced_altitude", "enhanced_speed", "gps_accuracy",
        "temperature", "absolute_pressure",
    ),
    "gps_metadata": (
        "timestamp", "timestamp_ms", "position_lat", "position_long", "enhanced_altitude", "enhanced_speed", "heading",
        "utc_timestamp", "velocity",
    ),
    "timestamp_correlation": ("timestamp", "timestamp_ms", "system_timestamp", "system_timestamp_ms"),
    **{name: ("timestamp", "timestamp_ms", "sample_time_offset", *fields) for name, fields in SAMPLED.items()},
}  # fmt: skip
"""Messages of numbers and the fields of them that are read, in the units of the profile."""
VELOCITY = "velocity"
"""A field of three numbers."""
UNCALIBRATED = {"accelerometer_data": "accel_x", "gyroscope_data": "gyro_x"}
"""The field that such messages have without calibrated values: counts of a converter, which are of no use."""
WORDS: dict[str, tuple[str, ...]] = {
    "file_id": ("type",),
    "session": ("sub_sport",),
    "event": ("timestamp", "event", "event_type"),
}


def sport_words(numbers: Mapping[str, Sequence[int]]) -> str:
    """The names of ``sport`` and ``sub_sport``, each the last that was said; empty where that is nothing."""
    words = []
    for name in ("sub_sport", "sport"):
        known: Any = FIELD_TYPES[name].enum
        words += [str(known.get(number, "")) for number in numbers.get(name, ())[-1:]]
    return " ".join(word for word in words if word not in ("", "generic", "all"))


@dataclass
class FitFile:
    """What one FIT file says: ``columns`` by message and field, (n,), NaN where unknown; ``words`` in file order.

    ``uncalibrated`` are samples of a message that are of no use. The three numbers of ``velocity`` (east, north, up)
    are columns ``velocity_0`` to ``velocity_2``.
    """

    columns: dict[str, dict[str, Floats]] = field(default_factory=dict)
    words: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    uncalibrated: dict[str, int] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """What the file says that it is, such as ``activity``; empty if it says nothing."""
        kinds = (str(row["type"]) for row in self.words.get("file_id", ()) if row.get("type") is not None)
        return next(kinds, "")


def read_files(data: Data, notes: Notes, progress: Progress) -> list[FitFile]:
    """Every FIT file of a chain; damage is said in ``notes``, and what stands before it is given.

    Raises ``MalformedLogError`` if not even the first file's header is whole.
    """
    out: list[FitFile] = []
    for at, end, closed in _parts(data, notes):
        part = memoryview(data)[at:end]
        if closed and end <= len(data) and _crc(part):
            notes.repaired["FIT checksum wrong: read all the same"] += 1
            notes.warn(say("fit.checksum", at=at))
        stream = io.BytesIO(part if closed else _closed(part))
        out.append(_read_file(stream, at, len(data), notes, progress, closed))
    return out


def _parts(data: Data, notes: Notes) -> Iterator[tuple[int, int, bool]]:
    """(begin, end, whether its end was written) of each FIT file; the last may end beyond the data."""
    at = 0
    while at < len(data):
        head = bytes(data[at : at + HEAD_BYTES])
        if len(head) < HEAD_BYTES or head[8:] != MAGIC or head[0] < HEAD_BYTES:
            if not at:
                raise MalformedLogError(
                    say("fit.no_header"),
                    where="byte 0",
                )
            notes.skip("bytes after the last FIT file", len(data) - at, say("place.byte", n=at))
            return
        body = int(struct.unpack("<I", head[4:8])[0])
        end = at + head[0] + body + 2
        behind = bytes(data[end : end + HEAD_BYTES])
        closed = body > 0 or len(data) <= end or behind[8:] == MAGIC
        if not closed:  # the size is written when the recording ends
            notes.repaired["FIT file never closed: read to the end"] += 1
            notes.warn(say("fit.never_closed"))
            end = len(data)
        yield at, end, closed
        at = end


def _closed(part: memoryview) -> bytes:
    """A file whose header does not tell its size, with that size and room for a checksum."""
    body = len(part) - part[0]
    head = bytes(part[:4]) + struct.pack("<I", body) + MAGIC + bytes(part[0] - HEAD_BYTES)
    return head + bytes(part[part[0] :]) + b"\0\0"


def _read_file(
    stream: io.BytesIO, begin: int, size: int, notes: Notes, progress: Progress, closed: bool
) -> FitFile:
    rows = {name: array("d") for name in COLUMNS}
    out = FitFile()
    reader = FitReader(
        stream, processor=None, check_crc=CrcCheck.DISABLED, error_handling=ErrorHandling.IGNORE
    )
    frames = iter(reader)
    count = 0
    while True:
        try:
            frame = next(frames, None)
        except MemoryError:
            raise
        except Exception as error:
            _say_damage(error, begin + stream.tell(), closed, count, notes)
            break
        if frame is None:
            break
        if isinstance(frame, FitDataMessage):
            count += 1
            _take(frame, rows, out)
            if count % PROGRESS_EVERY == 0:
                progress("read messages", min((begin + stream.tell()) / size, 1.0))
                _refuse_flood(rows, out)
    for name, flat in rows.items():
        names = _names(name)
        table = np.array(flat).reshape(-1, len(names))
        out.columns[name] = {n: table[:, k] for k, n in enumerate(names)}
    return out


def _say_damage(error: Exception, at: int, closed: bool, count: int, notes: Notes) -> None:
    """Say where the file ends early or is damaged; one that was never closed ends anywhere."""
    if isinstance(error, FitEOFError):
        if closed:
            notes.repaired["FIT file cut off: read to the end"] += 1
            notes.warn(say("fit.ends_early", n=count, at=at))
        return
    notes.repaired["FIT file damaged: read up to the damage"] += 1
    notes.warn(say("fit.damaged", at=at, n=count))


def _refuse_flood(rows: dict[str, array[float]], out: FitFile) -> None:
    most = max(len(flat) // len(_names(name)) for name, flat in rows.items())
    if max(most, *(len(rows) for rows in out.words.values()), 0) > MOST_ROWS:
        raise MalformedLogError(say("fit.too_many", most=MOST_ROWS))


def _names(message: str) -> list[str]:
    """The columns that a message's fields become."""
    return [
        column
        for name in COLUMNS[message]
        for column in ([f"{name}_{k}" for k in range(3)] if name == VELOCITY else [name])
    ]


def _take(frame: Any, rows: dict[str, array[float]], out: FitFile) -> None:
    name = frame.name
    if name in COLUMNS:
        values = _found(frame, COLUMNS[name])
        if math.isnan(_number(values.get("timestamp"))):
            return
        if name not in SAMPLED:
            rows[name].extend(_flat(name, values))
        elif any(field in values for field in SAMPLED[name]):
            rows[name].extend(_samples(name, values))
        else:
            raw = UNCALIBRATED.get(name, "")
            count = len(_several(_found(frame, (raw,)).get(raw)))
            out.uncalibrated[name] = out.uncalibrated.get(name, 0) + count
    elif name in WORDS:
        out.words.setdefault(name, []).append(_found(frame, WORDS[name]))


def _found(frame: Any, names: tuple[str, ...]) -> dict[str, Any]:
    """Values by field. Developers' own fields may have any name and are left out.

    Where a message has a field itself and as a part of another, coarser one (altitude), the field itself counts.
    """
    values: dict[str, Any] = {}
    for item in frame.fields:
        profile_field, definition = item.field, item.field_def
        if profile_field is None or item.value is None or (definition is not None and definition.is_dev):
            continue
        name = profile_field.name
        if name in names and (definition is not None or name not in values):
            values[name] = item.value
    return values


def _flat(message: str, values_of: dict[str, Any]) -> list[float]:
    """The numbers of a message's columns."""
    out = []
    for name in COLUMNS[message]:
        if name == VELOCITY:
            values = _several(values_of.get(name))
            out += values if len(values) == 3 else [np.nan] * 3
        else:
            out.append(_number(values_of.get(name)))
    return out


def _samples(message: str, values_of: dict[str, Any]) -> list[float]:
    """The numbers of a message's columns for each of its samples; what does not fit together is unknown."""
    both = [_number(values_of.get("timestamp")), _number(values_of.get("timestamp_ms"))]
    columns = [_several(values_of.get(name)) for name in SAMPLED[message]]
    count = max(map(len, columns))
    offsets = _several(values_of.get("sample_time_offset"))
    if not offsets and count == 1:
        offsets = [0.0]
    fitting = [column if len(column) == count else [np.nan] * count for column in (offsets, *columns)]
    return [number for sample in zip(*fitting, strict=True) for number in (*both, *sample)]


def _several(value: object) -> list[float]:
    if value is None:
        return []
    return [_number(v) for v in value] if isinstance(value, tuple) else [_number(value)]


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else np.nan


_CRC_OF_BYTE = [compute_crc(bytes([byte])) for byte in range(256)]


def _crc(part: memoryview) -> int:
    """CRC-16 of a FIT file with its own checksum at the end: 0 if that is right.

    By the byte, which is five times as fast as the library's by half a byte.
    """
    crc, table = 0, _CRC_OF_BYTE
    for byte in part:
        crc = crc >> 8 ^ table[(crc ^ byte) & 0xFF]
    return crc
