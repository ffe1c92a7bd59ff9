"""A drive's estimated track as GeoJSON: the path, then every epoch with its sigmas. Knows no database and no route."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from itertools import chain
from typing import Any

import numpy as np

from app.core.text import COORDINATE_DIGITS, LENGTH_DIGITS, collection_chunks, utc_text
from app.drives.outputs.columns import numbers, time_texts
from fusion.types import PAUSE_S, Ints, Track

_COLUMNS = ("alt_m", "h_sigma_m", "alt_sigma_m", "speed_mps", "distance_m")
"""Columns of the track that a point's properties show as they are, in m and m/s."""


def track_chunks(track: Track, segment_id: Ints, members: dict[str, Any] | None = None) -> Iterator[str]:
    """The text of a FeatureCollection piece by piece.

    First one MultiLineString, the path, interrupted at pauses above ``PAUSE_S``; then a Point per epoch with
    ``time``, ``alt_m`` (road surface), ``h_sigma_m``, ``alt_sigma_m``, ``speed_mps``, ``heading_deg``
    (clockwise from north), ``pitch_deg``, ``pitch_sigma_deg``, ``segment_id`` (null: matched to no road),
    ``distance_m`` (along the segment from its from_node) and ``has_gnss``. Unknown is null. Heights are
    properties and not coordinates, because RFC 7946 wants those above the ellipsoid.
    """
    return collection_chunks(chain([path_feature(track)], point_features(track, segment_id)), members)


def path_feature(track: Track) -> dict[str, Any]:
    """The path as one MultiLineString Feature; its geometry is null where no two epochs follow each other."""
    lines = [piece for piece in _pieces(track) if len(piece) > 1]
    geometry = {"type": "MultiLineString", "coordinates": lines} if lines else None
    times = track.time_s[np.isfinite(track.time_s)]
    return {
        "type": "Feature",
        "id": "path",
        "geometry": geometry,
        "properties": {
            "epochs": len(track),
            "start": time_text(float(times[0])) if len(times) else None,
            "end": time_text(float(times[-1])) if len(times) else None,
        },
    }


def point_features(track: Track, segment_id: Ints) -> Iterator[dict[str, Any]]:
    """Each epoch as a Point Feature; its geometry is null where the position is unknown."""
    on_road = replace(track, distance_m=np.where(segment_id >= 0, track.distance_m, np.nan))
    columns: dict[str, list[Any]] = {
        "time": time_texts(track.time_s),
        **{name: numbers(getattr(on_road, name), LENGTH_DIGITS) for name in _COLUMNS},
        "heading_deg": numbers(np.degrees(track.heading_rad) % 360, 2),
        "pitch_deg": numbers(np.degrees(track.pitch_rad), 3),
        "pitch_sigma_deg": numbers(np.degrees(track.pitch_sigma_rad), 3),
        "segment_id": [segment if segment >= 0 else None for segment in segment_id.tolist()],
        "has_gnss": track.has_gnss.tolist(),
    }
    places = (numbers(track.lon_deg, COORDINATE_DIGITS), numbers(track.lat_deg, COORDINATE_DIGITS))
    for lon, lat, *values in zip(*places, *columns.values(), strict=True):
        placed = lon is not None and lat is not None
        geometry = {"type": "Point", "coordinates": [lon, lat]} if placed else None
        yield {"type": "Feature", "geometry": geometry, "properties": dict(zip(columns, values, strict=True))}


def time_text(time_s: float) -> str | None:
    """RFC 3339 of Unix seconds; None for NaN."""
    return utc_text(datetime.fromtimestamp(time_s, UTC)) if np.isfinite(time_s) else None


def _pieces(track: Track) -> list[list[list[float]]]:
    placed = np.isfinite(track.lat_deg) & np.isfinite(track.lon_deg)
    lon = np.round(track.lon_deg[placed], COORDINATE_DIGITS)
    lat = np.round(track.lat_deg[placed], COORDINATE_DIGITS)
    cuts = np.flatnonzero((np.diff(track.time_s[placed]) > PAUSE_S) | track.after_outage[placed][1:]) + 1
    return [piece.tolist() for piece in np.split(np.column_stack([lon, lat]), cuts)]


TRACK_EXAMPLE: dict[str, Any] = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "id": "path",
            "geometry": {"type": "MultiLineString", "coordinates": [[[8.4812, 48.9912], [8.4813, 48.9913]]]},
            "properties": {
                "epochs": 2,
                "start": "2026-11-20T07:55:10.000Z",
                "end": "2026-11-20T07:55:11.000Z",
            },
        },
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": [8.4812, 48.9912]},
            "properties": {
                "time": "2026-11-20T07:55:10.000Z",
                "alt_m": 143.21,
                "h_sigma_m": 1.4,
                "alt_sigma_m": 0.9,
                "speed_mps": 11.2,
                "distance_m": 3.1,
                "heading_deg": 41.5,
                "pitch_deg": 3.9,
                "pitch_sigma_deg": 0.3,
                "segment_id": 17,
                "has_gnss": True,
            },
        },
    ],
}
"""What the OpenAPI document shows of it."""
