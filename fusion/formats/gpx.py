"""GPX 1.0 and 1.1: track points with time, elevation and, where written, speed, course and accuracy.

What stands in the point itself (GPX 1.0) and what programs write into its extensions is told by the same names:

- ``speed`` (m/s) and ``course`` (Garmin's TrackPointExtension v2, Apple), ``cog`` (Coros) or ``bearing`` (Android's
  direction of movement) make a velocity; a speed without a direction is the vehicle's own signal. ``heading`` is not
  used: OsmAnd writes the phone's compass there.
- ``hAcc``, ``vAcc`` (Apple), ``hacc``, ``vacc``, ``sacc`` and OpenTracks' ``accuracy_horizontal`` and
  ``accuracy_vertical`` are one-sigma accuracies, metres (m/s).
- ``hdop`` is a dilution, by which errors of unknown size are multiplied, and says nothing in metres: except from OsmAnd
  and Locus, which write Android's accuracy in metres there. ``vdop`` and ``pdop`` are not used.
- ``geoidheight`` makes ellipsoidal heights of elevations. Temperatures (``atemp``) are of no use without a pressure.
"""

from __future__ import annotations

import re

import numpy as np

from fusion.errors import EmptyLogError
from fusion.formats.base import Data, LogFormat, Notes, build_log, fix_and_velocity, usable_positions
from fusion.formats.glance import Ends, Told, along_m
from fusion.formats.xml_points import Layout, Points, excerpt, read_points
from fusion.messages import say
from fusion.types import Bools, DriveLog, Floats, Odometry, Progress, SensorTable

HEAD_BYTES = 8192
ROOT = re.compile(rb"<(?:[\w.-]+:)?gpx[\s>]")
METRES_AS_HDOP = re.compile(rb"<(?:[\w.-]+:)?gpx\s[^>]*\bcreator\s*=\s*[\"']\s*(?:OsmAnd|Locus)")
TRACK = re.compile(rb"<(?:[\w.-]+:)?trk[\s>]")
SPORT = re.compile(rb"<(?:[\w.-]+:)?type>([^<]{1,60})<")
POINT = re.compile(rb"<(?:[\w.-]+:)?(?:trkpt|trkseg)[\s>]")
PLACE = re.compile(rb"<(?:[\w.-]+:)?trkpt\s+lat=[\"'](-?[\d.]+)[\"']\s+lon=[\"'](-?[\d.]+)[\"']")
LAYOUT = Layout(
    what="GPX",
    point="trkpt",
    time="time",
    attributes=("lat", "lon"),
    fields={
        "ele": "ele", "geoidheight": "geoidheight", "speed": "speed", "course": "course", "cog": "cog",
        "bearing": "bearing", "hdop": "hdop", "hAcc": "h_acc", "hacc": "h_acc", "accuracy_horizontal": "h_acc",
        "vAcc": "v_acc", "vacc": "v_acc", "accuracy_vertical": "v_acc", "sacc": "s_acc",
    },
    breaks=("trkseg",),
    others=("rtept", "wpt"),
)  # fmt: skip


class GpxFormat(LogFormat):
    """GPX tracks of any program; routes and waypoints are no drives."""

    name = "gpx"
    description = "GPX file"
    suffixes = (".gpx",)
    altitude_advice = say("advice.gpx_altitude")
    doppler_advice = say("advice.gpx_doppler")

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``."""
        return bool(ROOT.search(_beginning(head)))

    def told(self, ends: Ends) -> Told:
        """See ``LogFormat``: ``type`` of the track, and the way along its points where all of them are at hand."""
        track, first = TRACK.search(ends.head), POINT.search(ends.head)
        end = first.start() if first else len(ends.head)
        found = SPORT.search(ends.head, track.start(), end) if track else None
        sport = found.group(1).decode("utf-8", "replace").strip() if found else ""
        if ends.tail:
            return Told(sport)
        places = [(float(lat), float(lon)) for lat, lon in PLACE.findall(ends.head) if lat.count(b".") < 2]
        return Told(sport, along_m(np.array(places).reshape(-1, 2)))

    def excerpt(self, ends: Ends) -> bytes:
        """See ``LogFormat``."""
        return excerpt(ends, LAYOUT)

    def read(self, data: Data, progress: Progress) -> DriveLog:
        """See ``LogFormat``."""
        notes = Notes()
        points = read_points(data, LAYOUT, notes, progress)
        if not len(points):
            what = "routes or waypoints, but no track" if points.others else "no track"
            raise EmptyLogError(say("gpx.no_track", kind=what))
        if not points.timed:
            raise EmptyLogError(say("gpx.no_times", n=len(points)))
        good = usable_positions(
            points.time_s,
            points.column("lat"),
            points.column("lon"),
            notes,
            lambda i: say("place.track_point", n=i + 1),
        )
        metres_as_hdop = METRES_AS_HDOP.search(_beginning(data)) is not None
        tables = _tables(points, good, metres_as_hdop, notes)
        return build_log(self, notes, tables, outages_s=_gaps(points, good))


def _beginning(data: Data) -> bytes:
    """The first bytes, of UTF-16 as if of ASCII."""
    return bytes(data[:HEAD_BYTES]).replace(b"\x00", b"")


def _tables(points: Points, good: Bools, metres_as_hdop: bool, notes: Notes) -> dict[str, SensorTable]:
    time_s = points.time_s[good]

    def column(*names: str) -> Floats:
        """The first of these that a point has."""
        out = points.column(names[0])[good]
        for name in names[1:]:
            if name in points.columns:
                out = np.where(np.isnan(out), points.column(name)[good], out)
        return out

    elevation, speed, course = column("ele"), column("speed"), column("course", "cog", "bearing")
    speed = np.where(speed >= 0, speed, np.nan)  # Apple writes -1 for unknown
    columns = {
        "lat_deg": column("lat"), "lon_deg": column("lon"), "alt_msl_m": elevation,
        "height_ell_m": elevation + column("geoidheight"),
        "h_acc_m": column("h_acc", "hdop") if metres_as_hdop else column("h_acc"), "v_acc_m": column("v_acc"),
        "speed_mps": speed, "course_deg": np.where(course >= 0, course, np.nan), "s_acc_mps": column("s_acc"),
    }  # fmt: skip
    tables = fix_and_velocity(time_s, columns, notes)
    alone = np.isfinite(speed) & ~np.isfinite(columns["course_deg"]) & (speed != 0)
    if alone.any():
        tables["odometry"] = Odometry.assemble(time_s[alone], speed_mps=speed[alone])
    return tables


def _gaps(points: Points, good: Bools) -> Floats:
    """The time of each segment's first point, save the first segment's."""
    segment = points.pieces("trkseg")[good]
    begins = np.flatnonzero(np.diff(segment) != 0) + 1
    return points.time_s[good][begins]
