"""Reading RINEX files: what takes compiled loops, and is loaded with the first file.

Compact RINEX (Hatanaka), versions 1.0 and 3.0, is unpacked by the original program, which runs as its own process: no
input, however made, can stop this one. The program has limited time, and what it writes is limited too.
"""

from __future__ import annotations

import subprocess
import threading
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

import hatanaka.bin
import numpy as np

from fusion.errors import EmptyLogError, MalformedLogError
from fusion.formats.base import Data, LogFormat, Notes, build_log
from fusion.formats.rinex.header import Header, read_header
from fusion.formats.rinex.lines import Lines, split_lines
from fusion.formats.rinex.navigation import read_navigation
from fusion.formats.rinex.observations import read_observations
from fusion.frames import local_axes
from fusion.messages import say
from fusion.signals import SYSTEMS, Navigation, RawGnss
from fusion.types import DriveLog, Floats, Progress

ADVICE = say("advice.rinex")
LEAST_RADIUS_M = 6.0e6
"""No place on earth is nearer to its middle; 0 is written for one that is not known."""


def read_file(
    data: Data, progress: Progress, navigation: Navigation, kind: LogFormat, *, compact: bool
) -> DriveLog:
    """A file of observations or of navigation data; ``navigation`` is what other files of the drive say."""
    notes = Notes()
    text = bytes(data)
    if compact:
        text = unpack(text, notes)
    lines = split_lines(text)
    header = read_header(lines)
    progress("read observations", 0.1)
    if header.is_observations:
        return _observations(lines, header, notes, progress, navigation, kind)
    kepler_and_glonass = read_navigation(lines, header, notes)
    progress("read navigation data", 1.0)
    if not len(kepler_and_glonass):
        raise EmptyLogError(say("rinex.no_ephemeris"))
    return build_log(kind, notes, {}, raw=RawGnss(navigation=kepler_and_glonass), part=True)


def _observations(
    lines: Lines, header: Header, notes: Notes, progress: Progress, navigation: Navigation, kind: LogFormat
) -> DriveLog:
    channels = dict(zip(navigation.glonass.number.tolist(), navigation.glonass.channel.tolist(), strict=True))
    signals, outages_s = read_observations(lines, header, notes, progress, channels)
    if not len(signals):
        letters = ", ".join(s for s in header.types if s in SYSTEMS and s.strip())
        why = say("log.first_fault", fault=notes.first_offender) if notes.first_offender else ""
        raise EmptyLogError(
            say(
                "rinex.no_pseudorange",
                systems=say("rinex.systems", letters=letters) if letters else "",
                why=why,
                advice=ADVICE,
            )
        )
    progress("read observations", 1.0)
    epochs_s = signals.time_s
    outages_s = outages_s[(outages_s > epochs_s[0]) & (outages_s <= epochs_s[-1])]
    return build_log(kind, notes, {}, raw=RawGnss(signals, place_m=_place(header)), outages_s=outages_s)


def _place(header: Header) -> Floats | None:
    """Where the antenna stood by the header; None where it does not say, or says 0."""
    marker = np.array(header.place_m or np.zeros(3))
    if not np.linalg.norm(marker) > LEAST_RADIUS_M:
        return None
    up, east, north = header.antenna_m or (0.0, 0.0, 0.0)
    return np.asarray(marker + local_axes(marker[None])[0].T @ [east, north, up])


LONGEST_S = 60.0
"""A day at 1 Hz takes some seconds."""
MOST_GROWTH = 100
FREE_BYTES = 16 << 20
"""Files unpack to 4 to 12 times their size; more than ``MOST_GROWTH`` beyond this many bytes is an attack."""
_PROGRAM = Path(hatanaka.bin.__path__[0]) / "crx2rnx"
_CHUNK_BYTES = 1 << 20
_FINE = 0


def unpack(data: bytes, notes: Notes) -> bytes:
    """The RINEX file; raises ``MalformedLogError``. Of one that is damaged, what comes before is given."""
    with TemporaryFile() as source:
        source.write(data)
        source.seek(0)
        out, code = _run(source, max(FREE_BYTES, MOST_GROWTH * len(data)))
    if not out:
        raise MalformedLogError(
            say("rinex.compact_damaged"),
            where="line 1",
        )
    if code != _FINE:
        notes.repaired["compact RINEX damaged"] += 1
        notes.warn(say("rinex.compact_ends_early"))
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
            raise MalformedLogError(say("rinex.compact_bomb", size_mib=len(out) >> 20))
    return bytes(out)
