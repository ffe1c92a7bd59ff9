"""Height profiles out of files: tables, GeoJSON, GPX with or without times, answers of routers, logs of drives.

Recognised by content. Heights are taken as they are written; nothing is smoothed.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from app.core.errors import BadRequestError
from app.core.messages import say
from app.map.heights.places import MOST_PLACES, from_polyline
from fusion.errors import EmptyLogError, MalformedLogError
from fusion.formats import MAX_BYTES, read_log
from fusion.formats.base import Notes, number_or_nan
from fusion.formats.container import load
from fusion.formats.gpx import LAYOUT, ROOT
from fusion.formats.xml_points import read_points
from fusion.scoring.profiles import Profile
from fusion.types import Floats, no_progress

COLUMNS = {
    "along_m": ("distance_m", "along_m", "range_m"),
    "lat_deg": ("lat_deg", "lat", "latitude"),
    "lon_deg": ("lon_deg", "lon", "lng", "longitude"),
    "height_m": (
        "height_m", "alt_m", "alt_msl_m", "height_ell_m", "elevation_m", "elevation", "ele", "altitude", "height", "alt"
    ),
    "sigma_m": ("sigma_m", "height_sigma_m", "alt_sigma_m", "sigma"),
}  # fmt: skip
"""What columns and properties may be called; the first that is there counts."""
_HEAD = 4096
Json = Mapping[str, Any]


def read_profile(path: Path) -> Profile:
    """The profile in a file.

    Raises ``OSError``, ``MalformedLogError`` for a file that is broken, ``EmptyLogError`` for one without heights, and
    what ``fusion.formats.read_log`` does for what is none of the forms of profiles.
    """
    data = load(path, MAX_BYTES, Notes(), no_progress)
    head = data[:_HEAD].removeprefix(b"\xef\xbb\xbf").lstrip()
    if head[:1] in (b"{", b"["):
        profile = _of_json(path, data)
    elif ROOT.search(head):
        profile = _of_gpx(data)
    elif (columns := _table(data)) is not None:
        profile = profile_of(columns)
    else:
        fix = read_log(path).fix
        above_sea = np.isfinite(fix.alt_msl_m).any()
        height = fix.alt_msl_m if above_sea else fix.height_ell_m
        profile = Profile(height, places_deg=np.column_stack([fix.lon_deg, fix.lat_deg]))
    if not np.isfinite(profile.height_m).any():
        raise EmptyLogError(say("score.no_heights", file=path.name))
    if profile.along_m is None and profile.places_deg is None:
        raise EmptyLogError(say("score.no_places", file=path.name))
    return profile


def profile_of(columns: Mapping[str, Sequence[Any]]) -> Profile:
    """A profile of columns by the names of ``COLUMNS``; what is no number is unknown."""
    found: dict[str, Floats] = {}
    for ours, names in COLUMNS.items():
        name = next((name for name in names if name in columns), None)
        if name is not None:
            found[ours] = np.array([_number(value) for value in columns[name]], float)
    placed = "lat_deg" in found and "lon_deg" in found
    places = np.column_stack([found["lon_deg"], found["lat_deg"]]) if placed else None
    height = found.get("height_m", np.empty(0))
    return Profile(height, found.get("along_m"), places, found.get("sigma_m"))


def _number(value: Any) -> float:
    if isinstance(value, str):
        return number_or_nan(value)
    return float(value) if isinstance(value, int | float) else np.nan


def _table(data: bytes) -> dict[str, list[str]] | None:
    """The columns of a table whose header names a height and where it is; None: it is no such table."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return None
    first = text.partition("\n")[0]
    rows = csv.reader(io.StringIO(text), delimiter=max(",;\t", key=first.count))
    header = [name.strip().lower() for name in next(rows, [])]
    if not any(name in header for name in COLUMNS["height_m"]):
        return None
    if not any(name in header for name in (*COLUMNS["along_m"], *COLUMNS["lat_deg"])):
        return None
    complete = [row for row in rows if len(row) == len(header)]
    return {name: [row[k] for row in complete] for k, name in enumerate(header)}


def _of_gpx(data: bytes) -> Profile:
    """A track, or else a route: planners write profiles without times."""
    notes = Notes()
    for layout in (LAYOUT, replace(LAYOUT, point="rtept", others=())):
        points = read_points(data, layout, notes, no_progress)
        if len(points):
            break
    return Profile(
        points.column("ele"), places_deg=np.column_stack([points.column("lon"), points.column("lat")])
    )


def _of_json(path: Path, data: bytes) -> Profile:
    try:
        document = json.loads(data.decode("utf-8-sig"))
    except ValueError as error:
        raise MalformedLogError(say("score.no_json", file=path.name, reason=error)) from None
    try:
        if "range_height" in document or isinstance(document.get("height"), list):
            return _of_router(document)
        if "results" in document:
            return profile_of(_columns(_flat(one) for one in document["results"]))
        if "type" in document:
            # Its distances may be those along segments.
            return replace(profile_of(_columns(_of_geojson(document))), along_m=None)
        return profile_of({name: values for name, values in document.items() if isinstance(values, list)})
    except (AttributeError, KeyError, TypeError, IndexError, ValueError, BadRequestError):
        raise MalformedLogError(say("score.odd_json", file=path.name)) from None


def _of_router(document: Json) -> Profile:
    """Valhalla's answer of heights: with the distances, or those at places."""
    pairs = document.get("range_height")
    height: list[Any] = [pair[1] for pair in pairs] if pairs is not None else document["height"]
    columns: dict[str, Sequence[Any]] = {"height_m": height}
    if pairs is not None:
        columns["distance_m"] = [pair[0] for pair in pairs]
    if "shape" in document:
        columns |= {name: [place[name] for place in document["shape"]] for name in ("lat", "lon")}
    elif "encoded_polyline" in document:
        places = from_polyline(document["encoded_polyline"], 6, "encoded_polyline", MOST_PLACES)
        columns |= {"lon": places[:, 0].tolist(), "lat": places[:, 1].tolist()}
    if any(len(values) != len(height) for values in columns.values()):
        raise ValueError("places and heights are not as many")
    return profile_of(columns)


def _flat(result: Json) -> Json:
    return {"elevation": result["elevation"], **result["location"]}


def _of_geojson(document: Json) -> Iterator[Json]:
    """The places of lines with heights in their coordinates, or of points with them or with a property."""
    kind = document["type"]
    if kind == "FeatureCollection":
        for feature in document["features"]:
            yield from _of_geojson(feature)
    elif kind == "Feature":
        geometry, properties = document["geometry"] or {"type": ""}, document.get("properties") or {}
        if geometry["type"] == "Point":
            yield _place(geometry["coordinates"]) | {str(name).lower(): v for name, v in properties.items()}
        else:
            yield from _of_geojson(geometry)
    elif kind in ("LineString", "MultiPoint"):
        yield from map(_place, document["coordinates"])
    elif kind == "MultiLineString":
        for part in document["coordinates"]:
            yield from map(_place, part)


def _place(coordinates: Sequence[float]) -> dict[str, Any]:
    lon, lat, *more = coordinates
    return {"lon": lon, "lat": lat, **({"height_m": more[0]} if more else {})}


def _columns(rows: Iterator[Json]) -> dict[str, list[Any]]:
    """Rows as columns, of all names that any of them has."""
    known = [*rows]
    names = {name for row in known for name in row}
    return {name: [row.get(name) for row in known] for name in names}
