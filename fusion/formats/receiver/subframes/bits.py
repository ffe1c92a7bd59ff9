"""Fields of navigation messages: where their bits are, what they count, and reading and writing them in bulk."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from fusion.arrays import ColumnTable
from fusion.formats.base import Notes
from fusion.signals import WEEK_S, KeplerEphemerides
from fusion.types import Bools, Floats, Ints

Bits = NDArray[np.uint8]
"""One message a row, one bit (0 or 1) a column, in the order of sending."""

SEMICIRCLE = 3.1415926535898
"""Radians of a semi-circle: the value of pi that IS-GPS-200, section 20.3.3.4.3, and the other documents prescribe."""
MIXED = "satellites whose ephemeris never came whole (its parts are missing, or of different issues)"
NOT_THEN = "navigation messages whose time or week does not fit the epochs around"
_TOLERANCE_S = 300.0
"""Between a message's own time and the epochs beside it in the file: messages wait for seconds only, but epochs may be
far apart; what this lets pass cannot change the week."""


@dataclass(frozen=True)
class Field:
    """``pieces`` are (first bit, length), first bits counted from 1 as the documents do, most significant piece first.

    ``signed`` is "" for counts, "two" for two's complement, "magnitude" for a sign bit before the magnitude. The value
    is the number times ``scale``.
    """

    pieces: tuple[tuple[int, int], ...]
    signed: str = ""
    scale: float = 1.0

    @property
    def columns(self) -> list[int]:
        """Where the bits are, from 0."""
        return [first - 1 + k for first, length in self.pieces for k in range(length)]


Layout = Mapping[str, Field]


def count(*pieces: tuple[int, int], scale: float = 1.0) -> Field:
    """A field without sign."""
    return Field(pieces, "", scale)


def signed(*pieces: tuple[int, int], scale: float = 1.0) -> Field:
    """A field in two's complement."""
    return Field(pieces, "two", scale)


def magnitude(*pieces: tuple[int, int], scale: float = 1.0) -> Field:
    """A field with a sign bit before its magnitude (GLONASS)."""
    return Field(pieces, "magnitude", scale)


def bits_of(words: NDArray[np.uint32], used: int = 32) -> Bits:
    """The lowest ``used`` bits of each word, (n, words x used)."""
    n, count = words.shape
    octets = np.ascontiguousarray(words.astype(">u4")).view(np.uint8)
    return np.unpackbits(octets, axis=1).reshape(n, count, 32)[:, :, 32 - used :].reshape(n, count * used)


def words_of(bits: Bits, used: int = 32) -> NDArray[np.uint32]:
    """The opposite of ``bits_of``; bits that are not used are 0."""
    n, count = len(bits), bits.shape[1] // used
    padded = np.zeros((n, count, 32), np.uint8)
    padded[:, :, 32 - used :] = bits.reshape(n, count, used)
    return np.packbits(padded.reshape(n, count * 32), axis=1).view(">u4").astype(np.uint32)


def numbers(bits: Bits, field: Field) -> Ints:
    """A field as whole numbers (n,), without its scale."""
    part = bits[:, field.columns].astype(np.int64)
    size = part.shape[1]
    value = part @ (1 << np.arange(size - 1, -1, -1, dtype=np.int64))
    top = 1 << (size - 1)
    if field.signed == "two":
        return np.asarray((value ^ top) - top)
    if field.signed == "magnitude":
        return np.where(value >= top, top - value, value)
    return np.asarray(value)


def read(bits: Bits, layout: Layout) -> dict[str, Floats]:
    """All fields of messages (n, bits), each (n,), in the unit of its scale."""
    return {name: numbers(bits, field).astype(float) * field.scale for name, field in layout.items()}


def read_sets(bits: Bits, rows: Ints, parts: Iterable[Layout]) -> dict[str, Floats]:
    """All fields (k,) of messages that make a whole, ``rows`` (k, parts) as ``complete_sets`` has them."""
    return {
        name: c
        for layout, row in zip(parts, rows.T, strict=True)
        for name, c in read(bits[row], layout).items()
    }


def write(bits: Bits, layout: Layout, values: Mapping[str, Floats]) -> None:
    """Put values into the bits, rounded to their scales. Raises ``ValueError`` for one that its field cannot hold."""
    for name, field in layout.items():
        if name not in values:
            continue
        columns = field.columns
        top = 1 << (len(columns) - 1)
        number = np.round(np.asarray(values[name], float) / field.scale).astype(np.int64)
        least = {"": 0, "two": -top, "magnitude": 1 - top}[field.signed]
        most = top - 1 if field.signed else 2 * top - 1
        if np.any((number < least) | (number > most)):
            raise ValueError(f"{name} does not fit its {len(columns)} bits of {field.scale:g}")
        if field.signed == "magnitude":
            number = np.where(number < 0, top - number, number)
        bits[:, columns] = number[:, None] >> np.arange(len(columns) - 1, -1, -1) & 1


@dataclass(frozen=True)
class Pages(ColumnTable):
    """Messages of one kind in the order of the file: the satellite's number, its bits, about when, and its channel.

    ``near_s`` are the GPS seconds of the epoch beside it in the file; ``channel`` is GLONASS's alone.
    """

    number: Ints
    bits: Bits
    near_s: Floats
    channel: Ints


def nearest(near_s: Floats, part_s: Floats, period_s: float) -> Floats:
    """The times that are ``part_s`` into a period, next to ``near_s``."""
    return part_s + period_s * np.round((near_s - part_s) / period_s)


def in_time(own_s: Floats, near_s: Floats, notes: Notes) -> Bools:
    """Which messages are of the time around them; the others are counted."""
    return notes.sift(((NOT_THEN, _is_far(own_s, near_s)),))


def _is_far(own_s: Floats, near_s: Floats) -> Bools:
    return np.asarray(~(np.abs(own_s - near_s) <= _TOLERANCE_S))


def dated(
    pages: Pages, head: Mapping[str, Floats], preamble: int, own_s: Floats, reason: str, notes: Notes
) -> tuple[Pages, Floats, Ints]:
    """The sound subframes, when they were sent (GPS seconds), and which they are.

    ``own_s`` (n,) are the seconds of the GPS week at which subframes say that they were sent. One without preamble or
    number, or (NaN) without a time, is counted under ``reason``.
    """
    subframe = head["subframe"].astype(np.int64)
    headed = (head["preamble"] == preamble) & (subframe > 0) & (subframe < 6) & ~np.isnan(own_s)
    sent_s = nearest(pages.near_s, own_s, WEEK_S)
    sound = notes.sift(((reason, ~headed), (NOT_THEN, _is_far(sent_s, pages.near_s))))
    return pages.take(sound), sent_s[sound], subframe[sound]


def ephemerides(
    system: int,
    number: Ints,
    sent_s: Floats,
    values: dict[str, Floats],
    of_week: Bools,
    notes: Notes,
    late_s: float = 0.0,
) -> KeplerEphemerides:
    """What complete sets say, as ephemerides; those that are not ``of_week``, the week around, are counted.

    ``values`` (n,) by name hold those of ``KeplerEphemerides`` under its names, ``toe`` and ``toc`` in seconds of the
    week of a time ``late_s`` behind GPS, and an ``issue``.
    """
    notes.skip(NOT_THEN, int(np.count_nonzero(~of_week)))
    columns = {
        **values,
        "system": np.full(len(number), system),
        "number": number,
        "toe_s": nearest(sent_s, values["toe"] + late_s, WEEK_S),
        "toc_s": nearest(sent_s, values["toc"] + late_s, WEEK_S),
        "sent_s": sent_s,
        "issue": values["issue"].astype(np.int64),
    }
    return KeplerEphemerides(**{spec.name: columns[spec.name] for spec in fields(KeplerEphemerides)}).take(
        of_week
    )


def complete_sets(
    number: Ints,
    part: Ints,
    issue: Ints,
    time_s: Floats,
    parts: Sequence[int],
    within_s: float,
    notes: Notes,
    status: Ints | None = None,
) -> Ints:
    """Messages (k, parts) that make a whole: of one satellite and issue, at most ``within_s`` apart.

    The latest of each part counts. A whole is given again only where its issue or ``status`` (n,) is another, which is
    0 but in one part, or ``within_s`` later, as numbers of issues come back. An issue of -1 goes with any. Satellites
    without any whole are counted.
    """
    latest: dict[int, dict[int, int]] = {}
    last_given_s: dict[tuple[int, int, int], float] = {}
    sets: list[list[int]] = []
    state = (np.zeros(len(number), np.int64) if status is None else status).tolist()
    issues, times = issue.tolist(), time_s.tolist()
    for row, (satellite, kind) in enumerate(zip(number.tolist(), part.tolist(), strict=True)):
        held = latest.setdefault(satellite, {})
        held[kind] = row
        if len(held) < len(parts):
            continue
        rows = [held[p] for p in parts]
        stated_issues = {issues[r] for r in rows} - {-1}
        moments = [times[r] for r in rows]
        if len(stated_issues) != 1 or max(moments) - min(moments) > within_s:
            continue
        key = satellite, stated_issues.pop(), max(state[r] for r in rows)
        if not abs(moments[0] - last_given_s.get(key, -np.inf)) <= within_s:
            last_given_s[key] = moments[0]
            sets.append(rows)
    notes.skip(MIXED, len(latest.keys() - {satellite for satellite, _, _ in last_given_s}))
    return np.array(sets, np.int64).reshape(-1, len(parts))


def user_range_accuracy_m(index: Iterable[float]) -> Floats:
    """Metres of a URA index (n,): IS-GPS-200, section 20.3.3.3.1.3; BeiDou B1I ICD, 5.2.4.5. 15 says nothing."""
    n = np.asarray(index, float)
    return np.where(n > 14, np.nan, np.where(n <= 6, 2.0 ** (1 + n / 2), 2.0 ** (n - 2)))
