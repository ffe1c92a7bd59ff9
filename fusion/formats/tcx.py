"""TCX, Garmin's Training Center XML: track points with time, altitude and, where written, speed.

``Speed`` of the extensions (TPX) has no direction and may come from a wheel sensor: it is the vehicle's own signal.
``DistanceMeters`` is not used: without a wheel sensor it is summed from these positions, and with one the speed tells
the same. A new ``Track`` is a gap, as the timer was stopped; where a lap was counted and recording went on, it is none.
"""

from __future__ import annotations

import re

import numpy as np

from fusion.errors import EmptyLogError
from fusion.formats.base import Data, LogFormat, Notes, build_log, number_or_nan, usable_positions
from fusion.formats.glance import Ends, Told
from fusion.formats.xml_points import Layout, Points, excerpt, read_points
from fusion.messages import say
from fusion.types import Bools, DriveLog, Floats, GnssFix, Odometry, Progress, SensorTable

HEAD_BYTES = 8192
ROOT = re.compile(rb"<(?:[\w.-]+:)?TrainingCenterDatabase[\s>]")
SPORT = re.compile(rb"<(?:[\w.-]+:)?Activity\s[^>]*?\bSport\s*=\s*[\"']([^\"']{1,60})[\"']")
LAPS = re.compile(rb"<(?:[\w.-]+:)?(?:(Lap)[\s>]|Track[\s>]|DistanceMeters>([\d.]{1,20})<)")
"""A lap says of itself how long it is, before its points."""
LAPS_STEP_S = 10.0
"""A lap that follows within the longest step of devices that record at will had no pause before it."""
LAYOUT = Layout(
    what="TCX",
    point="Trackpoint",
    time="Time",
    attributes=(),
    fields={
        "LatitudeDegrees": "lat", "LongitudeDegrees": "lon", "AltitudeMeters": "alt", "Speed": "speed",
    },
    breaks=("Lap", "Track"),
    others=("Course", "Activity"),
)  # fmt: skip


class TcxFormat(LogFormat):
    """TCX activities of any program; courses and workouts are no drives."""

    name = "tcx"
    description = "TCX file"
    suffixes = (".tcx",)
    altitude_advice = say("advice.tcx_altitude")
    doppler_advice = say("advice.tcx_doppler")

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``."""
        return bool(ROOT.search(head[:HEAD_BYTES].replace(b"\x00", b"")))

    def told(self, ends: Ends) -> Told:
        """See ``LogFormat``: the activity's sport, and the metres of its laps where all of them are at hand."""
        found = SPORT.search(ends.head)
        sport = found.group(1).decode("utf-8", "replace") if found else ""
        laps, in_lap = list[float](), False
        for tag in LAPS.finditer(b"" if ends.tail else ends.head):
            if in_lap and tag.group(2):
                laps.append(number_or_nan(tag.group(2).decode()))
            in_lap = bool(tag.group(1))
        return Told(sport, sum(laps) if laps else np.nan)

    def excerpt(self, ends: Ends) -> bytes:
        """See ``LogFormat``."""
        return excerpt(ends, LAYOUT)

    def read(self, data: Data, progress: Progress) -> DriveLog:
        """See ``LogFormat``."""
        notes = Notes()
        points = read_points(data, LAYOUT, notes, progress)
        _refuse_undriven(points)
        lat, lon, alt, speed = (points.column(name) for name in ("lat", "lon", "alt", "speed"))
        placed = np.isfinite(lat) | np.isfinite(lon)
        notes.skip("track points without a position", int((~placed).sum()))
        good = usable_positions(
            points.time_s, lat, lon, notes, lambda i: say("place.track_point", n=i + 1), need=placed
        )
        moving = good & (speed >= 0)
        here = good & placed
        fix = GnssFix.assemble(
            points.time_s[here], notes.repaired, lat_deg=lat[here], lon_deg=lon[here], alt_msl_m=alt[here]
        )
        odometry = Odometry.assemble(points.time_s[moving], speed_mps=speed[moving])
        tables: dict[str, SensorTable] = {"fix": fix, "odometry": odometry}
        return build_log(self, notes, tables, outages_s=_gaps(points, here))


def _refuse_undriven(points: Points) -> None:
    """Raise ``EmptyLogError`` for what nobody drove."""
    if points.others.get("Course") and not points.others.get("Activity"):
        raise EmptyLogError(say("tcx.course"))
    if not len(points):
        raise EmptyLogError(say("tcx.no_track"))
    if not np.isfinite(points.column("lat")).any():
        raise EmptyLogError(say("tcx.no_positions", n=len(points)))
    if not points.timed:
        raise EmptyLogError(say("tcx.no_times", n=len(points)))


def _gaps(points: Points, here: Bools) -> Floats:
    """The first position of each track, save the first, and save those of laps that follow at once."""
    time_s = points.time_s[here]
    track, lap = points.pieces("Track")[here], points.pieces("Lap")[here]
    begins = np.flatnonzero(np.diff(track) != 0) + 1
    lap_only = (np.diff(lap)[begins - 1] != 0) & (time_s[begins] - time_s[begins - 1] <= LAPS_STEP_S)
    return np.asarray(time_s[begins[~lap_only]])
