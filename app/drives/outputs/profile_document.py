"""A drive's elevation profile as it is answered: columns in JSON, or a table. Knows no route and no database."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.core.text import COORDINATE_DIGITS, LENGTH_DIGITS, SLOPE_DIGITS
from app.drives.outputs.columns import csv_chunks, numbers, time_texts
from app.drives.outputs.profile import Profile
from app.drives.outputs.ride import RIDE_EXAMPLE, RIDE_SCHEMA
from app.drives.outputs.thinning import thinned

TIME_DIGITS = 3


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
    columns = {
        name: column.write(getattr(profile, column.source or name)) for name, column in _COLUMNS.items()
    }
    return {"epochs": len(profile)} | columns


def profile_csv(profile: Profile) -> Iterator[str]:
    """The same as a table, an epoch a line; an empty cell is unknown."""
    columns = profile_json(profile)
    return csv_chunks({name: columns[name] for name in _COLUMNS})


class _Column(NamedTuple):
    """A column of the answer: how it is written, and what the OpenAPI document says of it."""

    write: Callable[[NDArray[Any]], list[Any]]
    kind: str
    description: str
    example: tuple[Any, Any]
    nullable: bool = True
    source: str = ""
    """The profile's column, where it is called otherwise."""

    @property
    def schema(self) -> dict[str, Any]:
        """A value per epoch."""
        items = {"type": [self.kind, "null"] if self.nullable else self.kind}
        return {"type": "array", "items": items, "description": self.description}


def _number(digits: int, description: str, example: tuple[float, float], *, nullable: bool = True) -> _Column:
    return _Column(lambda values: numbers(values, digits), "number", description, example, nullable)


def _flag(description: str, example: tuple[bool, bool]) -> _Column:
    return _Column(np.ndarray.tolist, "boolean", description, example, nullable=False)


def _but(unknown: int, values: NDArray[Any]) -> list[Any]:
    """The values as Python's; None for the one that means unknown."""
    column = values.astype(object)
    column[values == unknown] = None
    return list(column)


_ONE_SIGMA = "One standard deviation."
_COLUMNS = {
    "distance_m": _number(LENGTH_DIGITS, "Driven since the first epoch.", (0.0, 11.2), nullable=False),
    "time": _Column(
        time_texts,
        "string",
        "UTC.",
        ("2026-11-20T07:55:10.000Z", "2026-11-20T07:55:11.000Z"),
        nullable=False,
        source="time_s",
    ),
    "alt_m": _number(LENGTH_DIGITS, "Height of the road.", (143.21, 143.97)),
    "alt_sigma_m": _number(LENGTH_DIGITS, _ONE_SIGMA, (0.9, 0.9)),
    "slope_percent": _number(
        SLOPE_DIGITS,
        "The drive's slope of the whole segment, in the direction of travel.",
        (6.8214, 6.8214),
    ),
    "slope_sigma_percent": _number(SLOPE_DIGITS, _ONE_SIGMA, (0.3127, 0.3127)),
    "grade_percent": _number(
        SLOPE_DIGITS, "The grade at this very place, in the direction of travel.", (6.4318, 6.6027)
    ),
    "grade_sigma_percent": _number(SLOPE_DIGITS, _ONE_SIGMA, (0.5214, 0.5188)),
    "segment_id": _Column(lambda ids: _but(-1, ids), "integer", "The segment driven.", (17, 17)),
    "forward": _Column(
        lambda forward: [None if way is None else way > 0 for way in _but(0, forward)],
        "boolean",
        "Whether from its from_node to its to_node.",
        (True, True),
    ),
    "gap": _flag("Whether the recording was interrupted just before.", (True, False)),
    "has_gnss": _flag("Whether a position was measured there.", (True, True)),
    "time_s": _number(
        TIME_DIGITS,
        "The same moment as `time`, seconds since 1970, UTC.",
        (1_795_161_310.0, 1_795_161_311.0),
        nullable=False,
    ),
    "lon_deg": _number(COORDINATE_DIGITS, "Degrees, WGS 84.", (8.4812, 8.4813), nullable=False),
    "lat_deg": _number(COORDINATE_DIGITS, "Degrees, WGS 84.", (48.9912, 48.9913), nullable=False),
    "bridge": _flag("Whether the segment is a bridge.", (False, False)),
    "tunnel": _flag("Whether the segment is a tunnel.", (False, False)),
    "dem_height_m": _number(
        LENGTH_DIGITS,
        "Of the ground there in the elevation model, on the model's own datum; below bridges and above tunnels the "
        "ground is not the road.",
        (141.8, 142.4),
    ),
}
"""In the order of the answer."""

# What the OpenAPI document says of ``profile_json``, to which the service adds ``drive_id`` and ``ride``.
PROFILE_EXAMPLE: dict[str, Any] = {
    "drive_id": "3f1c9a52-8f0e-4b57-9d0a-5a9f6c1f0f11",
    "epochs": 2,
    **{name: list(column.example) for name, column in _COLUMNS.items()},
    "ride": RIDE_EXAMPLE,
}
PROFILE_SCHEMA: dict[str, Any] = {
    "type": "object",
    "required": list(PROFILE_EXAMPLE),
    "properties": {
        "drive_id": {"type": "string", "format": "uuid"},
        "epochs": {"type": "integer", "description": "Length of every column."},
        **{name: column.schema for name, column in _COLUMNS.items()},
        "ride": RIDE_SCHEMA,
    },
}
