"""Clocks of a receiver: times of sensors by their own counters, and UTC by the GPS time of week.

*Counters.* Sensor messages (ESF) carry a free-running counter, not a time: its start is arbitrary, its rate only
nominally known, it wraps around, and it starts again when the receiver does. What ties it to time is the
order of the byte stream: the navigation epochs (marks) stand between the sensor messages.

1. *Runs.* Between two samples at least, and at most, so much time has passed as the marks around them
   allow. A step of the counter that does not fit, by more than ``STEP_TOLERANCE_S``, is a wrap if adding
   2^16, 2^24 or 2^32 makes it fit; otherwise a new run begins (receiver restarted, recordings joined).
2. *Pairs.* A mark was written between two sensor messages, so its counter value lies between their newest
   samples: the mean of the two errs by half a message interval at most.
3. *Fit.* In each run time = offset + counter / rate. The rate is the median of the slopes over pairs half
   the run apart (Theil-Sen, deaf to single wrong tags), and the nominal one where it cannot be told from
   it; the offset is the median over the run's pairs. Short runs borrow the longest run's rate.

What the order cannot show is the receiver's latency: an epoch's messages leave it some time after the epoch
(0.05 to 0.15 s on an M8), so aligned sensor times are early by about that much. It is left in, being far
below an epoch.

*Time of week.* Most UBX messages carry only iTOW, milliseconds of the GPS week. Messages that carry UTC beside it
(NAV-PVT, HNR-PVT, NAV-TIMEUTC, NAV-TIMEGPS) give the difference UTC - iTOW, which holds week and leap seconds
together; each message takes it from the nearest such message in the stream, moved by whole weeks where the
week turned over in between.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from fusion.arrays import ColumnTable
from fusion.formats.base import Notes, is_possible_time
from fusion.formats.receiver.ubx_messages import Records
from fusion.messages import say
from fusion.signals import GPS_EPOCH_S, WEEK_S
from fusion.types import Bools, Floats, Ints

MEAS_HZ = 1000.0
"""Nominal ticks per second of ESF-MEAS time tags."""
RAW_HZ = 25600.0
"""Nominal ticks per second of ESF-RAW time tags (39.0625 microseconds)."""
WRAPS = (1 << 16, 1 << 24, 1 << 32)
STEP_TOLERANCE_S = 2.0
PAIR_ERROR_S = 0.05
COARSE_SPAN_S = 60.0
MAX_PAIR_GAP_S = 1.5
LOST = "sensor samples whose time tag no navigation epoch explains"


@dataclass(frozen=True)
class Marks(ColumnTable):
    """Which time was where in the stream: ``offset`` (n,) bytes, ascending; ``time_s`` (n,) Unix seconds."""

    offset: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    time_s: Floats = field(default_factory=lambda: np.empty(0))

    def of_epochs(self) -> Marks:
        """The first mark of each epoch, in the order of the stream; marks without a time are none."""
        timed = self.take(np.isfinite(self.time_s))
        timed = timed.take(np.argsort(timed.offset, kind="stable"))
        return timed.take(np.diff(timed.time_s, prepend=-np.inf) != 0)


@dataclass(frozen=True)
class _Pairs:
    time_s: Floats
    tick: Floats
    run: Ints


def align(tick: Ints, offset: Ints, marks: Marks, nominal_hz: float, notes: Counter[str]) -> Floats:
    """Unix time (n,) of each counter value; NaN, counted in ``notes``, where no mark tells it.

    ``tick`` (n,) are counter values in stream order, ``offset`` (n,) the byte offsets of their messages,
    equal for the samples of one message.
    """
    out = np.full(len(tick), np.nan)
    if len(tick) and len(marks.time_s):
        coarse_hz = _rate(tick.astype(float), _before(marks, offset), COARSE_SPAN_S, nominal_hz)
        counter, run = _runs(tick, offset, marks, coarse_hz)
        pairs = _pairs(counter, run, offset, marks, coarse_hz)
        _fit(out, counter, run, pairs, nominal_hz)
    lost = int(np.count_nonzero(np.isnan(out)))
    if lost:
        notes[LOST] += lost
    return out


def _before(marks: Marks, offset: Ints) -> Floats:
    """Time of the last mark before each offset; the first mark's before that."""
    return marks.time_s[np.maximum(np.searchsorted(marks.offset, offset) - 1, 0)]


def _runs(tick: Ints, offset: Ints, marks: Marks, hz: float) -> tuple[Floats, Ints]:
    """The counter with its wraps added back, and the number of the run that each sample belongs to."""
    at = np.searchsorted(marks.offset, offset)
    mark_s = np.concatenate([[-np.inf], marks.time_s, [np.inf]])
    previous, following = mark_s[at], mark_s[at + 1]
    least = np.maximum(previous[1:] - following[:-1], 0.0) - STEP_TOLERANCE_S
    most = following[1:] - previous[:-1] + STEP_TOLERANCE_S
    step = np.diff(tick).astype(float)
    fits = (step / hz >= least) & (step / hz <= most)
    for wrap in WRAPS:
        wrapped = (step + wrap) / hz
        mend = ~fits & (tick[:-1] < wrap) & (tick[1:] < wrap) & (wrapped >= least) & (wrapped <= most)
        step[mend] += wrap
        fits |= mend
    counter = tick[0] + np.concatenate([[0.0], np.cumsum(step)])
    run = np.concatenate([[0], np.cumsum(~fits)])
    return counter, run


def _pairs(counter: Floats, run: Ints, offset: Ints, marks: Marks, hz: float) -> _Pairs:
    newest = np.flatnonzero(np.append(np.diff(offset) > 0, True))  # the last sample of each message
    at = np.searchsorted(offset[newest], marks.offset)
    if len(marks.time_s) == 1:  # a single epoch: the sample next to it, for want of one on each side
        beside = newest[np.minimum(at, len(newest) - 1)]
        return _Pairs(marks.time_s, counter[beside], run[beside])
    inside = (at > 0) & (at < len(newest))
    early, late = newest[at[inside] - 1], newest[at[inside]]
    gap_s = np.abs(counter[late] - counter[early]) / hz
    use = (run[early] == run[late]) & (gap_s <= MAX_PAIR_GAP_S)
    early, late = early[use], late[use]
    return _Pairs(marks.time_s[inside][use], (counter[early] + counter[late]) / 2, run[early])


def _fit(out: Floats, counter: Floats, run: Ints, pairs: _Pairs, nominal_hz: float) -> None:
    if not len(pairs.run):
        return
    longest = pairs.run == np.bincount(pairs.run).argmax()
    common = _rate(pairs.tick[longest], pairs.time_s[longest], np.inf, nominal_hz)
    numbers = np.unique(pairs.run)
    # runs follow each other, so each is a slice, of the samples and of the pairs
    samples = np.searchsorted(run, [numbers, numbers + 1]).T.tolist()
    mine = np.searchsorted(pairs.run, [numbers, numbers + 1]).T.tolist()
    for (first, end), (first_pair, end_pair) in zip(samples, mine, strict=True):
        tick, time_s = pairs.tick[first_pair:end_pair], pairs.time_s[first_pair:end_pair]
        hz = _rate(tick, time_s, np.inf, common)
        base_tick, base_s = tick[0], time_s[0]
        start = base_s + np.median((time_s - base_s) - (tick - base_tick) / hz)
        out[first:end] = start + (counter[first:end] - base_tick) / hz


def _rate(tick: Floats, time_s: Floats, span_s: float, fallback_hz: float) -> float:
    """Median slope, ticks per second, over pairs ``span_s`` (or half of all time) apart.

    ``fallback_hz`` where there are too few pairs or the slope may well be it.
    """
    if len(time_s) < 4:
        return fallback_hz
    order = np.argsort(time_s, kind="stable")  # joined recordings need not be in order
    tick, time_s = tick[order], time_s[order]
    span = min(span_s, (time_s[-1] - time_s[0]) / 2)
    if not span > 0:
        return fallback_hz
    later = np.searchsorted(time_s, time_s + span)
    first = np.flatnonzero(later < len(time_s))
    later = later[first]
    run = time_s[later] - time_s[first]
    slope = float(np.median((tick[later] - tick[first])[run > 0] / run[run > 0]))
    if not slope > 0 or abs(slope / fallback_hz - 1) <= PAIR_ERROR_S / span:
        return fallback_hz
    return slope


VALID_DATE_TIME = 3
RESOLVED = 7


@dataclass(frozen=True)
class Evidence(ColumnTable):
    """Messages that tell UTC beside iTOW, in any order; all (n,).

    ``trust`` is 3 (date, time and leap seconds resolved), 2 (date and time valid), 1 (not declared valid).
    """

    offset: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    itow_s: Floats = field(default_factory=lambda: np.empty(0))
    utc_s: Floats = field(default_factory=lambda: np.empty(0))
    trust: Ints = field(default_factory=lambda: np.empty(0, np.int64))


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


def nearest_offset(offsets: Ints, offset: Ints) -> Ints:
    """Which of ``offsets``, ascending, is nearest to each ``offset`` (n,)."""
    after = np.clip(np.searchsorted(offsets, offset), 0, len(offsets) - 1)
    before = np.maximum(after - 1, 0)
    nearer = np.abs(offsets[before] - offset) < np.abs(offsets[after] - offset)
    return np.where(nearer, before, after)


class WeekClock:
    """Turns (iTOW, byte offset) into Unix time; without any evidence, in the week of the GPS epoch."""

    def __init__(self, evidence: Evidence, notes: Notes) -> None:
        """Uses the most trusted evidence there is, and says so when that is little."""
        plausible = is_possible_time(evidence.utc_s)
        self.dated = bool(plausible.any())
        best = int(evidence.trust[plausible].max()) if self.dated else 0
        used = evidence.take(plausible & (evidence.trust == best))
        used = used.take(np.argsort(used.offset, kind="stable"))
        self._offset, self._utc_s = used.offset, used.utc_s
        difference = used.utc_s - used.itow_s
        whole_ms = np.round(difference)
        self._difference = np.where(np.abs(difference - whole_ms) < 0.05, whole_ms, difference)
        if best == 1:
            notes.warn(say("receiver.date_unsure"))
        if not self.dated and not np.any(evidence.trust > 1):
            notes.undated()

    def time_s(self, itow_s: Floats, offset: Ints) -> Floats:
        """Unix seconds, (n,), of times of week (n,) that stand at these byte offsets, ascending."""
        if not self.dated:
            turned = np.cumsum(np.diff(itow_s, prepend=itow_s[:1]) < -WEEK_S / 2)
            return GPS_EPOCH_S + turned * WEEK_S + itow_s
        at = nearest_offset(self._offset, offset)
        time_s = itow_s + self._difference[at]
        return time_s + WEEK_S * np.round((self._utc_s[at] - time_s) / WEEK_S)


def own_time(clock_s: Floats, utc_s: Floats, declared: Bools) -> Floats:
    """The clock's time, save where a message declares another UTC valid: then that, even if impossible."""
    other = declared & np.isfinite(utc_s) & ~(np.abs(utc_s - clock_s) <= 2.0)
    return np.where(other, utc_s, clock_s)
