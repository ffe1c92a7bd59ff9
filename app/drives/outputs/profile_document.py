"""A drive's elevation profile as it is answered: columns in JSON, or a table. Knows no route and no database."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.core.text import COORDINATE_DIGITS, LENGTH_DIGITS, SLOPE_DIGITS
from app.drives.outputs.columns import csv_chunks, numbers, time_texts
from app.drives.outputs.profile import Profile
from app.drives.outputs.thinning import thinned

TIME_DIGITS = 3

_DIGITS = {
    "distance_m": LENGTH_DIGITS,
    "time_s": TIME_DIGITS,
    "lon_deg": COORDINATE_DIGITS,
    "lat_deg": COORDINATE_DIGITS,
    "alt_m": LENGTH_DIGITS,
    "alt_sigma_m": LENGTH_DIGITS,
    "slope_percent": SLOPE_DIGITS,
    "slope_sigma_percent": SLOPE_DIGITS,
    "grade_percent": SLOPE_DIGITS,
    "grade_sigma_percent": SLOPE_DIGITS,
    "dem_height_m": LENGTH_DIGITS,
}
"""Columns of numbers, and how they are rounded."""


def fewer(profile: Profile, points: int | None) -> Profile:
    """The profile as it looks with so many points; None: as it is."""
    if points is None or len(profile) <= points:
        return profile
    place = (profile.lon_deg * np.cos(np.radians(profile.lat_deg)), profile.lat_deg)
    peaks = (profile.alt_m, profile.grade_percent)
    return profile.take(
        thinned(points, profile.distance_m, peaks, profile.gap, ~profile.has_gnss, place=place)
    )


def profile_json(profile: Profile) -> dict[str, Any]:
    """The profile as columns, JSON-serialisable; unknown is null."""
    return {"epochs": len(profile)} | {name: write(profile) for name, write in _COLUMNS.items()}


def profile_csv(profile: Profile) -> Iterator[str]:
    """The same as a table, an epoch a line; an empty cell is unknown."""
    columns = profile_json(profile)
    return csv_chunks({name: columns[name] for name in _COLUMNS})


def _number(name: str) -> Callable[[Profile], list[Any]]:
    return lambda profile: numbers(getattr(profile, name), _DIGITS[name])


def _flag(name: str) -> Callable[[Profile], list[Any]]:
    return lambda profile: getattr(profile, name).tolist()


def _where(known: NDArray[np.bool_], values: NDArray[Any]) -> list[Any]:
    """The values as Python's; None where unknown."""
    column = values.astype(object)
    column[~known] = None
    return list(column)


_COLUMNS: dict[str, Callable[[Profile], list[Any]]] = {
    "distance_m": _number("distance_m"),
    "time": lambda profile: time_texts(profile.time_s),
    "alt_m": _number("alt_m"),
    "alt_sigma_m": _number("alt_sigma_m"),
    "slope_percent": _number("slope_percent"),
    "slope_sigma_percent": _number("slope_sigma_percent"),
    "grade_percent": _number("grade_percent"),
    "grade_sigma_percent": _number("grade_sigma_percent"),
    "segment_id": lambda profile: _where(profile.segment_id >= 0, profile.segment_id),
    "forward": lambda profile: _where(profile.forward != 0, profile.forward > 0),
    "gap": _flag("gap"),
    "has_gnss": _flag("has_gnss"),
    "time_s": _number("time_s"),
    "lon_deg": _number("lon_deg"),
    "lat_deg": _number("lat_deg"),
    "bridge": _flag("bridge"),
    "tunnel": _flag("tunnel"),
    "dem_height_m": _number("dem_height_m"),
}


def _column(kind: str, description: str, *, nullable: bool = False) -> dict[str, Any]:
    """The schema of a column: a value per epoch."""
    items = {"type": [kind, "null"] if nullable else kind}
    return {"type": "array", "items": items, "description": description}


# What the OpenAPI document says of ``profile_json``, to which the service adds ``drive_id``.
PROFILE_EXAMPLE: dict[str, Any] = {
    "drive_id": "3f1c9a52-8f0e-4b57-9d0a-5a9f6c1f0f11",
    "epochs": 2,
    "distance_m": [0.0, 11.2],
    "time": ["2026-11-20T07:55:10.000Z", "2026-11-20T07:55:11.000Z"],
    "alt_m": [143.21, 143.97],
    "alt_sigma_m": [0.9, 0.9],
    "slope_percent": [6.8214, 6.8214],
    "slope_sigma_percent": [0.3127, 0.3127],
    "grade_percent": [6.4318, 6.6027],
    "grade_sigma_percent": [0.5214, 0.5188],
    "segment_id": [17, 17],
    "forward": [True, True],
    "gap": [True, False],
    "has_gnss": [True, True],
    "time_s": [1_795_161_310.0, 1_795_161_311.0],
    "lon_deg": [8.4812, 8.4813],
    "lat_deg": [48.9912, 48.9913],
    "bridge": [False, False],
    "tunnel": [False, False],
    "dem_height_m": [141.8, 142.4],
}
PROFILE_SCHEMA: dict[str, Any] = {
    "type": "object",
    "required": list(PROFILE_EXAMPLE),
    "properties": {
        "drive_id": {"type": "string", "format": "uuid"},
        "epochs": {"type": "integer", "description": "Length of every column."},
        "distance_m": _column("number", "Driven since the first epoch."),
        "time": _column("string", "UTC."),
        "alt_m": _column("number", "Height of the road.", nullable=True),
        "alt_sigma_m": _column("number", "One standard deviation.", nullable=True),
        "slope_percent": _column(
            "number", "The drive's slope of the whole segment, in the direction of travel.", nullable=True
        ),
        "slope_sigma_percent": _column("number", "One standard deviation.", nullable=True),
        "grade_percent": _column(
            "number", "The grade at this very place, in the direction of travel.", nullable=True
        ),
        "grade_sigma_percent": _column("number", "One standard deviation.", nullable=True),
        "segment_id": _column("integer", "The segment driven.", nullable=True),
        "forward": _column("boolean", "Whether from its from_node to its to_node.", nullable=True),
        "gap": _column("boolean", "Whether the recording was interrupted just before."),
        "has_gnss": _column("boolean", "Whether a position was measured there."),
        "time_s": _column("number", "The same moment as `time`, seconds since 1970, UTC."),
        "lon_deg": _column("number", "Degrees, WGS 84."),
        "lat_deg": _column("number", "Degrees, WGS 84."),
        "bridge": _column("boolean", "Whether the segment is a bridge."),
        "tunnel": _column("boolean", "Whether the segment is a tunnel."),
        "dem_height_m": _column(
            "number",
            "Of the ground there in the elevation model, on the model's own datum; below bridges and above tunnels the "
            "ground is not the road.",
            nullable=True,
        ),
    },
}
