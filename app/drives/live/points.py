"""A point of a drive under way, what is plausible of it, and what a message held. Knows no program and no SQL."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, NamedTuple

from app.core.errors import BadRequestError
from app.core.messages import say

US = 1_000_000
EARLIEST_US = int(datetime(2000, 1, 1, tzinfo=UTC).timestamp()) * US
AHEAD_US = 86_400 * US
"""A clock may be so far ahead of the service's: no more than a wrong day."""
MOST_POINTS = 10_000
"""In one message."""
DEVICE_LENGTH = 100
KNOT_MPS, KMH_MPS = 1852 / 3600, 1 / 3.6

LIMITS: Mapping[str, tuple[float, float]] = {
    "alt_msl_m": (-1000.0, 20_000.0),
    "height_ell_m": (-1000.0, 20_000.0),
    "h_acc_m": (0.001, 100_000.0),
    "v_acc_m": (0.001, 100_000.0),
    "speed_mps": (0.0, 200.0),
    "s_acc_mps": (0.001, 200.0),
    "heading_deg": (0.0, 360.0),
    "odo_speed_mps": (0.0, 200.0),
    "pressure_hpa": (300.0, 1200.0),
}
"""What a log's column may hold; anything else counts as not measured: programs write -1 for that."""


class LivePoint(NamedTuple):
    """Where a device was at a time, and what it measured there. Named as the columns of a log; None: not measured."""

    time_us: int
    """Unix microseconds."""
    lat_deg: float
    lon_deg: float
    alt_msl_m: float | None = None
    height_ell_m: float | None = None
    h_acc_m: float | None = None
    v_acc_m: float | None = None
    speed_mps: float | None = None
    s_acc_mps: float | None = None
    heading_deg: float | None = None
    odo_speed_mps: float | None = None
    pressure_hpa: float | None = None


class Batch:
    """The points of one message by device, and how many could not be used."""

    def __init__(self, now_us: int | None = None) -> None:
        """``now_us``: the service's clock."""
        self.points: dict[str, list[LivePoint]] = {}
        self.unusable = 0
        self.why: str | None = None
        self.device = ""
        """That of the last point, also where that cannot be used."""
        self._latest_us = (time.time_ns() // 1000 if now_us is None else now_us) + AHEAD_US
        self._seen = 0

    @property
    def is_empty(self) -> bool:
        """Whether no point can be used."""
        return not self.points

    def add(self, device: object, moment: object, lat: object, lon: object, **measured: object) -> None:
        """Take a point as a program wrote it: numbers, or texts of them; what of it cannot be is counted.

        ``BadRequestError`` where one message holds more than ``MOST_POINTS``.
        """
        self._seen += 1
        if self._seen > MOST_POINTS:
            raise BadRequestError(say("live.many_points", most=MOST_POINTS), field="body")
        self.device = device_name(device)
        time_us, lat_deg, lon_deg = moment_us(moment), number(lat), number(lon)
        if time_us is None or not EARLIEST_US <= time_us <= self._latest_us:
            self.refuse("time", moment)
        elif lat_deg is None or not -90 <= lat_deg <= 90:
            self.refuse("latitude", lat)
        elif lon_deg is None or not -180 <= lon_deg <= 180:
            self.refuse("longitude", lon)
        elif lat_deg == lon_deg == 0:
            self.refuse("place", "0, 0")
        else:
            values = {name: _within(name, value) for name, value in measured.items()}
            point = LivePoint(time_us, lat_deg, lon_deg, **values)
            self.points.setdefault(self.device, []).append(point)

    def refuse(self, what: str, value: object) -> None:
        """Count a point that cannot be used, whose ``what`` is at fault."""
        self._seen += not self._seen
        self.unusable += 1
        shown = str(value)[:40] if value is not None else "missing"
        self.why = f"point {self._seen}: {what}: {''.join(c for c in shown if c.isprintable())}"


def number(value: object) -> float | None:
    """The number in a value of JSON or of a query; None: there is none."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        found = float(value)
    except (ValueError, OverflowError):
        return None
    return found if math.isfinite(found) else None


def scaled(value: object, factor: float) -> float | None:
    """The number in a value, in another unit."""
    found = number(value)
    return None if found is None else found * factor


def moment_us(value: object) -> int | None:
    """Unix microseconds of a time: seconds, milli-, micro- or nanoseconds by their size, or a text after ISO 8601, of
    UTC where it names no zone; None: it is none."""
    if isinstance(value, int | str) and not isinstance(value, bool) and str(value).lstrip("-").isdecimal():
        whole = int(str(value)[:30])
        for limit, factor in ((10**11, US), (10**14, 1000), (10**17, 1)):
            if abs(whole) < limit:
                return whole * factor
        return whole // 1000
    if (seconds := number(value)) is not None:
        return moment_us(round(seconds)) if seconds >= 10**11 else round(seconds * US)
    try:
        moment = datetime.fromisoformat(str(value).strip())
        moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
        return round((moment - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds() * US)
    except (ValueError, OverflowError):
        return None


def device_name(value: object) -> str:
    """What a device calls itself, as it is kept; empty: it does not say."""
    text = str(value) if isinstance(value, str | int) else ""
    return "".join(c for c in text if c.isprintable()).strip()[:DEVICE_LENGTH]


def _within(name: str, value: Any) -> float | None:
    low, high = LIMITS[name]
    found = number(value)
    return found if found is not None and low <= found <= high else None
