"""Reading RINEX files: what takes compiled loops, and is loaded with the first file."""

from __future__ import annotations

import numpy as np

from fusion.errors import EmptyLogError
from fusion.formats.base import Data, Notes, build_log
from fusion.formats.rinex.compact import is_compact, unpack
from fusion.formats.rinex.header import Header, read_header
from fusion.formats.rinex.lines import Lines, split_lines
from fusion.formats.rinex.navigation import read_navigation
from fusion.formats.rinex.observations import read_observations
from fusion.signals import SYSTEMS, Navigation, RawGnss
from fusion.types import DriveLog, Floats, Progress

NAME, DESCRIPTION = "rinex", "RINEX file"
ADVICE = "Check that the receiver writes pseudoranges on L1, E1 or B1 and upload the recording again."


def read_file(data: Data, progress: Progress, navigation: Navigation) -> DriveLog:
    """A file of observations or of navigation data; ``navigation`` is what other files of the drive say."""
    notes = Notes()
    text = bytes(data)
    if is_compact(text[:200]):
        text = unpack(text, notes)
    lines = split_lines(text)
    header = read_header(lines)
    progress("read observations", 0.1)
    if header.is_observations:
        return _observations(lines, header, notes, progress, navigation)
    kepler_and_glonass = read_navigation(lines, header, notes)
    progress("read navigation data", 1.0)
    if not len(kepler_and_glonass):
        raise EmptyLogError(
            "This RINEX navigation file holds no usable ephemeris of GPS, GLONASS, Galileo, BeiDou or QZSS. "
            "Upload another one of the same day."
        )
    return build_log(NAME, DESCRIPTION, notes, {}, raw=RawGnss(navigation=kepler_and_glonass), part=True)


def _observations(
    lines: Lines, header: Header, notes: Notes, progress: Progress, navigation: Navigation
) -> DriveLog:
    channels = dict(zip(navigation.glonass.number.tolist(), navigation.glonass.channel.tolist(), strict=True))
    signals, outages_s = read_observations(lines, header, notes, progress, channels)
    if not len(signals):
        letters = ", ".join(s for s in header.types if s in SYSTEMS and s.strip())
        why = f" The first fault: {notes.first_offender}." if notes.first_offender else ""
        raise EmptyLogError(
            "This RINEX file holds no usable pseudorange on the L1 band"
            f"{f' (its header names systems {letters})' if letters else ''}.{why} {ADVICE}"
        )
    progress("read observations", 1.0)
    return build_log(
        NAME,
        DESCRIPTION,
        notes,
        {},
        raw=RawGnss(signals),
        outages_s=_within(outages_s, signals.time_s),
    )


def _within(times_s: Floats, epochs_s: Floats) -> Floats:
    return times_s[(times_s > epochs_s[0]) & (times_s <= epochs_s[-1])] if len(epochs_s) else np.empty(0)
