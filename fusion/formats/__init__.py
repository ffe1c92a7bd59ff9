"""Log formats: bytes in, a ``DriveLog`` out. One file per format, one line in the registry below.

Not read yet, each to become one more file and line: FIT, RINEX observations, raw UBX observations
(RXM-RAWX, one more entry in ``ubx_messages.TYPES``).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

from fusion.errors import MalformedLogError
from fusion.formats.base import LogFormat, Notes
from fusion.formats.container import load, refuse
from fusion.formats.gpx import GpxFormat
from fusion.formats.nmea import NmeaFormat
from fusion.formats.ubx import UbxFormat
from fusion.formats.ucenter import UCenterFormat
from fusion.formats.versant_csv import VersantCsvFormat
from fusion.registry import Registry
from fusion.types import DriveLog, Progress, no_progress

HEAD_BYTES = 4 << 20
"""How much of a log the formats see to recognise it: text may stand before the first binary message."""

MAX_BYTES = 512 << 20
"""Unpacked size up to which a log is read unless the caller says otherwise: days of driving, and what it takes to
read it fits the memory of a small server."""

FORMATS: Registry[LogFormat] = Registry("log format")
# asked in this order: the loosest, CSV, comes last
FORMATS.add("ubx", UbxFormat())
FORMATS.add("u-center", UCenterFormat())
FORMATS.add("nmea", NmeaFormat())
FORMATS.add("gpx", GpxFormat())
FORMATS.add("csv", VersantCsvFormat())


def read_log(
    source: bytes | Path | BinaryIO, *, max_bytes: int = MAX_BYTES, progress: Progress = no_progress
) -> DriveLog:
    """Read a drive log of any registered format, recognised by content, gzipped or not.

    ``max_bytes`` bounds the unpacked size. Raises ``LogError``: ``UnknownFormatError`` if no format
    recognises the bytes, ``EmptyLogError`` if there is no usable position, ``MalformedLogError`` if it is
    too large or broken beyond skipping.
    """
    notes = Notes()
    data = load(source, max_bytes, notes, progress)
    head = data[:HEAD_BYTES]
    chosen = next((f for _, f in FORMATS.items() if f.recognises(head)), None)
    if chosen is None:
        supported = ", ".join(f"{f.description} ({', '.join(f.suffixes)})" for _, f in FORMATS.items())
        raise refuse(head, f"{supported}, each also gzipped")
    try:
        progress(f"read {chosen.name}", 0.0)
        log = chosen.read(data, progress)
    except MemoryError as error:
        raise MalformedLogError("The log needs more memory than there is. Split the recording.") from error
    return replace(
        log,
        skipped=notes.skipped + log.skipped,
        repaired=notes.repaired + log.repaired,
        warnings=(*notes.warnings, *log.warnings),
    )
