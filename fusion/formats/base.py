"""What every log format shares: the protocol, notes for the drive's report, plausible positions, times, the log itself.

Knows no format.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from fusion.errors import EmptyLogError, MalformedLogError
from fusion.formats.glance import NO_DATE, Ends, Glance, Told
from fusion.messages import say
from fusion.signals import Navigation, RawGnss
from fusion.types import (
    Bools,
    DeviceMotion,
    DriveLog,
    Floats,
    GnssFix,
    GnssVelocity,
    Progress,
    SensorTable,
    no_progress,
)

Data = bytes | memoryview
Place = Callable[[int], str]
"""Says where a row, an offset or a point of the input is, in words: ``line 7``, ``byte 1200``."""

MIN_TIME_S = 315532800.0
"""1980-01-01: no satellite navigation before."""
MAX_TIME_S = 4102444800.0
"""2100-01-01."""
DAY_S = 86400.0

MAX_POSITIONS = 2_000_000
"""Positions of one log: two days at 10 Hz, 23 days at 1 Hz. Each costs in all that is done with a log."""
MAX_SIGNALS = 500_000
"""Signals of satellites in one log: as long as its positions are computed they cost much more."""

UNDATED = say("log.no_date")
OUT_OF_ORDER = "GnssFix: out of order"
"""What ``GnssFix.assemble`` counts; read here to say it in words."""


class LogFormat:
    """One kind of log file. Formats recognise content, never names, and refuse each other's samples."""

    name: str
    """As in ``DriveLog.source_format`` and the registry."""
    description: str
    """What error messages call it."""
    suffixes: tuple[str, ...]
    """Usual endings of file names, for help texts only."""
    altitude_advice: str
    """One sentence: what a person with such a device or app does so that altitudes are recorded."""
    doppler_advice: str
    """One sentence: what such a person does so that the vertical Doppler velocity is, or what to use instead."""
    has_named_columns = False
    """Whether its columns have names that a person may have to explain."""
    is_of_several = False
    """Whether its recorder writes one recording into several files."""

    def recognises(self, head: bytes) -> bool:
        """Whether the first bytes (up to ``HEAD_BYTES``, or the whole file) look like this format."""
        raise NotImplementedError

    def read(self, data: Data, progress: Progress) -> DriveLog:
        """Read the whole file; raises ``LogError``, nothing else."""
        raise NotImplementedError

    def comes_first(self, head: bytes) -> bool:
        """Whether other parts of the same drive can be read better once this file has been."""
        return False

    def read_part(self, data: Data, progress: Progress, navigation: Navigation) -> DriveLog:
        """As ``read``, one of several files of a drive; ``navigation`` is that of the files before.

        Formats whose files may hold a part of a drive only give a log without any position too.
        """
        return self.read(data, progress)

    def glance(self, ends: Ends) -> Glance:
        """What the ends of a file tell of it, in milliseconds; raises ``LogError`` where they cannot be read."""
        data = ends.head if ends.is_short else self.excerpt(ends)
        log = self.read_part(data, no_progress, Navigation())
        return Glance.of(log, is_of_several=self.is_of_several)

    def told(self, ends: Ends) -> Told:
        """What the file says of its drive; nothing by itself. Looks at the ends alone, and raises nothing."""
        return Told()

    def excerpt(self, ends: Ends) -> bytes:
        """A short file of the start and the end of a long one: of text its lines, of messages those that are whole."""
        start, end = ends.start, ends.end
        return start[: start.rfind(b"\n") + 1 or None] + end[end.find(b"\n") + 1 :]

    def with_columns(self, columns: Mapping[str, str]) -> Self:
        """The same format, knowing which column of ours is which of the header's."""
        return self

    def refuse_header(self, head: bytes, *, part: bool) -> None:
        """Raise the ``LogError`` that reading would raise because of the header, where there is one."""

    def with_name(self, name: str) -> Self:
        """The same format, knowing what the file is called: only that may tell what its columns are of."""
        return self


class EitherWay(LogFormat):
    """Reads a file that is all there is of its drive, and one that is a part of it, by one method."""

    def read(self, data: Data, progress: Progress, *, part: bool = False) -> DriveLog:
        """Read the file; a ``part`` of a drive may lack positions. Raises ``LogError``."""
        raise NotImplementedError

    def read_part(self, data: Data, progress: Progress, navigation: Navigation) -> DriveLog:
        """See ``LogFormat``."""
        return self.read(data, progress, part=True)


@dataclass
class Notes:
    """What a reader has to say about its input: what it skipped, repaired and warns of."""

    skipped: Counter[str] = field(default_factory=Counter)
    repaired: Counter[str] = field(default_factory=Counter)
    warnings: list[str] = field(default_factory=list)
    first_offender: str = ""
    """The first position that was refused, as a clause such as ``line 2: lat_deg is 91, outside -90..90``."""
    _examples: dict[str, tuple[int, str, str]] = field(default_factory=dict)
    """By reason: the count, the first example and the warning that holds them."""

    @property
    def first_place(self) -> str | None:
        """Where that was; None where no position was refused."""
        before = self.first_offender.split(":")[0]
        place = getattr(self.first_offender, "parameters", {}).get("place")
        return (place if place == before else before) or None  # the same, with its key

    def skip(self, reason: str, count: int, example: str = "", *, position: bool = False) -> None:
        """Count ``count`` unusable items; ``example`` says where the first is and what is wrong with it.

        A reason given again adds to its warning, which keeps the first example.
        With ``position`` set the items were positions, and an empty log is explained by the first of them.
        """
        if count <= 0:
            return
        self.skipped[reason] += count
        if example:
            before = self._examples.pop(reason, None)
            total, first = (before[0] + count, before[1]) if before else (count, example)
            sentence = say("log.skipped", n=total, reason=reason, first=first)
            if before:
                self.warnings[self.warnings.index(before[2])] = sentence
            else:
                self.warnings.append(sentence)
            self._examples[reason] = total, first, sentence
        if position and not self.first_offender:
            self.first_offender = example or reason

    def sift(
        self,
        faults: Iterable[tuple[str, Bools]],
        tell: Callable[[int], str] | None = None,
        *,
        position: bool = False,
    ) -> Bools:
        """Which rows have none of the ``faults`` (reason, mask); a faulty row is counted under its first one.

        ``tell`` says of the first row of a reason where it is and what is wrong; ``position`` as for ``skip``.
        """
        good, hits = _sieved(faults)
        for first, reason, count in hits:
            self.skip(reason, count, tell(first) if tell else "", position=position)
        return good

    def undated(self) -> None:
        """Say that the times were placed in the week of the GPS epoch."""
        self.warn(UNDATED)
        self.repaired[NO_DATE] = 1

    def dated_after_all(self) -> None:
        """Take ``undated`` back."""
        self.warnings = [w for w in self.warnings if w != UNDATED]
        self.repaired.pop(NO_DATE, None)

    def warn(self, sentence: str) -> None:
        """Add a sentence once."""
        if sentence not in self.warnings:
            self.warnings.append(sentence)


def _sieved(faults: Iterable[tuple[str, Bools]]) -> tuple[Bools, list[tuple[int, str, int]]]:
    """Which rows have none of the faults; (first row, reason, count) of the rows that have a fault and none before."""
    good: Bools = np.array(True)
    hits = []
    for reason, bad in faults:
        rows = np.flatnonzero(bad & good)
        good = good & ~bad
        if len(rows):
            hits.append((int(rows[0]), reason, len(rows)))
    return good, hits


def refuse_many(positions: int, signals: int = 0) -> None:
    """Raise ``MalformedLogError`` for more positions, or signals of satellites, than a log may have."""
    for count, most, what in (
        (positions, MAX_POSITIONS, "positions"),
        (signals, MAX_SIGNALS, "signals of satellites"),
    ):
        if count > most:
            raise MalformedLogError(say("log.too_many", most=most, what=what))


def usable_positions(
    time_s: Floats, lat_deg: Floats, lon_deg: Floats, notes: Notes, place: Place, *, need: Bools | None = None
) -> Bools:
    """Which rows have a plausible time, latitude and longitude; the others are counted by reason.

    ``need`` marks the rows that claim to hold a position; elsewhere a missing position is no fault (but an
    implausible time is). A position of exactly 0, 0 is what receivers write before their first fix.
    """
    need = np.ones(len(time_s), bool) if need is None else need
    faults: dict[str, tuple[Bools, Callable[[int], str]]] = {
        "without a time": (~np.isfinite(time_s), lambda i: say("fault.no_time")),
        "impossible time": ((time_s < MIN_TIME_S) | (time_s > MAX_TIME_S),
                            lambda i: say("fault.impossible_time", time=_calendar(float(time_s[i])))),
        "incomplete position": (need & ~(np.isfinite(lat_deg) & np.isfinite(lon_deg)),
                                lambda i: say("fault.incomplete")),
        "latitude out of range": (np.abs(lat_deg) > 90, lambda i: say("fault.latitude", lat_deg=lat_deg[i])),
        "longitude out of range": (np.abs(lon_deg) > 180,
                                   lambda i: say("fault.longitude", lon_deg=lon_deg[i])),
        "position 0, 0": (need & (lat_deg == 0) & (lon_deg == 0),
                          lambda i: say("fault.zero")),
    }  # fmt: skip
    good, hits = _sieved((reason, bad) for reason, (bad, _) in faults.items())
    for first, reason, count in sorted(hits):  # in the order of the rows
        notes.skip(
            reason, count, say("fault.at", place=place(first), fault=faults[reason][1](first)), position=True
        )
    return good


def _calendar(time_s: float) -> str:
    year = 1970 + time_s / 31556952.0
    if not 0 < year < 1e6:
        return f"{time_s:.14g} s"
    return say("fault.about_year", time_s=f"{time_s:.14g}", year=f"{year:.0f}")


def ground_velocity(speed_mps: Floats, heading_rad: Floats) -> tuple[Floats, Floats]:
    """Velocity north and east from ground speed and course (clockwise from north).

    Unknown course makes both unknown, except at a speed of exactly 0, where there is none.
    """
    still = speed_mps == 0
    north = np.where(still, 0.0, speed_mps * np.cos(heading_rad))
    east = np.where(still, 0.0, speed_mps * np.sin(heading_rad))
    return north, east


def positive(accuracy: Floats) -> Floats:
    """Accuracies; 0 and less are written for unknown, and become NaN."""
    return np.where(accuracy > 0, accuracy, np.nan)


def is_possible_time(time_s: Floats) -> Bools:
    """Which Unix seconds a log may hold; NaN is none."""
    return np.asarray((time_s > MIN_TIME_S) & (time_s < MAX_TIME_S))


def number_or_nan(text: str | bytes) -> float:
    """The number that a text is; NaN where it is none."""
    try:
        return float(text)
    except ValueError:
        return np.nan


def fix_and_velocity(time_s: Floats, columns: Mapping[str, Floats], notes: Notes) -> dict[str, SensorTable]:
    """Positions and velocities at times (n,), of ``columns`` (n,) named as in ``GnssFix``, with ``s_acc_mps``,
    ``speed_mps`` along the ground and ``course_deg`` clockwise from north."""
    sound = {name: positive(c) if name.endswith(("_acc_m", "_acc_mps")) else c for name, c in columns.items()}
    north, east = ground_velocity(columns["speed_mps"], np.radians(columns["course_deg"]))
    moving = np.isfinite(north)
    velocity = GnssVelocity.assemble(
        time_s[moving], vel_n_mps=north[moving], vel_e_mps=east[moving], s_acc_mps=sound["s_acc_mps"][moving]
    )
    position = {name: sound[name] for name in GnssFix.columns() if name in sound}
    return {"fix": GnssFix.assemble(time_s, notes.repaired, **position), "velocity": velocity}


def build_log(
    kind: LogFormat,
    notes: Notes,
    tables: dict[str, SensorTable],
    *,
    outages_s: Floats | None = None,
    geoid: str = "unknown",
    advice: str = "",
    raw: RawGnss | None = None,
    part: bool = False,
    device: DeviceMotion | None = None,
) -> DriveLog:
    """Make a ``DriveLog``, or raise ``EmptyLogError`` naming the first offender.

    Without any position it is empty, unless ``raw`` has measurements to make them from, or it is a ``part`` of a drive.
    """
    fix = tables.setdefault("fix", GnssFix.empty())
    if not len(fix) and not (raw is not None and len(raw.signals)) and not part:
        why = say("log.first", fault=notes.first_offender) if notes.first_offender else ""
        advice = advice or say("advice.reception")
        raise EmptyLogError(
            say("log.no_position", description=kind.description, why=why, advice=advice),
            where=notes.first_place,
        )
    disorder = notes.repaired[OUT_OF_ORDER]
    if disorder:
        notes.warn(say("log.sorted", n=disorder))
    for name, table in tables.items():
        sane = is_possible_time(table.time_s)
        if not sane.all():  # the reason was given with the positions
            notes.skipped[f"{name} samples at an impossible time"] += int((~sane).sum())
            tables[name] = table.take(sane)
    return DriveLog(
        source_format=kind.name,
        outages_s=np.empty(0) if outages_s is None else np.unique(outages_s),
        geoid=geoid,
        skipped=notes.skipped,
        repaired=notes.repaired,
        warnings=tuple(notes.warnings),
        raw=raw,
        device=device or DeviceMotion(),
        **tables,  # type: ignore[arg-type]
    )
