"""Compact RINEX (Hatanaka), versions 1.0 and 3.0: unpacked by the original program, which runs as its own process.

So that no input, however made, can stop this one: the program has limited time, and what it writes is limited too.
"""

from __future__ import annotations

import subprocess
import threading
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

import hatanaka.bin

from fusion.errors import MalformedLogError
from fusion.formats.base import Notes

LONGEST_S = 60.0
"""A day at 1 Hz takes some seconds."""
MOST_GROWTH = 100
FREE_BYTES = 16 << 20
"""Files unpack to 4 to 12 times their size; more than ``MOST_GROWTH`` beyond this many bytes is an attack."""
_PROGRAM = Path(hatanaka.bin.__path__[0]) / "crx2rnx"
_CHUNK_BYTES = 1 << 20
_FINE = 0


def is_compact(head: bytes) -> bool:
    """Whether the first line says so, and is a line of text: a binary log may hold any bytes."""
    line = head[:100].split(b"\n", 1)[0].rstrip(b"\r")
    return b"CRINEX VERS" in line and line.isascii() and line.decode().isprintable()


def unpack(data: bytes, notes: Notes) -> bytes:
    """The RINEX file; raises ``MalformedLogError``. Of one that is damaged, what comes before is given."""
    with TemporaryFile() as source:
        source.write(data)
        source.seek(0)
        out, code = _run(source, max(FREE_BYTES, MOST_GROWTH * len(data)))
    if not out:
        raise MalformedLogError(
            "This compact RINEX file cannot be unpacked: it is damaged from its start. Upload it as plain RINEX.",
            where="line 1",
        )
    if code != _FINE:
        notes.repaired["compact RINEX damaged"] += 1
        notes.warn("The compact RINEX file is damaged or ends early: some of its epochs are missing.")
    return out


def _run(source: IO[bytes], most_bytes: int) -> tuple[bytes, int]:
    """What the program writes, and the code that it ends with."""
    with subprocess.Popen(  # noqa: S603 - a program of a library, and what it reads is no argument
        [str(_PROGRAM), "-", "-s"], stdin=source, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        late = threading.Timer(LONGEST_S, process.kill)
        late.start()
        try:
            return _collect(process, most_bytes), process.wait()
        finally:
            late.cancel()
            process.kill()


def _collect(process: subprocess.Popen[bytes], most_bytes: int) -> bytes:
    out = bytearray()
    while process.stdout is not None and (piece := process.stdout.read(_CHUNK_BYTES)):
        out += piece
        if len(out) > most_bytes:
            raise MalformedLogError(
                f"This compact RINEX file unpacks to over {len(out) >> 20} MiB, which no recording does. "
                "Upload it as plain RINEX."
            )
    return bytes(out)
