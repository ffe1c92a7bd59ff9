"""The RINEX format: files of observations, plain or compact, and of navigation data that belong to them."""

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

ADVICE = "Check that the receiver writes pseudoranges on L1, E1 or B1 and upload the recording again."
_LABEL = b"RINEX VERSION / TYPE"
_FIRST_LINE_BYTES = 200


class RinexFormat:
    """Recognised by the label of the first line."""

    name = "rinex"
    description = "RINEX file"
    suffixes = (".rnx", ".crx", ".obs", ".nav", ".24o", ".24n")

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``."""
        return is_compact(head) or _LABEL in _first_line(head)

    def comes_first(self, head: bytes) -> bool:
        """See ``PartFormat``: navigation data name the channels of GLONASS satellites, without which no Doppler."""
        line = _first_line(head)
        return not is_compact(head) and line[20:21] not in (b"O", b"o")

    def read(self, data: Data, progress: Progress) -> DriveLog:
        """See ``LogFormat``; raises ``EmptyLogError`` for navigation data alone."""
        log = self.read_part(data, progress, Navigation())
        if log.raw is not None and not len(log.raw.signals):
            raise EmptyLogError(
                "This RINEX file holds navigation data and no measurements: it belongs to a file of observations. "
                "Upload both together, as several files or in one zip."
            )
        return log

    def read_part(self, data: Data, progress: Progress, navigation: Navigation) -> DriveLog:
        """See ``PartFormat``."""
        notes = Notes()
        text = bytes(data)
        if is_compact(text[:_FIRST_LINE_BYTES]):
            text = unpack(text, notes)
        lines = split_lines(text)
        header = read_header(lines)
        progress("read observations", 0.1)
        if header.is_observations:
            return self._observations(lines, header, notes, progress, navigation)
        found = read_navigation(lines, header, notes)
        progress("read navigation data", 1.0)
        if not len(found):
            raise EmptyLogError(
                "This RINEX navigation file holds no usable ephemeris of GPS, GLONASS, Galileo, BeiDou or QZSS. "
                "Upload another one of the same day."
            )
        return build_log(self.name, self.description, notes, {}, raw=RawGnss(navigation=found), part=True)

    def _observations(
        self, lines: Lines, header: Header, notes: Notes, progress: Progress, navigation: Navigation
    ) -> DriveLog:
        channels = dict(
            zip(navigation.glonass.number.tolist(), navigation.glonass.channel.tolist(), strict=True)
        )
        signals, gaps_s = read_observations(lines, header, notes, progress, channels)
        if not len(signals):
            letters = ", ".join(s for s in header.types if s in SYSTEMS and s.strip())
            why = f" The first fault: {notes.first_offender}." if notes.first_offender else ""
            raise EmptyLogError(
                "This RINEX file holds no usable pseudorange on the L1 band"
                f"{f' (its header names systems {letters})' if letters else ''}.{why} {ADVICE}"
            )
        progress("read observations", 1.0)
        return build_log(
            self.name,
            self.description,
            notes,
            {},
            raw=RawGnss(signals),
            gaps_s=_within(gaps_s, signals.time_s),
        )


def _within(times_s: Floats, epochs_s: Floats) -> Floats:
    return times_s[(times_s > epochs_s[0]) & (times_s <= epochs_s[-1])] if len(epochs_s) else np.empty(0)


def _first_line(head: bytes) -> bytes:
    return head[:_FIRST_LINE_BYTES].split(b"\n", 1)[0]
