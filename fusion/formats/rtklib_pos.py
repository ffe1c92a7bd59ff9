"""RTKLIB's solution files (``.pos``): one position a line, what the columns are of in comments that begin with %.

Source: the manual of RTKLIB 2.4.2, appendix B.1: positions as latitude, longitude and height or as earth-centred
coordinates, times as date and time or as week and second, in GPST, UTC or JST; velocities where they were asked for.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from fusion.errors import MalformedLogError
from fusion.formats.base import Data, LogFormat, Notes, build_log, positive, usable_positions
from fusion.formats.tables.cells import plain_columns
from fusion.formats.time_texts import times_of
from fusion.frames import geodetic
from fusion.messages import say
from fusion.signals import GPS_EPOCH_S, WEEK_S, unix_from_gps
from fusion.types import DriveLog, Floats, GnssFix, GnssVelocity, Ints, Progress, SensorTable

_HEADER = re.compile(
    rb"(?m)^%[ \t]+(?P<scale>GPST|UTC|JST)[ ,;\t]+(?P<columns>[^\r\n]*(?:\bQ\b)[^\r\n]*)", re.IGNORECASE
)
_KINDS = ("latitude(deg)", "latitude(d'\")", "x-ecef(m)", "e-baseline(m)")
_JST_AHEAD_S = 9 * 3600.0
_MOST_CELLS = 40
_TO_BLANKS = bytes.maketrans(b",;\t\r\v\f", b"      ")
_LARGEST = 1e12
"""No metre, degree or metre a second that is written is as large."""
_EARTH_M = (6_200_000.0, 6_500_000.0)


@dataclass(frozen=True)
class _Header:
    """What the comments say: the scale of time, the columns after the time, and whether heights are of a geoid."""

    scale: str
    columns: tuple[str, ...]
    geodetic: bool


class RtklibPosFormat(LogFormat):
    """Recognised by the comment that names the columns."""

    name = "rtklib-pos"
    description = "RTKLIB solution"
    suffixes = (".pos",)
    altitude_advice = say("advice.rtklib_altitude")
    doppler_advice = say("advice.rtklib_doppler")

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``."""
        return head.lstrip()[:1] == b"%" and _HEADER.search(head[:65536]) is not None

    def read(self, data: Data, progress: Progress) -> DriveLog:
        """See ``LogFormat``."""
        notes = Notes()
        text = bytes(data)
        header = _header(text)
        progress("read lines", 0.1)
        rows = _rows(text, header, notes)
        progress("read lines", 0.9)
        geoid = "as RTKLIB was told" if header.geodetic else "unknown"
        log = build_log(self, notes, _tables(rows, header, notes), geoid=geoid)
        progress("read lines", 1.0)
        return log


def _header(text: bytes) -> _Header:
    match = _HEADER.search(text[:65536])
    if match is None:
        raise MalformedLogError(
            say("rtklib.no_columns"),
            where=say("place.line", n=1),
        )
    columns = tuple(re.split(r"[ ,;\t]+", match.group("columns").decode("ascii", "replace").strip().lower()))
    if columns[0] == _KINDS[3]:
        raise MalformedLogError(say("rtklib.baselines"))
    if columns[0] not in _KINDS:
        raise MalformedLogError(say("rtklib.first_column", name=columns[0][:40]))
    comment = text[: match.start()].lower()
    return _Header(match.group("scale").decode().upper(), columns, b"/geodetic" in comment)


@dataclass(frozen=True)
class _Rows:
    """Times in seconds of the header's scale, since 1970 or since the GPS epoch, and the cells after them (n, k)."""

    time_s: Floats
    of_week: bool
    cells: Floats
    line: Ints


def _rows(text: bytes, header: _Header, notes: Notes) -> _Rows:
    """The lines with as many cells as the longest of the first hundred; the others are counted."""
    blanks = text.translate(_TO_BLANKS)
    while b"  " in blanks:
        blanks = blanks.replace(b"  ", b" ")
    lines = [(number, line.strip()) for number, line in enumerate(blanks.split(b"\n"), 1) if line[:1] != b"%"]
    lines = [(number, row) for number, row in lines if row]
    count = np.array([min(row.count(b" "), _MOST_CELLS) + 1 for _, row in lines], np.int64)
    least = 2 + (7 if header.columns[0] == _KINDS[1] else 3)
    width = int(count[:100].max(initial=0))
    good = (count == width) & (width >= least)
    if not good.all():
        first = int(np.argmin(good))
        example = say("rtklib.cells", line=lines[first][0], n=count[first], width=width)
        notes.skip("lines with another number of cells", int((~good).sum()), example, position=True)
    lines = [line for line, is_good in zip(lines, good, strict=True) if is_good]
    number = np.array([number for number, _ in lines], np.int64)
    if not lines:
        return _Rows(np.empty(0), False, np.empty((0, max(width, least) - 2)), number)
    rows = [row for _, row in lines]
    of_week = b"/" not in rows[0].split(b" ", 1)[0]
    names = {f"c{k}": k for k in range(0 if of_week else 2, width)}
    cells = np.column_stack(list(plain_columns(rows, " ", names).values()))
    if of_week:
        with np.errstate(over="ignore"):
            return _Rows(cells[:, 0] * WEEK_S + cells[:, 1], of_week, cells[:, 2:], number)
    times = [b" ".join(row.split(b" ", 2)[:2]).decode("ascii", "replace") for row in rows]
    return _Rows(times_of(times)[0], of_week, cells, number)


def _tables(rows: _Rows, header: _Header, notes: Notes) -> dict[str, SensorTable]:
    time_s = _unix(rows, header)
    cells = np.where(np.abs(rows.cells) < _LARGEST, rows.cells, np.nan)
    columns = list(header.columns)
    if columns[0] == _KINDS[1]:
        lat, lon = _sexagesimal(cells[:, 0:3]), _sexagesimal(cells[:, 3:6])
        cells = np.column_stack([lat, lon, cells[:, 6:]])
    col = {name: cells[:, k] for k, name in enumerate(columns[: cells.shape[1]])}
    nothing = np.full(len(time_s), np.nan)
    sigma = {axis: col.get(f"sd{axis}(m)", nothing) for axis in "neu"}
    if columns[0] == _KINDS[2]:
        lat, lon, height = _from_ecef(cells[:, :3])
    else:
        lat, lon, height = cells[:, 0], cells[:, 1], cells[:, 2]
    good = usable_positions(time_s, lat, lon, notes, lambda row: say("place.line", n=rows.line[row]))
    fix = GnssFix.assemble(
        time_s[good], notes.repaired, lat_deg=lat[good], lon_deg=lon[good],
        **{"alt_msl_m" if header.geodetic else "height_ell_m": height[good]},
        h_acc_m=positive(np.hypot(sigma["n"], sigma["e"]))[good], v_acc_m=positive(sigma["u"])[good],
    )  # fmt: skip
    velocity = _velocity(
        time_s[good], {name: column[good] for name, column in col.items()}, lat[good], lon[good]
    )
    return {"fix": fix, "velocity": velocity}


def _velocity(time_s: Floats, col: dict[str, Floats], lat_deg: Floats, lon_deg: Floats) -> GnssVelocity:
    """North, east and down, where the columns are there; of earth-centred ones turned into these."""
    nothing = np.full(len(time_s), np.nan)
    if "vn(m/s)" in col:
        axes = "neu"
        north, east, up = (col.get(f"v{axis}(m/s)", nothing) for axis in axes)
    elif "vx(m/s)" in col:
        axes = "xyz"
        vx, vy, vz = (col.get(f"v{axis}(m/s)", nothing) for axis in axes)
        lat, lon = np.radians(lat_deg), np.radians(lon_deg)
        level = np.cos(lon) * vx + np.sin(lon) * vy
        north, east = np.cos(lat) * vz - np.sin(lat) * level, np.cos(lon) * vy - np.sin(lon) * vx
        up = np.cos(lat) * level + np.sin(lat) * vz
    else:
        return GnssVelocity.empty()
    sigmas = [col.get(f"sdv{axis}", col.get(f"sdv{axis}(m/s)", nothing)) for axis in axes]
    # a mean of the axes, as receivers state the accuracy of speeds
    s_acc = positive(np.sqrt((sigmas[0] ** 2 + sigmas[1] ** 2 + sigmas[2] ** 2) / 3))
    still = (north == 0) & (east == 0) & (up == 0) & ~np.isfinite(s_acc)  # written where there is no Doppler
    directed = np.isfinite(north) & np.isfinite(east) & ~still
    return GnssVelocity.assemble(
        time_s[directed],
        vel_n_mps=north[directed],
        vel_e_mps=east[directed],
        vel_d_mps=-up[directed],
        s_acc_mps=s_acc[directed],
    )


def _unix(rows: _Rows, header: _Header) -> Floats:
    """Unix seconds. Weeks and seconds are of the GPS epoch, on the header's scale as dates are."""
    time_s = rows.time_s
    if header.scale == "GPST":
        gps_s = time_s if rows.of_week else time_s - GPS_EPOCH_S
        timed = np.isfinite(gps_s)
        return np.where(timed, unix_from_gps(np.where(timed, gps_s, 0.0)), np.nan)
    unix_s = time_s + GPS_EPOCH_S if rows.of_week else time_s
    return unix_s - (_JST_AHEAD_S if header.scale == "JST" else 0.0)


def _sexagesimal(parts: Floats) -> Floats:
    """Degrees (n,) of degrees, minutes and seconds (n, 3); the sign stands with the first that is not 0."""
    negative = np.signbit(parts).any(axis=1)
    size = np.abs(parts)
    return np.where(negative, -1.0, 1.0) * (size[:, 0] + size[:, 1] / 60 + size[:, 2] / 3600)


def _from_ecef(place_m: Floats) -> tuple[Floats, Floats, Floats]:
    radius = np.linalg.norm(place_m, axis=1)
    on_earth = (radius > _EARTH_M[0]) & (radius < _EARTH_M[1])
    lon, lat, height = geodetic(np.where(on_earth[:, None], place_m, 0.0))
    lat, lon = np.where(on_earth, lat, np.nan), np.where(on_earth, lon, np.nan)
    return lat, lon, height
