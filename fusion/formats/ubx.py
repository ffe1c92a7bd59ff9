"""The UBX format: files of u-blox receivers, with or without NMEA sentences between."""

from __future__ import annotations

from fusion.formats.base import Data, LogFormat
from fusion.formats.receiver.stream import read_stream
from fusion.formats.receiver.ubx_frames import SYNC, find_frames
from fusion.messages import say
from fusion.types import DriveLog, Progress


class UbxFormat(LogFormat):
    """Recognised by one intact message anywhere in the head, or by sync bytes at the very start."""

    name = "ubx"
    description = "UBX file"
    suffixes = (".ubx",)
    altitude_advice = say("advice.ubx_altitude")
    doppler_advice = say("advice.ubx_doppler")

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``."""
        return head.startswith(SYNC) or (SYNC in head and len(find_frames(head)) > 0)

    def read(self, data: Data, progress: Progress) -> DriveLog:
        """See ``LogFormat``."""
        return read_stream(data, progress, self)
