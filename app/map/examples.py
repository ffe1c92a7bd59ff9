"""The examples of GeoJSON and column documents in the OpenAPI document."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from app.core.text import GEO_JSON
from app.map.attribution import attribution
from app.map.segment import SegmentFeature

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
