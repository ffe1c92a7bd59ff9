"""What a file that no format recognises looks like, so that the refusal can say it."""

from __future__ import annotations

import re

from fusion.errors import UnknownFormatError

_MAGIC: tuple[tuple[bytes, str], ...] = (
    (b"\x89PNG\r\n\x1a\n", "a PNG picture"),
    (b"\xff\xd8\xff", "a JPEG picture"),
    (b"GIF8", "a GIF picture"),
    (b"II*\x00", "a TIFF raster"),
    (b"MM\x00*", "a TIFF raster"),
    (b"%PDF", "a PDF document"),
    (b"PK\x03\x04", "a ZIP archive (also .kmz, .xlsx, .docx)"),
    (b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive"),
    (b"Rar!", "a RAR archive"),
    (b"BZh", "a bzip2 file"),
    (b"\xfd7zXZ\x00", "an xz file"),
    (b"\x28\xb5\x2f\xfd", "a Zstandard file"),
    (b"SQLite format 3\x00", "an SQLite database"),
    (b"PAR1", "a Parquet file"),
    (b"\x7fELF", "a program"),
    (b"MZ", "a Windows program"),
    (b"#ROSBAG", "a ROS bag"),
    (b"\xd4\xc3\xb2\xa1", "a network capture"),
)
_AT_OFFSET = (
    (8, b".FIT", "a Garmin FIT file, which is not read yet"),
    (4, b"ftyp", "an MP4 video"),
    (6, b"OSMHeader", "an OpenStreetMap extract"),
)
_XML = (
    (b"kml", "a KML file"),
    (b"osm", "an OpenStreetMap file"),
    (b"TrainingCenterDatabase", "a Garmin TCX file"),
)


def looks_like(head: bytes) -> str:
    """A noun phrase for what the bytes are, or an empty string."""
    for magic, what in _MAGIC:
        if head.startswith(magic):
            return what
    for offset, magic, what in _AT_OFFSET:
        if head[offset : offset + len(magic)] == magic:
            return what
    if b"RINEX VERSION" in head[:200]:
        return "a RINEX file, which is not read yet"
    return _text_kind(head[:4096])


def _text_kind(head: bytes) -> str:
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    if re.match(rb"(?i)<!doctype html|<html", text):
        return "an HTML page"
    if text.startswith(b"<"):
        root = re.search(rb"<(?:\w+:)?([A-Za-z]\w*)[\s>/]", text)
        known = dict(_XML).get(root.group(1)) if root else None
        return known or "an XML file, but not GPX"
    if re.match(rb"[\[{]\s*[\"\]}{\[\d]", text):
        return "a JSON file"
    if not text:
        return "a file of blanks"
    return ""


def refuse(head: bytes, supported: str) -> UnknownFormatError:
    """The error for bytes that no format recognises; ``supported`` lists what is read."""
    if not head:
        return UnknownFormatError(f"The file is empty. Upload a recorded drive: {supported}.", where="byte 0")
    kind = looks_like(head)
    if kind:
        say = f"The file looks like {kind}, not like a drive log."
    else:
        say = "The file is in no format that is known here."
    return UnknownFormatError(f"{say} Upload a recorded drive: {supported}.", where="byte 0")
