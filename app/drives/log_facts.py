"""What is stored of a log beside what a method says of it."""

from __future__ import annotations

from collections.abc import Sized
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Self

import numpy as np

from app.core.db import Bounds
from fusion.formats.glance import NO_DATE
from fusion.types import DriveLog, Floats, Track


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


def track_of(log: DriveLog) -> Track:
    """What a log with positions says of its way by itself: on no road, with the heights that it logged.

    Heights are above the datum of which it has more; wild positions are left out.
    """
    west, south, east, north = log.bounds_deg()
    lon, lat = log.fix.lon_deg, log.fix.lat_deg
    keep = (lon >= west) & (lon <= east) & (lat >= south) & (lat <= north)
    level, ellipsoid = log.fix.alt_msl_m[keep], log.fix.height_ell_m[keep]
    time_s = log.fix.time_s[keep]
    unknown = np.full(len(time_s), np.nan)
    after = np.searchsorted(time_s, log.outages_s)
    begins = np.zeros(len(time_s), bool)
    begins[after[after < len(time_s)]] = True
    return Track(
        time_s=time_s,
        lat_deg=lat[keep],
        lon_deg=lon[keep],
        alt_m=level if np.isfinite(level).sum() >= np.isfinite(ellipsoid).sum() else ellipsoid,
        h_sigma_m=log.fix.h_acc_m[keep],
        alt_sigma_m=log.fix.v_acc_m[keep],
        speed_mps=unknown,
        heading_rad=unknown,
        pitch_rad=unknown,
        pitch_sigma_rad=unknown,
        segment=np.full(len(time_s), -1),
        distance_m=unknown,
        has_gnss=np.ones(len(time_s), bool),
        after_outage=begins,
    )
