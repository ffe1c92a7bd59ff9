"""The examples of GeoJSON and column documents in the OpenAPI document."""

from __future__ import annotations

from typing import Any

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


def _column(kind: str, description: str, *, nullable: bool = False) -> dict[str, Any]:
    """The schema of a column: a value per epoch."""
    items = {"type": [kind, "null"] if nullable else kind}
    return {"type": "array", "items": items, "description": description}


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
    "gap": [False, False],
    "has_gnss": [True, True],
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
    },
}
