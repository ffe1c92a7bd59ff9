"""From GPS time of week to UTC: which week it is, and how many leap seconds, learned from the log itself.

Most UBX messages carry only iTOW, milliseconds of the GPS week. Messages that carry UTC beside it (NAV-PVT,
HNR-PVT, NAV-TIMEUTC, NAV-TIMEGPS) give the difference UTC - iTOW, which holds week and leap seconds
together; each message takes it from the nearest such message in the stream, moved by whole weeks where the
week turned over in between.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.formats.base import GPS_EPOCH_S, MAX_TIME_S, MIN_TIME_S, WEEK_S, Notes
from fusion.formats.receiver.ubx_messages import Records
from fusion.types import Bools, Floats, Ints

VALID_DATE_TIME = 3
RESOLVED = 7


@dataclass(frozen=True)
class Evidence:
    """Messages that tell UTC beside iTOW, in any order; all (n,).

    ``trust`` is 3 (date, time and leap seconds resolved), 2 (date and time valid), 1 (not declared valid).
    """

    offset: Ints
    itow_s: Floats
    utc_s: Floats
    trust: Ints


def utc_seconds(records: Records) -> Floats:
    """Unix seconds of year .. sec and nano; NaN where these are no date at all."""
    fields = {n: records[n].astype(np.int64) for n in ("year", "month", "day", "hour", "min", "sec", "nano")}
    ok = (fields["month"] - 1 < 12) & (fields["month"] > 0) & (fields["day"] > 0) & (fields["day"] < 32)
    ok &= (fields["hour"] < 24) & (fields["min"] < 60) & (fields["sec"] < 62) & (fields["year"] > 0)
    months = (fields["year"] - 1970) * 12 + fields["month"] - 1
    first = np.where(ok, months, 0).astype("datetime64[M]").astype("datetime64[D]").astype(np.int64)
    day = first + fields["day"] - 1
    clock = fields["hour"] * 3600 + fields["min"] * 60 + fields["sec"]
    return np.where(ok, day * 86400.0 + clock + fields["nano"] * 1e-9, np.nan)


def trust_of(records: Records) -> Ints:
    """Trust in the UTC fields by their ``valid`` flags, see ``Evidence``."""
    valid = records["valid"]
    resolved, declared = (valid & bits == bits for bits in (RESOLVED, VALID_DATE_TIME))
    return np.where(resolved, 3, np.where(declared, 2, 1))


def gps_utc_seconds(records: Records) -> Floats:
    """Unix seconds of NAV-TIMEGPS: week and leap seconds stand in the message."""
    return np.asarray(GPS_EPOCH_S + records["week"] * WEEK_S + records["iTOW"] * 1e-3 - records["leapS"])


class WeekClock:
    """Turns (iTOW, byte offset) into Unix time; without any evidence, in the week of the GPS epoch."""

    def __init__(self, evidence: Evidence, notes: Notes) -> None:
        """Uses the most trusted evidence there is, and says so when that is little."""
        plausible = (evidence.utc_s > MIN_TIME_S) & (evidence.utc_s < MAX_TIME_S)
        self.dated = bool(plausible.any())
        best = int(evidence.trust[plausible].max()) if self.dated else 0
        use = np.flatnonzero(plausible & (evidence.trust == best))
        use = use[np.argsort(evidence.offset[use], kind="stable")]
        self._offset, self._utc_s = evidence.offset[use], evidence.utc_s[use]
        difference = self._utc_s - evidence.itow_s[use]
        whole_ms = np.round(difference)
        self._difference = np.where(np.abs(difference - whole_ms) < 0.05, whole_ms, difference)
        if best == 1:
            notes.warn(
                "The receiver never declared its date valid: the dates of this log are taken on trust."
            )
        if not self.dated and not np.any(evidence.trust > 1):
            notes.undated()

    def time_s(self, itow_s: Floats, offset: Ints) -> Floats:
        """Unix seconds, (n,), of times of week (n,) that stand at these byte offsets, ascending."""
        if not self.dated:
            turned = np.cumsum(np.diff(itow_s, prepend=itow_s[:1]) < -WEEK_S / 2)
            return GPS_EPOCH_S + turned * WEEK_S + itow_s
        after = np.clip(np.searchsorted(self._offset, offset), 0, len(self._offset) - 1)
        before = np.maximum(after - 1, 0)
        nearer = np.abs(self._offset[before] - offset) < np.abs(self._offset[after] - offset)
        at = np.where(nearer, before, after)
        time_s = itow_s + self._difference[at]
        return time_s + WEEK_S * np.round((self._utc_s[at] - time_s) / WEEK_S)


def own_time(clock_s: Floats, utc_s: Floats, declared: Bools) -> Floats:
    """The clock's time, save where a message declares another UTC valid: then that, even if impossible."""
    other = declared & np.isfinite(utc_s) & ~(np.abs(utc_s - clock_s) <= 2.0)
    return np.where(other, utc_s, clock_s)
