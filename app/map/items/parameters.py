"""The parameters of items as the API's document describes them: one for each that the engine reads."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from app.core.settings import Settings
from app.map.items.collections import Collection, Property
from app.map.items.cql import LANGUAGES, TEXT
from app.map.items.places import CRS84, CRSS
from app.map.items.request import item_parameters
from app.map.items.schemas import property_schema

Json = dict[str, Any]

_TEXT = {"type": "string"}
_TRUTH = {"type": "boolean"}
_CRS = {"type": "string", "format": "uri", "enum": list(CRSS), "default": CRS84.uri}
_LIMIT = "limit"

_DESCRIBED: Mapping[str, tuple[Json, str]] = {
    "bbox": (
        {"type": "array", "items": {"type": "number"}, "minItems": 4, "maxItems": 6},
        "west,south,east,north in degrees; west > east crosses the antimeridian. Of six numbers the third and the "
        "last, heights, are left out.",
    ),
    "bbox-crs": (_CRS, "The reference system of `bbox`."),
    _LIMIT: ({"type": "integer", "minimum": 1}, "Items per page; a larger number is reduced to the maximum."),
    "datetime": (
        _TEXT,
        "A time of RFC 3339, or an interval such as 2026-11-20T00:00:00Z/..: what was published of the item changed "
        "last then (`updated_at`), or nothing is known of it: with `driven=true` only what was driven comes.",
    ),
    "driven": (_TRUTH, "Only items that were (true) or were not (false) driven."),
    "filter": (_TEXT, "A condition in CQL2, as in `slope_percent > 8 AND highway = 'residential'`."),
    "filter-lang": (
        {"type": "string", "enum": list(LANGUAGES), "default": TEXT},
        "The language of `filter`.",
    ),
    "filter-crs": (_CRS, "The reference system of geometries in `filter`."),
    "sortby": (
        _TEXT,
        "Properties with commas, each with a minus for descending order: `-slope_percent`. The unknown comes last.",
    ),
    "after": (_TEXT, "Where the page begins; only `next` links know what to write here."),
    "gaps": (_TRUTH, "With true, undriven segments between driven ones come with the slope that follows."),
    "updated_since": (
        _TEXT,
        "Only what changed since a time, or since a `version` that an earlier answer to such a request told.",
    ),
    "crs": (_CRS, "The reference system of the answer."),
    "properties": (
        {"type": "array", "items": {"type": "string"}},
        "Names of the properties to show, with commas; none: all.",
    ),
    "skipGeometry": (_TRUTH, "With true, items come without their line."),
    "f": (
        {"type": "string", "enum": ["geojson", "json", "html"]},
        "The form of the answer, where the Accept header cannot say it.",
    ),
}
_LISTS = {"style": "form", "explode": False}
_OF_ONE = ("crs", "properties", "skipGeometry", "gaps", "f")


def items_parameters(collection: Collection) -> list[Json]:
    """Of a page of a collection's items."""
    return [_parameter(collection, name) for name in item_parameters(collection)]


def item_parameters_of_one(collection: Collection) -> list[Json]:
    """Of one item."""
    known = item_parameters(collection)
    return [_parameter(collection, name) for name in _OF_ONE if name in known]


def tell_limits(document: Json, settings: Settings) -> None:
    """Write the sizes of pages into the API's document, which only the settings know."""
    sizes = {"default": settings.items_limit_default, "maximum": settings.items_limit_max}
    for path, item in document["paths"].items():
        if path.startswith("/collections/") and path.endswith("/items"):
            for parameter in item["get"]["parameters"]:
                if parameter["name"] == _LIMIT:
                    parameter["schema"] = {**parameter["schema"], **sizes}


def _parameter(collection: Collection, name: str) -> Json:
    if name not in _DESCRIBED:
        return _comparison(collection.queryables[name])
    schema, text = _DESCRIBED[name]
    lists = _LISTS if schema["type"] == "array" else {}
    return {"name": name, "in": "query", "required": False, "description": text, "schema": schema, **lists}


def _comparison(one: Property) -> Json:
    known = property_schema(one)
    text = f"{known.pop('title')}: {known.pop('description')} Several values with commas: any of them."
    schema = {name: value for name, value in known.items() if not name.startswith("x-")}
    return {"name": one.name, "in": "query", "required": False, "description": text, "schema": schema}
