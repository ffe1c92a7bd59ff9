"""Aligning a sensor's own counter to the receiver's time of week.

Sensor messages (ESF) carry a free-running counter, not a time: its start is arbitrary, its rate only
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
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from fusion.types import Floats, Ints

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
class Marks:
    """Which time was where in the stream: ``offset`` (n,) bytes, ascending; ``time_s`` (n,) Unix seconds."""

    offset: Ints
    time_s: Floats


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
