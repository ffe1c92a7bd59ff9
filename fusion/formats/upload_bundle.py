"""The files of an upload bundle as one log: their tables, raw measurements and ephemerides are joined.

Knows no format.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np

from fusion.errors import EmptyLogError
from fusion.formats.base import Notes
from fusion.messages import say
from fusion.signals import Navigation, RawGnss, Signals
from fusion.types import DeviceMotion, DriveLog, SensorTable, ThreeAxes

Table = TypeVar("Table", bound=SensorTable | Signals)


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
    first, geoid = parts[0].log, "unknown"
    for sensor, own in first.tables().items():
        chosen = _not_overlapping([(part, part.log.tables()[sensor]) for part in parts], sensor, notes)
        tables[sensor] = type(own).empty().joined(*(table for _, table in chosen))
        geoid = chosen[0][0].log.geoid if sensor == "fix" and chosen else geoid
    raw = _raw(parts, notes)
    if not len(tables["fix"]) and (raw is None or not len(raw.signals)):
        _refuse(parts)
    return replace(
        first,
        source_format="+".join(dict.fromkeys(part.log.source_format for part in parts)),
        outages_s=np.unique(np.concatenate([part.log.outages_s for part in parts])),
        geoid=geoid,
        skipped=notes.skipped + sum((part.log.skipped for part in parts), Counter()),
        repaired=notes.repaired + sum((part.log.repaired for part in parts), Counter()),
        warnings=(
            *(
                say("bundle.of", name=part.name, sentence=sentence)
                for part in parts
                for sentence in part.log.warnings
            ),
            *notes.warnings,
        ),
        raw=raw,
        device=_device(parts, notes),
        **tables,
    )


def _device(parts: Sequence[Part], notes: Notes) -> DeviceMotion:
    joined = {}
    for name in DeviceMotion().tables():
        chosen = _not_overlapping([(part, part.log.device.tables()[name]) for part in parts], name, notes)
        joined[name] = ThreeAxes.empty().joined(*(table for _, table in chosen))
    return DeviceMotion(**joined)


def _refuse(parts: Sequence[Part]) -> None:
    names = ", ".join(part.name for part in parts)
    if all(part.log.raw is not None for part in parts):
        raise EmptyLogError(say("bundle.navigation_only", names=names))
    raise EmptyLogError(say("bundle.nothing_usable", names=names))


def _not_overlapping(tables: list[tuple[Part, Table]], what: str, notes: Notes) -> list[tuple[Part, Table]]:
    """The tables to use, in the order of time; one that overlaps with a fuller one is left out with a warning."""
    used: list[tuple[Part, Table]] = []
    for part, table in sorted(tables, key=lambda one: -len(one[1])):
        if not len(table):
            break
        time_s = table.time_s
        rival = next((u for u in used if time_s[0] <= u[1].time_s[-1] and u[1].time_s[0] <= time_s[-1]), None)
        if rival is None:
            used.append((part, table))
        else:
            notes.warn(
                say(
                    "bundle.rivals",
                    name=part.name,
                    other=rival[0].name,
                    what=what,
                    used=len(rival[1]),
                    unused=len(table),
                )
            )
    return sorted(used, key=lambda one: float(one[1].time_s[0]))


def _raw(parts: Sequence[Part], notes: Notes) -> RawGnss | None:
    bringing = [(part, part.log.raw) for part in parts if part.log.raw is not None]
    if not bringing:
        return None
    measured = _not_overlapping([(part, raw.signals) for part, raw in bringing], "raw measurements", notes)
    navigation = Navigation()
    for _, raw in bringing:
        navigation = navigation.joined(raw.navigation)
    places = (raw.place_m for _, raw in bringing if raw.place_m is not None)
    return RawGnss(_signals([signals for _, signals in measured]), navigation, next(places, None))


def _signals(parts: list[Signals]) -> Signals:
    """One table of those that follow each other."""
    parts = [Signals.empty(), *parts]
    counts = np.concatenate([np.diff(s.first) for s in parts])
    names = [spec.name for spec in fields(Signals) if spec.name != "first"]
    columns = {name: np.concatenate([getattr(s, name) for s in parts]) for name in names}
    return Signals(first=np.append(0, np.cumsum(counts)), **columns)
