"""What is stored of a log beside what a method says of it."""

from __future__ import annotations

from collections.abc import Sized
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Self

from app.core.db import Bounds
from fusion.formats.glance import NO_DATE
from fusion.types import DriveLog, Floats


@dataclass(frozen=True, eq=False)
class LogFacts:
    """Of a log with its positions: their times ``epoch_s`` (e,), Unix seconds, their box, degrees, and its begin."""

    epoch_s: Floats
    bounds_deg: Bounds
    drive_time: datetime | None

    @classmethod
    def of(cls, log: DriveLog) -> Self:
        """Of a log with positions."""
        return cls(log.fix.time_s, log.bounds_deg(), drive_time(log))


def records_of(log: DriveLog) -> int:
    """How many records the log has: the epochs of the sensor of which it has most, raw signals among them.

    Sensors beside each other are not added, so that a drive has as many in whatever format it was recorded.
    """
    sensors: list[Sized] = [*log.tables().values(), *log.device.tables().values()]
    if log.raw is not None:
        sensors.append(log.raw.signals)
    return max(map(len, sensors))


def drive_time(log: DriveLog) -> datetime | None:
    """When the recording begins; None where the log has no date and its times were placed somewhere."""
    return None if NO_DATE in log.repaired else datetime.fromtimestamp(float(log.fix.time_s[0]), UTC)
