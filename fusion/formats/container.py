"""The bytes of a log file, unpacked from gzip or zip within limits; and what a file that is no log looks like.

Knows no log format, only other kinds of files that people upload by mistake. Nothing is written to disk; names of files
in a zip are for messages only.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from fusion.errors import LogError, MalformedLogError, UnknownFormatError
from fusion.formats.base import Notes
from fusion.messages import say
from fusion.types import Progress

CHUNK_BYTES = 1 << 20
BOMB_RATIO = 200
"""Logs compress 3 to 30 times; more than this beyond ``BOMB_FREE_BYTES`` is an attack or an accident."""
BOMB_FREE_BYTES = 64 << 20
GZIP_MAGIC = b"\x1f\x8b"
TRUNCATED = "gzip truncated: read to the end"

_MAGIC: tuple[tuple[int, bytes, str], ...] = (
    (0, b"\x89PNG\r\n\x1a\n", "a PNG picture"),
    (0, b"\xff\xd8\xff", "a JPEG picture"),
    (0, b"GIF8", "a GIF picture"),
    (0, b"II*\x00", "a TIFF raster"),
    (0, b"MM\x00*", "a TIFF raster"),
    (0, b"%PDF", "a PDF document"),
    (0, b"PK\x03\x04", "a ZIP archive (also .kmz, .xlsx, .docx)"),
    (0, b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive"),
    (0, b"Rar!", "a RAR archive"),
    (0, b"BZh", "a bzip2 file"),
    (0, b"\x1f\x9d", "a file packed by compress (.Z)"),
    (0, b"\xfd7zXZ\x00", "an xz file"),
    (0, b"\x28\xb5\x2f\xfd", "a Zstandard file"),
    (0, b"SQLite format 3\x00", "an SQLite database"),
    (0, b"PAR1", "a Parquet file"),
    (0, b"\x7fELF", "a program"),
    (0, b"MZ", "a Windows program"),
    (0, b"#ROSBAG", "a ROS bag"),
    (0, b"\xd4\xc3\xb2\xa1", "a network capture"),
    (4, b"ftyp", "an MP4 video"),
    (6, b"OSMHeader", "an OpenStreetMap extract"),
)
"""By the offset of what tells them."""
_GOOGLE = re.compile(
    rb"\{\s*\"(locations|timelineObjects|semanticSegments|rawSignals)\"\s*:|\[\s*\{\s*\"(endTime|startTime)\"\s*:"
)
"""Records.json, the months of its semantic history, Timeline.json of Android and of iOS."""
_XML = {b"kml": "a KML file", b"osm": "an OpenStreetMap file"}


def load(source: bytes | Path | BinaryIO, max_bytes: int, notes: Notes, progress: Progress) -> bytes:
    """Return the log's bytes, unpacked from at most two layers of gzip; raises ``MalformedLogError``."""
    data = _read(source, max_bytes)
    for _layer in range(2):
        if data[:2] != GZIP_MAGIC:
            return data
        packed = len(data)
        data = gunzip(data, max_bytes, notes, progress)
        if not data and notes.repaired[TRUNCATED]:
            raise MalformedLogError(say("gzip.beginning_only", size=_size(packed)))
    if data[:2] == GZIP_MAGIC:
        raise MalformedLogError(say("gzip.nested"))
    return data


def _read(source: bytes | Path | BinaryIO, max_bytes: int) -> bytes:
    if isinstance(source, bytes | bytearray | memoryview):
        data = bytes(source)
    else:
        try:
            if isinstance(source, Path):
                with source.open("rb") as stream:
                    data = _all_of(stream, max_bytes)
            else:
                data = _all_of(source, max_bytes)
        except OSError as error:
            raise LogError(say("log.unreadable", reason=error.strerror or error)) from error
    if len(data) > max_bytes:
        raise MalformedLogError(say("log.too_large", size=_size(max_bytes)))
    return data


def _all_of(stream: BinaryIO, max_bytes: int) -> bytes:
    """What is there, or somewhat more than ``max_bytes`` of it: asked for so many at once Python makes room for all."""
    out = BytesIO()
    while out.tell() <= max_bytes and (piece := stream.read(CHUNK_BYTES)):
        out.write(piece)
    return out.getvalue()


def gunzip(data: bytes, max_bytes: int, notes: Notes, progress: Progress) -> bytes:
    """Unpack gzip (several members too) in pieces, so that a bomb is refused after a small part of it.

    A truncated or damaged stream gives what was unpacked before the damage, with a warning.
    """
    out = BytesIO()  # its getvalue() makes no second copy
    view = memoryview(data)
    used = 0
    while used < len(data) and (used == 0 or data[used : used + 2] == GZIP_MAGIC):
        member = zlib.decompressobj(31)
        feed: bytes | memoryview = b""
        while not member.eof and (feed or used < len(data)):
            if not feed:
                feed = view[used : used + CHUNK_BYTES]
                used += len(feed)
                progress("unpack", used / len(data))
            before = member.copy()
            try:
                out.write(member.decompress(feed, CHUNK_BYTES))
            except zlib.error as error:
                out.write(up_to_damage(before, feed))
                _say_damaged(out.tell(), error, notes)
                return out.getvalue()
            feed = member.unconsumed_tail
            _refuse_bomb(out.tell(), used - len(feed), max_bytes)
        used -= len(member.unused_data)
        if not member.eof:
            notes.repaired[TRUNCATED] += 1
            notes.warn(say("gzip.ends_early", n=out.tell()))
    return out.getvalue()


def up_to_damage(member: zlib._Decompress, feed: bytes | memoryview) -> bytes:
    """What a piece of gzip with damage in it unpacks to before: zlib withholds it when fed the whole piece.

    At most ``CHUNK_BYTES``, since the whole piece was to give no more in one step.
    """
    out = bytearray()
    try:
        for at in range(len(feed)):
            out += member.decompress(feed[at : at + 1])
            if len(out) >= CHUNK_BYTES:
                break
    except zlib.error:
        pass
    return bytes(out)


def _say_damaged(unpacked: int, error: zlib.error, notes: Notes) -> None:
    if not unpacked:
        raise MalformedLogError(say("gzip.damaged", error=error)) from error
    if "incorrect data check" in str(error) or "incorrect length check" in str(error):
        notes.repaired["gzip checksum wrong: read all the same"] += 1
        notes.warn(say("gzip.checksum", unpacked=unpacked))
        return
    notes.repaired["gzip damaged: read up to the damage"] += 1
    notes.warn(say("gzip.damaged_after", unpacked=unpacked))


def _refuse_bomb(unpacked: int, packed: int, max_bytes: int) -> None:
    if unpacked > min(max_bytes, most_unpacked(packed)):
        raise MalformedLogError(say("gzip.bomb", size=_size(packed), unpacked=_size(unpacked)))


def most_unpacked(packed_bytes: int) -> int:
    """What so many bytes unpack to, in bytes, if they are no bomb."""
    return max(BOMB_FREE_BYTES, BOMB_RATIO * max(packed_bytes, 1))


def _size(count: int) -> str:
    for unit, size in (("GiB", 1 << 30), ("MiB", 1 << 20), ("KiB", 1 << 10)):
        if count >= size:
            return f"{count / size:.3g} {unit}"
    return f"{count} bytes"


def refuse(head: bytes, supported: str) -> UnknownFormatError:
    """The error for bytes that no format recognises; ``supported`` lists what is read."""
    kind = looks_like(head)
    if not head:
        what = say("log.is_empty")
    elif kind:
        what = say("log.looks_like", kind=kind)
    else:
        what = say("log.no_format")
    return UnknownFormatError(
        say("log.unknown", what=what, supported=supported), where=say("place.byte", n=0)
    )


def looks_like(head: bytes) -> str:
    """A noun phrase for what the bytes are, or an empty string."""
    for offset, magic, what in _MAGIC:
        if head.startswith(magic, offset):
            return what
    if re.match(rb"#[a-d][PV]\d{4} ", head):
        return "an SP3 file of precise orbits, which no drive needs"
    return _text_kind(head[:4096])


def _text_kind(head: bytes) -> str:
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    if re.match(rb"(?i)<!doctype html|<html", text):
        return "an HTML page"
    if text.startswith(b"<"):
        root = re.search(rb"<(?:\w+:)?([A-Za-z]\w*)[\s>/]", text)
        document = _XML.get(root.group(1)) if root else None
        return document or "an XML file, but neither GPX nor TCX"
    if _GOOGLE.match(text):
        return "Google's location history, which has a place every few minutes"
    if re.match(rb"[\[{]\s*[\"\]}{\[\d]", text):
        return "a JSON file"
    if not text:
        return "a file of blanks"
    return ""


ZIP_MAGIC = b"PK\x03\x04"
MOST_MEMBERS = 200
"""A drive has a handful of files; hourly navigation files of some days are the most that belong together."""
_JUNK = re.compile(r"(^|/)(__MACOSX/|\._|\.DS_Store$|Thumbs\.db$|desktop\.ini$)")
OTHER_DOCUMENTS = ("[Content_Types].xml", "doc.kml", "META-INF/MANIFEST.MF", "mimetype")
_ENCRYPTED = 0x1
_READ = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}
_LONGEST_NAME = 60


@dataclass(frozen=True)
class Member:
    """One file: ``name`` is fit to be shown."""

    name: str
    data: bytes


def is_zip(head: bytes) -> bool:
    """Whether the bytes begin as a zip does."""
    return head.startswith(ZIP_MAGIC)


def shown_name(name: str) -> str:
    """The last part of a path, printable and not long."""
    last = PurePosixPath(name.replace("\\", "/")).name or "unnamed"
    return "".join(c if c.isprintable() else "?" for c in last)[:_LONGEST_NAME]


def members(data: bytes, max_bytes: int, notes: Notes) -> list[Member]:
    """The files in a zip, without what systems add of their own; empty if it is no zip, or another kind of document.

    Members that cannot be unpacked are left out with a warning. Raises ``MalformedLogError`` for more members or bytes
    than are read, and for bombs.
    """
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            infos = [i for i in archive.infolist() if not i.is_dir() and not _JUNK.search(i.filename)]
            if any(i.filename in OTHER_DOCUMENTS for i in infos):
                return []
            if len(infos) > MOST_MEMBERS:
                raise MalformedLogError(say("zip.too_many", n=len(infos), most=MOST_MEMBERS))
            return list(_unpacked(archive, infos, max_bytes, notes))
    except (zipfile.BadZipFile, NotImplementedError, ValueError, OSError, EOFError):
        return []


def _unpacked(
    archive: zipfile.ZipFile, infos: list[zipfile.ZipInfo], max_bytes: int, notes: Notes
) -> Iterator[Member]:
    bytes_left = max_bytes
    for info in infos:
        name = shown_name(info.filename)
        if why := why_unread(info):
            notes.warn(why)
            continue
        content = _content(archive, info, bytes_left, notes)
        bytes_left -= len(content)
        if content:
            yield Member(name, content)


def why_unread(info: zipfile.ZipInfo) -> str:
    """Why a file in a zip is not read, as a sentence; empty where it is."""
    if info.flag_bits & _ENCRYPTED:
        return say("zip.encrypted", name=shown_name(info.filename))
    return "" if info.compress_type in _READ else say("zip.unusual", name=shown_name(info.filename))


def _content(archive: zipfile.ZipFile, info: zipfile.ZipInfo, max_bytes: int, notes: Notes) -> bytes:
    """A member, unpacked in pieces and not believed in what it says of its size; up to damage, where there is any."""
    out = bytearray()
    try:
        with archive.open(info) as stream:
            while piece := stream.read(CHUNK_BYTES):
                out += piece
                bomb = len(out) > most_unpacked(info.compress_size)
                if bomb or len(out) > max_bytes:
                    raise MalformedLogError(
                        say(
                            "zip.bomb",
                            name=shown_name(info.filename),
                            size=max_bytes if not bomb else len(out),
                        )
                    )
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, NotImplementedError):
        notes.repaired["damaged files in the zip"] += 1
        notes.warn(say("zip.damaged", name=shown_name(info.filename)))
    return bytes(out)
