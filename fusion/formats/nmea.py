"""The NMEA 0183 format: one sentence a line, perhaps with the recorder's time stamp before it."""

from __future__ import annotations

from fusion.formats.base import Data, LogFormat
from fusion.formats.receiver.nmea_sentences import looks_like_nmea
from fusion.formats.receiver.stream import read_stream
from fusion.formats.ubx import UbxFormat
from fusion.formats.ucenter import looks_like_dump
from fusion.messages import say
from fusion.types import DriveLog, Progress


class NmeaFormat(LogFormat):
    """Recognised by a sentence; UBX files and u-center dumps may hold sentences too and come first."""

    name = "nmea"
    description = "NMEA log"
    suffixes = (".nmea", ".txt", ".log")
    altitude_advice = say("advice.nmea_altitude")
    doppler_advice = say("advice.nmea_doppler")

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``."""
        return looks_like_nmea(head) and not UbxFormat().recognises(head) and not looks_like_dump(head)

    def read(self, data: Data, progress: Progress) -> DriveLog:
        """See ``LogFormat``."""
        return read_stream(data, progress, self)
