"""The header of a RINEX file: which kind and version it is, and what the rows after it mean."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from fusion.errors import MalformedLogError
from fusion.formats.rinex.lines import Lines
from fusion.messages import say
from fusion.signals import SYSTEMS

LABEL_AT = 60
LONGEST_HEADER_LINES = 20_000
_END = "END OF HEADER"
_SCALES = {"GPS", "GLO", "GAL", "BDT", "QZS", "IRN"}
_SCALE_OF = {"R": "GLO", "E": "GAL", "C": "BDT", "J": "QZS", "I": "IRN"}
"""Time scales of files with one system only, where none is stated (RINEX 3.04, table A2, TIME OF FIRST OBS)."""
_KINDS = {
    "M": "meteorological data",
    "C": "clock corrections",
    "S": "a summary",
    "B": "broadcast data of SBAS",
}


@dataclass
class Header:
    """What the header says; ``types`` are the codes by system letter, under a blank those of version 2.

    ``scale_factor`` gives what values are to be divided by, by system letter and code. ``channel`` is that of GLONASS
    slots. ``lines`` counts the header's lines. ``alpha`` and ``beta`` are Klobuchar's, empty where not stated.
    """

    version: float
    kind: str
    system: str
    time_scale: str = ""
    types: dict[str, list[str]] = field(default_factory=dict)
    scale_factor: dict[tuple[str, str], float] = field(default_factory=dict)
    channel: dict[int, int] = field(default_factory=dict)
    alpha: tuple[float, ...] = ()
    beta: tuple[float, ...] = ()
    place_m: tuple[float, ...] = ()
    """ECEF, of the marker; nothing where not stated."""
    antenna_m: tuple[float, ...] = ()
    """Of the antenna above the marker: up, east, north."""
    lines: int = 0
    _system_of_list: str = " "

    @property
    def is_observations(self) -> bool:
        """Whether measurements follow."""
        return self.kind == "O"

    def take(self, line: str) -> None:
        """Take one line of the header, or of one in mid-file."""
        content, label = line[:LABEL_AT].ljust(LABEL_AT), line[LABEL_AT:].strip()
        if label == "SYS / # / OBS TYPES":
            self._take_types(content, content[0], content[3:6], 7)
        elif label == "# / TYPES OF OBSERV":
            self._take_types(content, " ", content[:6], 6)
        elif label == "SYS / SCALE FACTOR":
            self._take_factor(content)
        elif label == "GLONASS SLOT / FRQ #":
            matches = re.findall(r"R\s?(\d{1,2})\s+([+-]?\d{1,2})", content)
            self.channel.update((int(slot), int(channel)) for slot, channel in matches)
        elif label == "TIME OF FIRST OBS":
            scale = content[48:51].strip().upper()
            self.time_scale = scale if scale in _SCALES else self.time_scale
        elif label == "APPROX POSITION XYZ":
            self.place_m = _numbers(content, 3)
        elif label == "ANTENNA: DELTA H/E/N":
            self.antenna_m = _numbers(content, 3)
        elif label == "ION ALPHA" or content.startswith("GPSA"):
            self.alpha = _four(content, 2 if label == "ION ALPHA" else 5)
        elif label == "ION BETA" or content.startswith("GPSB"):
            self.beta = _four(content, 2 if label == "ION BETA" else 5)

    def _take_types(self, content: str, system: str, count: str, at: int) -> None:
        """One line of a list of types; lines without a count go on with the list before."""
        if count.strip():
            self._system_of_list = system
            self.types[system] = []
        self.types.setdefault(self._system_of_list, []).extend(content[at:].split())

    def _take_factor(self, content: str) -> None:
        factor = content[2:6].strip()
        if factor.isdigit() and int(factor) > 0:
            codes = content[10:].split() or self.types.get(content[0], [])
            self.scale_factor.update({(content[0], code): float(factor) for code in codes})

    @property
    def scale(self) -> str:
        """The scale of the epochs' times."""
        return self.time_scale or _SCALE_OF.get(self.system, "GPS")

    @property
    def klobuchar(self) -> tuple[float, ...] | None:
        """The eight parameters, where both halves are there and not all of them are 0."""
        both = self.alpha + self.beta
        return both if len(both) == 8 and any(both) else None


def read_header(lines: Lines) -> Header:
    """Read it; raises ``MalformedLogError`` if it is not whole or says that the file is of a kind that is not read."""
    header = _first(lines.line(0) if len(lines) else "")
    for index in range(1, min(len(lines), LONGEST_HEADER_LINES)):
        line = lines.line(index)
        if line[LABEL_AT:].strip() == _END:
            header.lines = index + 1
            if header.is_observations and not any(header.types.values()):
                raise MalformedLogError(
                    say("rinex.no_types"),
                    where=say("place.line", n=header.lines),
                )
            return header
        header.take(line)
    raise MalformedLogError(
        say("rinex.no_header_end", n=min(len(lines), LONGEST_HEADER_LINES), END=_END),
        where=say("place.line", n=len(lines)),
    )


def _first(line: str) -> Header:
    stated = re.match(r"\s*(\d{1,2}(?:\.\d{0,3})?)\s", line[:20] + " ")
    version = float(stated.group(1)) if stated else 0.0
    kind, system = line[20:21].upper(), line[40:41].upper()
    if not 2 <= version < 5:
        raise MalformedLogError(
            say("rinex.version", version=line[:9].strip()[:9]),
            where="line 1",
        )
    if version < 3 and kind in "GHEJL":  # a navigation file of that system alone
        kind, system = "N", {"G": "R", "H": "S", "L": "E"}.get(kind, kind)
    elif version < 3 and kind == "N" and system not in SYSTEMS + "M":
        system = "G"
    if kind not in ("O", "N"):
        raise MalformedLogError(
            say("rinex.other_kind", kind=_KINDS.get(kind, "neither observations nor navigation data")),
            where="line 1",
        )
    return Header(version, kind, system if system in SYSTEMS + "MI" else "G")


def _numbers(content: str, count: int) -> tuple[float, ...]:
    """So many numbers in 14 columns each, or none."""
    try:
        return tuple(float(content[14 * k : 14 * k + 14]) for k in range(count))
    except ValueError:
        return ()


def _four(content: str, at: int) -> tuple[float, ...]:
    cells = [content[at + 12 * k : at + 12 * k + 12].replace("D", "E").replace("d", "e") for k in range(4)]
    try:
        return tuple(float(cell) for cell in cells)
    except ValueError:
        return ()
