"""The examples of GeoJSON and column documents in the OpenAPI document."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from app.outputs.attribution import attribution
from app.outputs.features import GEO_JSON, SegmentFeature

EXAMPLE_SEGMENT = SegmentFeature(
    id=17,
    osm_way_id=23_456_789,
    from_node=1001,
    to_node=1002,
    length_m=41.374,
    highway="residential",
    name="Turmbergstraße",
    oneway=0,
    bridge=False,
    tunnel=False,
    slope_percent=6.8214,
    slope_sigma_percent=0.3127,
    drives=3,
    observations=24,
    dem_slope_percent=4.1,
    updated_at=datetime(2026, 11, 20, 9, 13, 2, 4000, UTC),
    coordinates=((8.4812345, 48.9912345), (8.4815678, 48.9915432)),
)
FEATURE_EXAMPLE = EXAMPLE_SEGMENT.geojson()

_ITEMS = "http://127.0.0.1:8000/collections/segments/items"

SEGMENT_EXAMPLE: dict[str, Any] = {
    "type": "FeatureCollection",
    "attribution": attribution(),
    "numberReturned": 1,
    "links": [{"href": _ITEMS, "rel": "self", "type": GEO_JSON}],
    "features": [FEATURE_EXAMPLE],
}
ITEMS_EXAMPLE: dict[str, Any] = {
    "type": "FeatureCollection",
    "attribution": attribution(),
    "timeStamp": "2026-11-20T09:14:00.000Z",
    "numberReturned": 1,
    "links": [
        {"href": f"{_ITEMS}?limit=1", "rel": "self", "type": GEO_JSON},
        {"href": f"{_ITEMS}?limit=1&after=17", "rel": "next", "type": GEO_JSON},
    ],
    "features": [FEATURE_EXAMPLE],
}
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


def geojson_answer(description: str, example: Any) -> dict[str, Any]:
    """The OpenAPI description of an answer in GeoJSON."""
    schema = {"type": "object", "required": ["type"], "properties": {"type": {"type": "string"}}}
    return {"description": description, "content": {GEO_JSON: {"schema": schema, "example": example}}}


def json_answer(description: str, example: Any) -> dict[str, Any]:
    """The OpenAPI description of an answer in JSON that no model describes."""
    content = {"application/json": {"schema": {"type": "object"}, "example": example}}
    return {"description": description, "content": content}
