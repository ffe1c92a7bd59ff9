"""The files of an upload bundle as one log: their tables, raw measurements and ephemerides are joined.

Knows no format.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from fusion.errors import EmptyLogError
from fusion.formats.base import Notes
from fusion.signals import Navigation, RawGnss, Signals
from fusion.types import DeviceMotion, DriveLog, Floats, SensorTable, ThreeAxes


@dataclass(frozen=True)
class Part:
    """One file that was read: the name for messages, and what it holds."""

    name: str
    log: DriveLog


def join(parts: Sequence[Part], notes: Notes) -> DriveLog:
    """Make one log of the parts of a drive; raises ``EmptyLogError`` if they hold no position and nothing to make one.

    Where parts have the same sensor at different times, their tables follow each other; at the same times, the one with
    more samples is used, with a warning.
    """
    tables: dict[str, Any] = {}
    geoid = "unknown"
    for sensor in DriveLog.SENSORS:
        having = [(part, part.log.tables()[sensor]) for part in parts if len(part.log.tables()[sensor])]
        used = _not_overlapping([(part, table.time_s, len(table)) for part, table in having], sensor, notes)
        chosen = [(part, table) for part, table in having if part in used]
        if chosen:
            chosen.sort(key=lambda pair: pair[1].time_s[0])
            tables[sensor] = _follow([table for _, table in chosen])
            geoid = chosen[0][0].log.geoid if sensor == "fix" else geoid
    raw = _raw(parts, notes)
    if "fix" not in tables and (raw is None or not len(raw.signals)):
        _refuse(parts)
    first = parts[0].log
    tables = {sensor: tables.get(sensor, type(table).empty()) for sensor, table in first.tables().items()}
    return replace(
        first,
        source_format="+".join(dict.fromkeys(part.log.source_format for part in parts)),
        outages_s=np.unique(np.concatenate([part.log.outages_s for part in parts])),
        geoid=geoid,
        skipped=notes.skipped + sum((part.log.skipped for part in parts), Counter()),
        repaired=notes.repaired + sum((part.log.repaired for part in parts), Counter()),
        warnings=(
            *(f"{part.name}: {sentence}" for part in parts for sentence in part.log.warnings),
            *notes.warnings,
        ),
        raw=raw,
        device=_device(parts, notes),
        **tables,
    )


def _device(parts: Sequence[Part], notes: Notes) -> DeviceMotion:
    joined: dict[str, SensorTable] = {}
    for name in DeviceMotion().tables():
        having = [(part, table) for part in parts if len(table := part.log.device.tables()[name])]
        used = _not_overlapping([(part, table.time_s, len(table)) for part, table in having], name, notes)
        chosen = sorted((t for part, t in having if part in used), key=lambda t: float(t.time_s[0]))
        joined[name] = _follow(list(chosen)) if chosen else ThreeAxes.empty()
    return DeviceMotion(**joined)  # type: ignore[arg-type]


def _refuse(parts: Sequence[Part]) -> None:
    names = ", ".join(part.name for part in parts)
    if all(part.log.raw is not None for part in parts):
        raise EmptyLogError(
            f"There are navigation data ({names}) and no measurements: they belong to a file of observations. Upload "
            "both together."
        )
    raise EmptyLogError(
        f"These files hold no usable position, nor raw measurements to make one of: {names}. Upload the receiver's "
        "log with them."
    )


def _not_overlapping(having: list[tuple[Part, Floats, int]], what: str, notes: Notes) -> list[Part]:
    """The parts to use, the fullest first; one that overlaps in time with a fuller one is left out with a warning."""
    used: list[tuple[Part, Floats, int]] = []
    for part, time_s, count in sorted(having, key=lambda one: -one[2]):
        rival = next((u for u in used if time_s[0] <= u[1][-1] and u[1][0] <= time_s[-1]), None)
        if rival is None:
            used.append((part, time_s, count))
        else:
            notes.warn(
                f"{part.name} and {rival[0].name} both have {what} for the same times: the {rival[2]} of "
                f"{rival[0].name} are used, the {count} of {part.name} are not."
            )
    return [part for part, _, _ in used]


def _follow(tables: list[SensorTable]) -> SensorTable:
    kind = type(tables[0])
    return kind(
        **{f.name: np.concatenate([getattr(table, f.name) for table in tables]) for f in fields(kind)}
    )


def _raw(parts: Sequence[Part], notes: Notes) -> RawGnss | None:
    bringing = [(part, part.log.raw) for part in parts if part.log.raw is not None]
    if not bringing:
        return None
    having = [(part, raw.signals) for part, raw in bringing if len(raw.signals)]
    used = _not_overlapping([(part, s.time_s, len(s)) for part, s in having], "raw measurements", notes)
    signals = _signals([s for part, s in having if part in used])
    navigation = Navigation()
    for _, raw in bringing:
        navigation = navigation.joined(raw.navigation)
    return RawGnss(signals, navigation)


def _signals(parts: list[Signals]) -> Signals:
    """One table of those that follow each other."""
    if not parts:
        return Signals.empty()
    parts = sorted(parts, key=lambda s: float(s.gps_s[0]))
    counts = np.concatenate([np.diff(s.first) for s in parts])
    columns = {
        f.name: np.concatenate([getattr(s, f.name) for s in parts])
        for f in fields(Signals)
        if f.name != "first"
    }
    return Signals(first=np.append(0, np.cumsum(counts)), **columns)
