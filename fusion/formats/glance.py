"""What the beginning and the end of a file tell of the drive in it, without reading all of it. Knows no format."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fusion.types import DriveLog, Floats

HEAD_BYTES = 4 << 20
"""How much of a file's beginning is held: formats are recognised by it."""
EXCERPT_BYTES = 64 << 10
"""Of each end of a long file so much is read."""
NO_DATE = "no date: placed in January 1980"
"""Counted under ``repaired`` of logs that name no date."""
LONGEST_S = 30 * 86400.0
"""Times farther from most others are a receiver's before it knows the date."""


@dataclass(frozen=True)
class Ends:
    """A file of ``size`` bytes, unpacked: the ``head`` of it, all where it is short, and the ``tail`` behind that."""

    head: bytes
    tail: bytes
    size: int
    excerpt_bytes: int = EXCERPT_BYTES

    @classmethod
    def of(cls, data: bytes, excerpt_bytes: int = EXCERPT_BYTES) -> Ends:
        """Of a file at hand."""
        return cls(data[:HEAD_BYTES], data[HEAD_BYTES:][-excerpt_bytes:], len(data), excerpt_bytes)

    @property
    def is_short(self) -> bool:
        """Whether start and end are all of it."""
        return self.size <= 2 * self.excerpt_bytes

    @property
    def start(self) -> bytes:
        """The first ``excerpt_bytes``."""
        return self.head[: self.excerpt_bytes]

    @property
    def end(self) -> bytes:
        """The last ``excerpt_bytes``, none of those at the start."""
        behind = self.head[self.excerpt_bytes :] if len(self.tail) < self.excerpt_bytes else b""
        return (behind + self.tail)[-self.excerpt_bytes :]


def along_m(places: Floats) -> float:
    """Metres along places (n, 2), latitude and longitude in degrees; NaN of fewer than two."""
    if len(places) < 2:
        return float("nan")
    lat, lon = places[:, 0], np.remainder(np.diff(places[:, 1]) + 180.0, 360.0) - 180.0
    return float(np.hypot(np.diff(lat), lon * np.cos(np.radians(lat[1:]))).sum() * 111_320.0)


@dataclass(frozen=True)
class Told:
    """What a file says of its drive in so many words: the sport as its program calls it, empty where it does not, and
    how many metres, NaN where that is not known."""

    sport: str = ""
    distance_m: float = np.nan


@dataclass(frozen=True, eq=False)
class Glance:
    """What a file holds, and from when to when: its positions and raw measurements, of a file without any its sensors.
    Unix seconds, NaN where that is not known.

    ``track`` (n, 3) are times and positions near its ends: seconds, latitude and longitude in degrees.
    ``is_of_several``: its recorder writes one recording into several files. ``is_unread``: its ends could not be read.
    """

    source_format: str = ""
    first_s: float = np.nan
    last_s: float = np.nan
    track: Floats = field(default_factory=lambda: np.empty((0, 3)))
    has_signals: bool = False
    has_navigation: bool = False
    is_of_several: bool = False
    is_unread: bool = False

    @classmethod
    def of(cls, log: DriveLog, *, is_of_several: bool = False) -> Glance:
        """Of a log, or of an excerpt of one."""
        raw = log.raw
        sensors = [*log.tables().values(), *log.device.tables().values()]
        where = [log.fix.time_s] + ([] if raw is None else [raw.signals.time_s])
        # Sensors may go on for an hour after the drive.
        time_s = np.concatenate(where if any(map(len, where)) else [table.time_s for table in sensors])
        near = np.abs(time_s - np.median(time_s)) < LONGEST_S if len(time_s) else np.zeros(0, bool)
        dated = bool(near.any()) and not log.repaired[NO_DATE]
        fix = log.fix
        return cls(
            log.source_format,
            float(time_s[near].min()) if dated else np.nan,
            float(time_s[near].max()) if dated else np.nan,
            np.column_stack([fix.time_s, fix.lat_deg, fix.lon_deg]),
            raw is not None and len(raw.signals) > 0,
            raw is not None and len(raw.navigation) > 0,
            is_of_several,
        )

    @property
    def has_positions(self) -> bool:
        """Whether it says where its drive went."""
        return len(self.track) > 0

    @property
    def makes_a_drive(self) -> bool:
        """Whether it has positions, or what they are computed of."""
        return self.has_positions or self.has_signals

    @property
    def is_known(self) -> bool:
        """Whether its times are."""
        return bool(np.isfinite(self.first_s) and np.isfinite(self.last_s))
