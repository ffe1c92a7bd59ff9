"""The RINEX format: files of observations, plain or compact, and of navigation data that belong to them."""

from __future__ import annotations

from fusion.errors import EmptyLogError
from fusion.formats.base import Data, LogFormat
from fusion.formats.glance import Ends, Glance
from fusion.formats.rinex.glance import glance_of
from fusion.messages import say
from fusion.signals import Navigation
from fusion.types import DriveLog, Progress

_LABEL = b"RINEX VERSION / TYPE"
_FIRST_LINE_BYTES = 200


class RinexFormat(LogFormat):
    """Recognised by the label of the first line."""

    name = "rinex"
    description = "RINEX file"
    suffixes = (".rnx", ".crx", ".obs", ".nav", ".24o", ".24n")
    altitude_advice = say("advice.rinex_altitude")
    doppler_advice = say("advice.rinex_doppler")

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``."""
        line = _first_line(head).rstrip(b"\r")
        of_text = line.isascii() and line.decode().isprintable()  # a binary log may hold any bytes
        return is_compact(head) or (_LABEL in line and of_text)

    def glance(self, ends: Ends) -> Glance:
        """See ``LogFormat``."""
        return glance_of(ends, observations=not self.comes_first(ends.head))

    def comes_first(self, head: bytes) -> bool:
        """See ``LogFormat``: navigation data name the channels of GLONASS satellites, without which no Doppler."""
        line = _first_line(head)
        return not is_compact(head) and line[20:21] not in (b"O", b"o")

    def read(self, data: Data, progress: Progress) -> DriveLog:
        """See ``LogFormat``; raises ``EmptyLogError`` for navigation data alone."""
        log = self.read_part(data, progress, Navigation())
        if log.raw is not None and not len(log.raw.signals):
            raise EmptyLogError(say("rinex.navigation_only"))
        return log

    def read_part(self, data: Data, progress: Progress, navigation: Navigation) -> DriveLog:
        """See ``LogFormat``."""
        # The service, which only needs to know formats, shall not load a compiler for this one.
        from fusion.formats.rinex.reading import read_file  # noqa: PLC0415

        return read_file(data, progress, navigation, self, compact=is_compact(bytes(data[:200])))


def _first_line(head: bytes) -> bytes:
    return head[:_FIRST_LINE_BYTES].split(b"\n", 1)[0]


def is_compact(head: bytes) -> bool:
    """Whether the first line says so, and is a line of text: a binary log may hold any bytes."""
    line = head[:100].split(b"\n", 1)[0].rstrip(b"\r")
    return b"CRINEX VERS" in line and line.isascii() and line.decode().isprintable()
