"""Compiled walks over the lines of observation files: which lines are epochs and rows, and what stands in them.

Version 3 and 4 have one line a satellite, under an epoch line that begins with ``>``; version 2 lists the satellites in
the epoch's own lines and has a line for every five observations. A walk stops at events in mid-file (flags 2 to 5),
whose lines are a header's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fusion.compiled import compiled
from fusion.formats.rinex.lines import Text, number
from fusion.types import Floats, Ints

LINE, EPOCHS, ROWS, STRAY, SHORT = range(5)
"""Places in the state of a walk: the next line; how many epochs and rows were found; lines that belong to nothing;
epochs with fewer lines than they announce."""

MOST_NUMBERS = 100
"""Satellites of a system have two digits."""
PER_LINE_2 = 5
_FIELD = 16
_VALUE = 14
_LARGEST_M = 1e9
_LETTERS = np.frombuffer(b"GRECJS", np.uint8)


class Codes(NamedTuple):
    """Where codes stand in the rows: ``place`` (parts, 6, codes, 3) counts observations from 0, -1 where there is none.

    Parts of the file lie between events. The three are pseudorange, Doppler and C/N0; ``factor``, alike, is what values
    are to be divided by. A row begins with ``lead`` columns and has ``per`` observations a line.
    """

    place: Ints
    factor: Floats
    lead: int
    per: int


@compiled
def _whole_number(text: Text, at: int, stop: int, end: int) -> int:
    """The whole number without sign in columns up to the line's end; -1 if there is none or something else."""
    value, has_digit = 0, False
    for i in range(at, min(stop, end)):
        c = text[i]
        if 48 <= c <= 57:
            value = value * 10 + (c - 48)
            has_digit = True
        elif c != 32:
            return -1
    return value if has_digit else -1


@compiled
def scan_3(
    text: Text, start: Ints, end: Ints, state: Ints, epoch_line: Ints, row_line: Ints, row_epoch: Ints
) -> int:
    """Walk on from ``state``; returns how many lines an event's header has, or -1 at the end of the file.

    The event's own line is ``state[LINE]``. Tables are filled from the counts in ``state`` on.
    """
    i, n = state[LINE], len(start)
    while i < n:
        at = start[i]
        if at == end[i] or text[at] != 62:  # '>'
            state[STRAY] += at < end[i]
            i += 1
            continue
        flag = _whole_number(text, at + 31, at + 32, end[i])
        count = _whole_number(text, at + 32, at + 35, end[i])
        if flag < 0 or flag > 6 or count < 0:
            state[STRAY] += 1
            i += 1
            continue
        if 2 <= flag <= 5:
            state[LINE] = i
            return count
        rows_taken, own = 0, i
        i += 1
        while rows_taken < count and i < n and (start[i] == end[i] or text[start[i]] != 62):
            if flag < 2 and start[i] < end[i]:
                row_line[state[ROWS]] = i
                row_epoch[state[ROWS]] = state[EPOCHS]
                state[ROWS] += 1
            rows_taken += 1
            i += 1
        state[SHORT] += rows_taken < count
        if flag < 2:
            epoch_line[state[EPOCHS]] = own
            state[EPOCHS] += 1
    state[LINE] = n
    return -1


@compiled
def _is_epoch_2(text: Text, start: int, end: int) -> bool:
    """Whether a line of version 2 opens an epoch or an event: a date (or blanks) with a flag and a count behind it."""
    if end - start < 32 or text[start] != 32 or not 48 <= text[start + 28] <= 54:
        return False
    if _whole_number(text, start + 29, start + 32, end) < 0:
        return False
    if text[start + 18] == 46:
        return bool(text[start + 26] != 46)
    for i in range(start, start + 28):
        if text[i] != 32:
            return False
    return bool(text[start + 28] >= 50)


@compiled
def scan_2(
    text: Text,
    start: Ints,
    end: Ints,
    state: Ints,
    per: int,
    epoch_line: Ints,
    row_line: Ints,
    row_epoch: Ints,
    row_name: Ints,
) -> int:
    """As ``scan_3``; ``per`` is the number of lines a satellite has, ``row_name`` where its name stands.

    An epoch with another one among its lines has lost some: none of its rows can be told, all are left out.
    """
    i, n = state[LINE], len(start)
    while i < n:
        at = start[i]
        if not _is_epoch_2(text, at, end[i]):
            state[STRAY] += at < end[i]
            i += 1
            continue
        flag = text[at + 28] - 48
        count = _whole_number(text, at + 29, at + 32, end[i])
        if 2 <= flag <= 5:
            state[LINE] = i
            return count
        names = (count + 11) // 12
        first = i + max(names, 1)
        stop = first + count * per
        complete = stop <= n
        for j in range(i + 1, min(stop, n)):
            if _is_epoch_2(text, start[j], end[j]):
                complete, stop = False, j
                break
        if not complete:
            state[SHORT] += 1
            count = 0 if stop <= n else max(0, (n - first) // per)
        if flag < 2:
            for k in range(count):
                row_line[state[ROWS]] = first + k * per
                row_epoch[state[ROWS]] = state[EPOCHS]
                row_name[state[ROWS]] = start[i + k // 12] + 32 + 3 * (k % 12)
                state[ROWS] += 1
            epoch_line[state[EPOCHS]] = i
            state[EPOCHS] += 1
        i = min(stop, n)
    state[LINE] = n
    return -1


@compiled
def _satellite(text: Text, at: int, otherwise: int) -> int:
    """System times ``MOST_NUMBERS`` plus number of the name at an offset; -1 of another system, -2 if it is no name."""
    if at + 3 > len(text):
        return -2
    system = otherwise if text[at] == 32 else -1
    for k in range(len(_LETTERS)):
        if text[at] == _LETTERS[k]:
            system = k
    value = _whole_number(text, at + 1, at + 3, at + 3)
    if value <= 0 or not (text[at] == 32 or 65 <= text[at] <= 90):
        return -2
    return system * MOST_NUMBERS + value if system >= 0 else -1


@compiled
def _value(
    text: Text, start: Ints, end: Ints, line: int, codes: Codes, which: tuple[int, int, int, int]
) -> float:
    """An observation of a row; NaN where it is blank, cut off, 0 (which means missing), or no number."""
    index = codes.place[which]
    if index < 0:
        return np.nan
    line += index // codes.per
    if line >= len(start):
        return np.nan
    at = start[line] + codes.lead + _FIELD * (index % codes.per)
    if at + _VALUE > end[line]:
        return np.nan
    value = number(text, at, at + _VALUE) / codes.factor[which]
    return value if value != 0 and np.isfinite(value) else np.nan


@compiled
def count_codes(
    text: Text,
    start: Ints,
    end: Ints,
    row_line: Ints,
    row_name: Ints,
    row_part: Ints,
    codes: Codes,
    otherwise: int,
    counts: Ints,
    satellite: Ints,
) -> None:
    """Find the satellite of each row, and count in ``counts`` (6 x MOST_NUMBERS, codes) its pseudoranges by code."""
    for r in range(len(row_line)):
        satellite[r] = _satellite(text, row_name[r], otherwise)
        if satellite[r] < 0:
            continue
        part, system = row_part[r], satellite[r] // MOST_NUMBERS
        for k in range(codes.place.shape[2]):
            value = _value(text, start, end, row_line[r], codes, (part, system, k, 0))
            if 0 < value < _LARGEST_M:
                counts[satellite[r], k] += 1


@compiled
def take_values(
    text: Text,
    start: Ints,
    end: Ints,
    row_line: Ints,
    row_part: Ints,
    codes: Codes,
    satellite: Ints,
    chosen: Ints,
) -> Floats:
    """Pseudorange, Doppler and C/N0 (n, 3) of each row, by the code ``chosen`` for its satellite; NaN where absent."""
    out = np.full((len(row_line), 3), np.nan)
    for r in range(len(row_line)):
        if satellite[r] < 0:
            continue
        part, system, k = row_part[r], satellite[r] // MOST_NUMBERS, chosen[satellite[r]]
        for q in range(3):
            out[r, q] = _value(text, start, end, row_line[r], codes, (part, system, k, q))
        if not 0 < out[r, 0] < _LARGEST_M:
            out[r, 0] = np.nan
    return out
