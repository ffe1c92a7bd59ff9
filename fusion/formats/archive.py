"""The files in a zip, within bounds. Nothing is written to disk; names are for messages only.

Knows no format of logs.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import PurePosixPath

from fusion.errors import MalformedLogError
from fusion.formats.base import Notes
from fusion.formats.container import BOMB_FREE_BYTES, BOMB_RATIO, CHUNK_BYTES

ZIP_MAGIC = b"PK\x03\x04"
MOST_MEMBERS = 200
"""A drive has a handful of files; hourly navigation files of some days are the most that belong together."""
_JUNK = re.compile(r"(^|/)(__MACOSX/|\._|\.DS_Store$|Thumbs\.db$|desktop\.ini$)")
_OTHER_DOCUMENTS = ("[Content_Types].xml", "doc.kml", "META-INF/MANIFEST.MF", "mimetype")
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
            if any(i.filename in _OTHER_DOCUMENTS for i in infos):
                return []
            if len(infos) > MOST_MEMBERS:
                raise MalformedLogError(
                    f"The zip holds {len(infos)} files; {MOST_MEMBERS} are read at most. Upload those of one drive."
                )
            return list(_unpacked(archive, infos, max_bytes, notes))
    except (zipfile.BadZipFile, NotImplementedError, ValueError, OSError, EOFError):
        return []


def _unpacked(
    archive: zipfile.ZipFile, infos: list[zipfile.ZipInfo], max_bytes: int, notes: Notes
) -> Iterator[Member]:
    bytes_left = max_bytes
    for info in infos:
        name = shown_name(info.filename)
        if info.flag_bits & 1:
            notes.warn(f"{name} in the zip is encrypted and was left out.")
            continue
        if info.compress_type not in _READ:
            notes.warn(f"{name} in the zip is packed in an unusual way and was left out. Pack it by Deflate.")
            continue
        content = _content(archive, info, bytes_left, notes)
        bytes_left -= len(content)
        if content:
            yield Member(name, content)


def _content(archive: zipfile.ZipFile, info: zipfile.ZipInfo, max_bytes: int, notes: Notes) -> bytes:
    """A member, unpacked in pieces and not believed in what it says of its size; up to damage, where there is any."""
    out = bytearray()
    try:
        with archive.open(info) as stream:
            while piece := stream.read(CHUNK_BYTES):
                out += piece
                bomb = len(out) > BOMB_FREE_BYTES and len(out) > BOMB_RATIO * max(info.compress_size, 1)
                if bomb or len(out) > max_bytes:
                    raise MalformedLogError(
                        f"This zip looks like a zip bomb: {shown_name(info.filename)} brings what it unpacks to over "
                        f"{max_bytes if not bomb else len(out)} bytes. Upload files that unpack to less."
                    )
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, NotImplementedError):
        notes.repaired["damaged files in the zip"] += 1
        notes.warn(
            f"{shown_name(info.filename)} in the zip is damaged: what comes before the damage is used."
        )
    return bytes(out)
