"""u-center text dumps: message listings as in the thesis's annex B.3, and the binary console's hexadecimal
lines.

A dump is turned back into the bytes that it shows (UBX messages and NMEA sentences) and read as such, so that
everything about clocks, time tags and validity is decided in one place.

A listing's NAV-PVT shows iTOW, nano, fixType / lon lat height hMSL hAcc vAcc / velN velE velD gSpeed
headMot sAcc headAcc / pDOP numSV, but no date: unless another message of the dump tells it, the log is
undated.
"""

from __future__ import annotations

import re
import struct
from bisect import bisect_right
from collections.abc import Callable, Iterator

from fusion.errors import EmptyLogError
from fusion.formats.base import Data, LogFormat, Notes
from fusion.formats.receiver.stream import read_stream
from fusion.formats.receiver.ubx_frames import frame
from fusion.messages import say
from fusion.types import DriveLog, Progress

_CLASSES = rb"(?:NAV|ESF|HNR|RXM|MON|CFG|TIM|ACK|INF|SEC|AID|LOG)"
_LISTED = re.compile(rb"(?m)^[ \t]*[0-9A-F]{2} [0-9A-F]{2} " + _CLASSES + rb"-[A-Z0-9]+\s+-\s")
_BODY = re.compile(rb"(?m)^[ \t]*(?:NAV-(?:PVT|ATT|EOE)|ESF-(?:RAW|MEAS))[ \t]+\d+")
_CONSOLE = re.compile(rb"(?m)^\d\d:\d\d:\d\d[^\r\n]{0,24}?[ \t](?:0000  [0-9A-F]{2} |[RL] (?:->|<-) )")

_HEADER = re.compile(
    r"\s*[0-9A-F]{2} [0-9A-F]{2} [A-Z]{3}-[A-Z0-9]+\s+-\s*((?:[0-9A-F]{2} ?){2}):\s*((?:[0-9A-F]{2} ?){2})"
)
_MESSAGE = re.compile(r"\s*((?:NAV|ESF)-[A-Z0-9]+)\s+(.*)")
_HEX_LINE = re.compile(
    r"(?:\d\d:\d\d:\d\d\S*(?: \[[^\]]*\])?)?\s*([0-9A-F]{4})  ((?:[0-9A-F]{2}(?: |$)){1,16})"
)
_PACKET = re.compile(r"\d\d:\d\d:\d\d\S*\s+[RL] (?:->|<-)\s")
_SENTENCE = re.compile(r"\$[A-Z][A-Z0-9]{3,9},[^\r\n$]*")
_SENSOR = re.compile(r"\s*(\d{1,2})\s+[A-Za-z][A-Za-z .-]*?\s+([0-9A-F]{6})\s+\S+(?:\s+(\d+))?\s*$")
_CALIBRATED = re.compile(r"\s*(\d+)\s+\S+\s+calibTtag")
_DATE = re.compile(r"(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})[ T,]+(\d{1,2}):(\d{2}):(\d{2})")
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?$")

Lines = list[str]
MAX_LINE = 500
"""Characters of a line that are looked at, beyond any real one: patterns must not backtrack over megabytes."""


def looks_like_dump(head: bytes) -> bool:
    """Whether the text has the marks of a u-center listing or console."""
    return any(pattern.search(head) for pattern in (_LISTED, _BODY, _CONSOLE))


class UCenterFormat(LogFormat):
    """Text that u-center (or a tool like it) made of a UBX file."""

    name = "u-center"
    description = "u-center text dump"
    suffixes = (".txt", ".log")
    altitude_advice = say("advice.ucenter_altitude")
    doppler_advice = say("advice.ucenter_doppler")

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``."""
        return b"\xb5\x62" not in head and looks_like_dump(head)

    def read(self, data: Data, progress: Progress) -> DriveLog:
        """See ``LogFormat``."""
        notes = Notes()
        stream, line_of = transcode(bytes(data).decode("latin-1"), notes)
        progress("read text", 1.0)
        if not stream:
            raise EmptyLogError(
                say("ucenter.names_only"),
                where=say("place.line", n=1),
            )
        return read_stream(
            stream, progress, self, notes=notes, place=lambda offset: say("place.line", n=line_of(offset))
        )


def transcode(text: str, notes: Notes) -> tuple[bytes, Callable[[int], int]]:
    """The byte stream that a dump shows, and a function from its offsets to line numbers of the dump."""
    out = bytearray()
    offsets: list[int] = []
    lines: list[int] = []
    bare = 0
    for number, piece in _pieces(text, notes):
        if piece is None:
            bare += 1
            continue
        offsets.append(len(out))
        lines.append(number)
        out += piece
    notes.skip("packet console lines (they name messages without their content)", bare)

    def line_of(offset: int) -> int:
        at = bisect_right(offsets, offset) - 1
        return lines[at] if at >= 0 else 1

    return bytes(out), line_of


def _pieces(text: str, notes: Notes) -> Iterator[tuple[int, bytes | None]]:
    """(line number, bytes) of each thing shown; None for a packet console line."""
    block: Lines = []
    block_line = 0
    broken = False
    for number, full_line in enumerate(text.splitlines(), 1):
        line = full_line[:MAX_LINE]
        header = _HEADER.match(line)
        starts = _MESSAGE.match(line)
        if header or starts or line.startswith("---"):
            if block:
                yield block_line, _encode(block, notes, block_line)
            block = [line] if starts and not broken else []
            block_line = number
            broken = header is not None and header.group(1).split() != header.group(2).split()
            if broken:
                example = "" if notes.warnings else say("place.line", n=number)
                notes.skip("listed messages with a wrong checksum", 1, example)
            continue
        shown = _console_line(line)
        if shown is not None:
            yield number, shown
        elif _PACKET.match(line):
            yield number, None
        elif block:
            block.append(line)
    if block:
        yield block_line, _encode(block, notes, block_line)


def _console_line(line: str) -> bytes | None:
    hexadecimal = _HEX_LINE.match(line)
    if hexadecimal:
        return bytes.fromhex(hexadecimal.group(2))
    sentence = _SENTENCE.search(line)
    return sentence.group().rstrip().encode("latin-1") + b"\r\n" if sentence else None


def _encode(block: Lines, notes: Notes, number: int) -> bytes:
    """The UBX message that a listing shows; empty where its kind is not read or its content is broken."""
    match = _MESSAGE.match(block[0])
    encoder = _ENCODERS.get(match.group(1)) if match else None
    if match is None or encoder is None:
        return b""
    try:
        return encoder([match.group(2), *block[1:]])
    except (ValueError, IndexError, struct.error):
        already_warned = any("listed messages that" in w for w in notes.warnings)
        notes.skip(
            "listed messages that cannot be read", 1, "" if already_warned else say("place.line", n=number)
        )
        return b""


def _numbers(block: Lines) -> list[float]:
    """The numbers of a block up to its first word."""
    out: list[float] = []
    for token in _DATE.sub(" ", " ".join(block)).split():
        if not _NUMBER.match(token):
            break
        out.append(float(token))
    return out


def _ints(block: Lines, at_least: int) -> list[int]:
    numbers = _numbers(block)
    if len(numbers) < at_least:
        raise ValueError("too few numbers")
    return [int(n) for n in numbers]


def _date(block: Lines) -> tuple[int, ...]:
    """Year .. second and the valid flags, zeros where the block shows no date."""
    match = _DATE.search(" ".join(block))
    return (*(int(g) for g in match.groups()), 7) if match else (0,) * 7


def _nav_pvt(block: Lines) -> bytes:
    n = _numbers(block)
    itow, nano, fix_type = (int(v) for v in n[:3])
    place, motion = [int(v) for v in n[3:9]], [int(v) for v in n[9:16]]
    if len(place) < 6 or len(motion) < 7:
        raise ValueError("too few numbers")
    pdop, satellites = [*n[16:18], 0.0, 0.0][:2]
    payload = struct.pack("<IH6B", itow, *_date(block))
    payload += struct.pack("<Ii4B", 0, nano, fix_type, int(fix_type in (2, 3, 4)), 0, int(satellites) & 255)
    payload += struct.pack("<4i2I", *place) + struct.pack("<5i2I", *motion)
    return frame(1, 7, payload + struct.pack("<HH4x", min(round(pdop * 100), 65535), 0) + bytes(8))


def _nav_att(block: Lines) -> bytes:
    itow, version, *angles = _ints(block, 8)
    return frame(1, 5, struct.pack("<IB3x3i3I", itow, version, *angles[:6]))


def _nav_eoe(block: Lines) -> bytes:
    return frame(1, 0x61, struct.pack("<I", _ints(block, 1)[0]))


def _nav_timeutc(block: Lines) -> bytes:
    date = _date(block)
    return frame(1, 0x21, struct.pack("<IIiH6B", _ints(block, 1)[0], 0, 0, *date)) if date[0] else b""


def _nav_timegps(block: Lines) -> bytes:
    itow, fraction, week, leap = _ints(block, 4)[:4]
    return frame(1, 0x20, struct.pack("<IihbBI", itow, fraction, week, leap, 7, 0))


def _sensor_words(block: Lines) -> list[tuple[int, int]]:
    """(data word with its type in the upper byte, time tag) of each listed reading."""
    matches = [m for m in map(_SENSOR.match, block[1:]) if m]
    if not matches:
        raise ValueError("no readings")
    return [(int(m.group(1)) << 24 | int(m.group(2), 16), int(m.group(3) or 0)) for m in matches]


def _esf_raw(block: Lines) -> bytes:
    words = _sensor_words(block)
    body = b"".join(struct.pack("<II", *pair) for pair in words)
    return frame(0x10, 3, struct.pack("<I", int(block[0].split()[0])) + body)


def _esf_meas(block: Lines) -> bytes:
    words = [word for word, _ in _sensor_words(block)]
    labels = dict(re.findall(r"(FLAGS|ID):\s*([0-9A-Fa-f]+)", block[0]))
    flags = int(labels.get("FLAGS", "0"), 16)
    tag = int(block[0].split()[0])
    tail = next((m.group(1) for m in map(_CALIBRATED.match, block) if m), str(tag))
    extra = struct.pack("<I", int(tail)) if flags & 8 else b""
    head = struct.pack("<IHH", tag, flags & 0xFFFF, int(labels.get("ID", "0"), 16) & 0xFFFF)
    return frame(0x10, 2, head + struct.pack(f"<{len(words)}I", *words) + extra)


_ENCODERS: dict[str, Callable[[Lines], bytes]] = {
    "NAV-PVT": _nav_pvt,
    "NAV-ATT": _nav_att,
    "NAV-EOE": _nav_eoe,
    "NAV-TIMEUTC": _nav_timeutc,
    "NAV-TIMEGPS": _nav_timegps,
    "ESF-RAW": _esf_raw,
    "ESF-MEAS": _esf_meas,
}
