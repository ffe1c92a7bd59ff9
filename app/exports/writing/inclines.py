"""Where ``incline=*`` of OpenStreetMap could be told better: sections of ways that are steep beyond doubt.

In OpenStreetMap ``incline`` is the practical maximum of a steep section, in percent, positive uphill in the direction
in which the way is drawn, and the way is split where the section begins and ends. So a section here is a run of
consecutive segments of one way that were measured steep in one direction; its value is its steepest 20 m. Its
description is for a person who looks at it: nothing here is an edit. Knows no form of file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import accumulate, compress
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from app.exports.format import NoOptions
from app.exports.writing.osm_files import OsmNode, OsmWay, read_ways
from app.map.segment import Segment

if TYPE_CHECKING:
    from app.exports.source import Source

STEEPEST_M = 20.0
"""Over which the steepest grade is a mean, as everywhere in the service."""
DIP_M = 20.0
"""So short a stretch in between that is less steep does not end a section."""
LEAST_SHARE = 0.8
"""Of a segment's length over which drives must be accepted."""

_NUMBER = re.compile(r"([-+]?\d+(?:[.,]\d+)?)\s*(%|°)?")
_Key = tuple[int, int, int]


class Only(StrEnum):
    """Which sections are proposed."""

    BOTH = "both"
    UNTAGGED = "untagged"
    CONFLICT = "conflict"


class InclineOptions(NoOptions):
    """What is beyond doubt."""

    min_percent: float = Field(5.0, ge=1, le=50, description="How steep every part of a section is at least.")
    z: float = Field(3.0, ge=1, le=100, description="Its mean slope is so many times its sigma, at least.")
    min_drives: int = Field(2, ge=1, description="So many drives measured each of its segments, at least.")
    min_length_m: float = Field(30.0, ge=5, description="How long a section is at least.")
    conflict_percent: float = Field(
        3.0, ge=0, description="A tag that differs by more is in conflict with what was measured."
    )
    only: Only = Field(Only.BOTH, description="untagged, conflict or both.")


@dataclass(frozen=True)
class Section:
    """A steep part of a way: from its node number ``first`` to ``last`` (positions in the way)."""

    way: OsmWay
    first: int
    last: int
    percent: int
    """The value for the tag, signed along the way."""
    percent_sigma: float
    mean_percent: float
    sigma_percent: float
    """Of the mean, as if the errors of all segments were one."""
    drives: int
    """Of the segment with the fewest."""
    length_m: float
    whole: bool
    """It is the way, but for less than the shortest section."""
    open_ends: tuple[bool, bool]
    """Whether the way goes on unmeasured at its beginning and end, so that the section may go on, too."""

    @property
    def from_node(self) -> int:
        """Where it begins."""
        return self.way.nodes[self.first]

    @property
    def to_node(self) -> int:
        """Where it ends."""
        return self.way.nodes[self.last]

    @property
    def value(self) -> str:
        """The proposed value of ``incline``."""
        return f"{self.percent}%"

    @property
    def tagged(self) -> str | None:
        """The value of today."""
        return self.way.tags.get("incline")

    def describe(self) -> str:
        """What was measured and what it would mean, for the person who decides."""
        towards = "uphill" if self.percent > 0 else "downhill"
        where = (
            "the whole way"
            if self.whole
            else f"the part from node {self.from_node} to node {self.to_node}, where the way would be split"
        )
        today = "no incline" if self.tagged is None else f"incline={self.tagged}"
        text = (
            f"Way {self.way.id}: {self.length_m:.0f} m were measured at {self.mean_percent:+.1f} % "
            f"(sigma {self.sigma_percent:.1f} %) by {self.drives} or more drives, the steepest {STEEPEST_M:.0f} m at "
            f"{self.percent} % (sigma {self.percent_sigma:.1f} %), {towards} in the direction of the way. "
            f"Proposed: incline={self.value} on {where}. Today: {today}."
        )
        if any(self.open_ends):
            ends = map(str, compress((self.from_node, self.to_node), self.open_ends))
            text += f" Beyond node {' and node '.join(ends)} nothing was measured: it may go on being steep."
        return text + " Look at it before you change anything."


def proposals(
    source: Source, options: InclineOptions
) -> Iterator[tuple[OsmWay, list[Section], Mapping[int, OsmNode]]]:
    """Ways with the sections that are worth telling, in the order of their numbers; and all their nodes' places."""
    steep = {
        segment.osm_way_id
        for segment in source.segments(driven=True)
        if segment.slope_percent is not None and abs(segment.slope_percent) >= options.min_percent
    }
    measured: dict[_Key, Segment] = {
        (segment.osm_way_id, segment.from_node, segment.to_node): segment
        for segment in source.segments(driven=True)
        if segment.osm_way_id in steep and segment.slope_percent is not None
    }
    ways, nodes = read_ways(source.road_files, steep)
    for way in ways:
        chosen = worth_telling(list(sections(way, measured, options)), options)
        if chosen and all(node in nodes for node in way.nodes):
            yield way, chosen, nodes


def sections(way: OsmWay, measured: Mapping[_Key, Segment], options: InclineOptions) -> Iterator[Section]:
    """The steep sections of a way, by what was measured of its segments, from its first node on."""
    line = [measured.get((way.id, a, b)) for a, b in zip(way.nodes, way.nodes[1:], strict=False)]
    first = 0
    while first < len(line):
        last = _run(line, first, options.min_percent)
        if last > first:
            section = _section(way, line, first, last, options)
            if section is not None:
                yield section
        first = max(last, first + 1)


def _sign(segment: Segment | None, least_percent: float) -> int:
    """Of a slope that is at least so steep; 0 of any other, and where too little was driven."""
    if segment is None or segment.slope_percent is None or abs(segment.slope_percent) < least_percent:
        return 0
    if segment.driven_share is not None and segment.driven_share < LEAST_SHARE:
        return 0
    return 1 if segment.slope_percent > 0 else -1


def _run(line: Sequence[Segment | None], first: int, least_percent: float) -> int:
    """Up to where (exclusive) it is steep from a segment on; a short dip between steep parts counts as steep."""
    sign = _sign(line[first], least_percent)
    end, dip_m = first, 0.0
    for k in range(first, len(line) if sign else first):
        segment = line[k]
        if _sign(segment, least_percent) == sign:
            end, dip_m = k + 1, 0.0
            continue
        dip_m += math.inf if segment is None else segment.length_m
        if dip_m > DIP_M or _sign(segment, 0.0) != sign:
            break
    return end


def _section(
    way: OsmWay, line: Sequence[Segment | None], first: int, last: int, options: InclineOptions
) -> Section | None:
    """The section of these segments, or None where it is not beyond doubt."""
    part = [segment for segment in line[first:last] if segment is not None]
    length = sum(s.length_m for s in part)
    mean = sum((s.slope_percent or 0.0) * s.length_m for s in part) / length
    sigma = sum((s.slope_sigma_percent or math.inf) * s.length_m for s in part) / length
    drives = min(s.drives for s in part)
    if length < options.min_length_m or drives < options.min_drives or abs(mean) < options.z * sigma:
        return None
    rest = sum(0.0 if s is None else s.length_m for s in (*line[:first], *line[last:]))
    beyond = [k for k in (first - 1, last) if 0 <= k < len(line)]
    whole = not beyond or (rest < options.min_length_m and all(line[k] is not None for k in beyond))
    open_ends = (first > 0 and line[first - 1] is None, last < len(line) and line[last] is None)
    steepest, doubt = steepest_percent(part, 1 if mean > 0 else -1)
    return Section(way, first, last, round(steepest), doubt, mean, sigma, drives, length, whole, open_ends)


def steepest_percent(part: Sequence[Segment], sign: int) -> tuple[float, float]:
    """The steepest mean grade of that sign over 20 m of consecutive segments, or over all where that is shorter, and
    its sigma; percent.

    Steepest is what is steepest for sure, a sigma below what was measured: one doubtful metre makes no wall.
    """
    along = list(accumulate((s.length_m for s in part), initial=0.0))
    height = list(accumulate(((s.slope_percent or 0.0) * s.length_m for s in part), initial=0.0))
    doubt = list(accumulate(((s.slope_sigma_percent or 0.0) * s.length_m for s in part), initial=0.0))
    window = min(STEEPEST_M, along[-1])
    starts = {
        start for place in along for start in (place, place - window) if 0 <= start <= along[-1] - window
    }
    ends = np.array(sorted(starts | {0.0}))
    grade, sigma = (
        (np.interp(ends + window, along, column) - np.interp(ends, along, column)) / window
        for column in (height, doubt)
    )
    candidates = list(zip(grade.tolist(), sigma.tolist(), strict=True))
    candidates += [
        (s.steepest_percent, s.slope_sigma_percent or 0.0)
        for s in part
        if s.steepest_percent is not None and s.length_m >= STEEPEST_M
    ]
    return max(candidates, key=lambda one: sign * one[0] - one[1])


def tagged_percent(tag: str) -> float | None:
    """The number in a value of ``incline``, percent; None for ``up``, ``down`` and what is no number."""
    match = _NUMBER.fullmatch(tag.strip())
    if match is None:
        return None
    number = float(match[1].replace(",", "."))
    return 100 * math.tan(math.radians(number)) if match[2] == "°" else number


def conflicts(tag: str, percent: float, tolerance_percent: float) -> bool:
    """Whether a tag says something else than what was measured; ``up`` and ``down`` say the direction alone."""
    number = tagged_percent(tag)
    if number is not None:
        return abs(number - percent) > tolerance_percent
    return {"up": 1, "down": -1}.get(tag.strip().lower(), 0) != (1 if percent > 0 else -1)


def worth_telling(sections: Sequence[Section], options: InclineOptions) -> list[Section]:
    """Of a way's sections those that are worth a person's time.

    A number that one of them agrees with is left in peace: it is meant for the steepest of the way. A tag that says
    the direction alone counts as none where it says the right one.
    """
    limit = options.conflict_percent
    if any(
        tagged_percent(s.tagged or "") is not None and not conflicts(s.tagged or "", s.percent, limit)
        for s in sections
    ):
        return []
    in_conflict = [s for s in sections if s.tagged is not None and conflicts(s.tagged, s.percent, limit)]
    if options.only is Only.BOTH:
        return list(sections)
    return [s for s in sections if (s in in_conflict) == (options.only is Only.CONFLICT)]
