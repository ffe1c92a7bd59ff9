"""GPX 1.0 and 1.1: track points with time, elevation and, where written, speed and course."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any
from xml.etree.ElementTree import ParseError

import numpy as np
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import iterparse

from fusion.errors import EmptyLogError, MalformedLogError
from fusion.formats.base import Data, Notes, build_log, ground_velocity, unix_seconds, usable_positions
from fusion.types import DriveLog, Floats, GnssFix, GnssVelocity, Progress

ROOT = re.compile(rb"<(?:[\w.-]+:)?gpx[\s>]")
NAN = float("nan")
PROGRESS_EVERY = 1 << 14
_VALUES = ("ele", "geoidheight", "speed", "course")


@dataclass
class _Points:
    """Track points in file order; ``segment`` numbers the track segments of all tracks together."""

    time: list[str | None] = field(default_factory=list)
    lat: list[float] = field(default_factory=list)
    lon: list[float] = field(default_factory=list)
    values: list[tuple[float, ...]] = field(default_factory=list)
    segment: list[int] = field(default_factory=list)
    others: int = 0


class GpxFormat:
    """GPX tracks of any program; routes and waypoints are no drives."""

    name = "gpx"
    description = "GPX file"
    suffixes = (".gpx",)
    altitude_advice = (
        "Export the recorded track with elevation (`<ele>`), as measured and not replaced by a map's."
    )
    doppler_advice = (
        "GPX tracks have no vertical velocity: record with an app or receiver that writes more, such as "
        "GnssLogger with measurements or UBX-NAV-PVT."
    )

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``."""
        return bool(ROOT.search(head[:8192].replace(b"\x00", b"")))

    def read(self, data: Data, progress: Progress) -> DriveLog:
        """See ``LogFormat``."""
        notes = Notes()
        points = _parse(data, notes, progress)
        if not points.time:
            what = "routes or waypoints, but no track" if points.others else "no track"
            raise EmptyLogError(f"This GPX file holds {what}. Export the recorded track, with times.")
        if not any(points.time):
            raise EmptyLogError(
                f"None of the {len(points.time)} track points of this GPX file has a time, "
                "so it tells no drive. Export the track with times (not a planned route)."
            )
        return _assemble(points, notes)


def _parse(data: Data, notes: Notes, progress: Progress) -> _Points:
    points = _Points()
    stream = io.BytesIO(data)
    try:
        segment = -1
        for element in _finished(stream):
            tag = _local(element.tag)
            if tag == "trkseg":
                segment += 1
            elif tag == "trkpt":
                _add(points, element, segment + 1)
                if len(points.time) % PROGRESS_EVERY == 0:
                    progress("read points", stream.tell() / len(data))
            elif tag in ("rtept", "wpt"):
                points.others += 1
    except DefusedXmlException as error:
        raise MalformedLogError(
            "This GPX file defines XML entities, as attacks do and recorders never. Export it again."
        ) from error
    except (ParseError, ValueError, LookupError) as error:
        line = getattr(error, "position", (0, 0))[0]
        where = f"line {line}" if line else "the beginning"
        if not points.time:
            raise MalformedLogError(
                f"This GPX file is broken at {where}, before its first track point. Upload the whole file.",
                where=where,
            ) from error
        notes.repaired["broken XML: read up to the break"] += 1
        notes.warn(f"The GPX file is broken at {where}: the {len(points.time)} points before it are used.")
    return points


def _finished(stream: io.BytesIO) -> Iterator[Any]:
    """Elements as they end, those within a track point excepted; none is kept, so that memory stays flat."""
    above: list[Any] = []
    point = None
    for event, element in iterparse(stream, events=("start", "end")):
        if event == "start":
            above.append(element)
            if point is None and _local(element.tag) == "trkpt":
                point = element
            continue
        above.pop()
        if point is None or element is point:
            point = None
            yield element
            if above:
                del above[-1][:]


def _local(tag: str) -> str:
    return tag.rpartition("}")[2]


def _number(text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        return NAN
    return value if np.isfinite(value) else NAN


def _add(points: _Points, element: Any, segment: int) -> None:
    """Speed and course stand in the point itself (GPX 1.0) or in its extensions (1.1)."""
    found: dict[str, str | None] = {}
    for child in element.iter():
        found.setdefault(_local(child.tag), child.text)
    points.time.append((found.get("time") or "").strip() or None)
    points.lat.append(_number(element.get("lat")))
    points.lon.append(_number(element.get("lon")))
    points.values.append(tuple(_number(found.get(name)) for name in _VALUES))
    points.segment.append(segment)


def _assemble(points: _Points, notes: Notes) -> DriveLog:
    time_s = unix_seconds(points.time)
    lat, lon = np.array(points.lat), np.array(points.lon)
    elevation, separation, speed, course = np.array(points.values, float).reshape(-1, len(_VALUES)).T
    unread = np.flatnonzero(np.isnan(time_s) & np.array([t is not None for t in points.time]))
    if len(unread):
        example = f"point {unread[0] + 1}: {points.time[unread[0]]!r:.60} is no time"
        notes.skip("times that cannot be read", len(unread), example, position=True)
    good = usable_positions(time_s, lat, lon, notes, lambda i: f"track point {i + 1}")
    fix = GnssFix.assemble(
        time_s[good],
        notes.repaired,
        lat_deg=lat[good],
        lon_deg=lon[good],
        alt_msl_m=elevation[good],
        height_ell_m=(elevation + separation)[good],
    )
    north, east = ground_velocity(speed, np.radians(course))
    velocity = GnssVelocity.assemble(time_s[good], vel_n_mps=north[good], vel_e_mps=east[good])
    gaps = _gaps(time_s[good], np.array(points.segment)[good])
    return build_log("gpx", "GPX file", notes, {"fix": fix, "velocity": velocity}, gaps_s=gaps)


def _gaps(time_s: Floats, segment: np.ndarray[Any, np.dtype[np.int64]]) -> Floats:
    """The time of each segment's first point, save the first segment's."""
    begins = np.flatnonzero(np.diff(segment) != 0) + 1
    return time_s[begins]
