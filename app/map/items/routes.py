"""Pages of items and single items of each collection, and their parameters as the API's document describes them.

The engine makes the text of features; here is what is around.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import Annotated, Any

from fastapi import APIRouter, Path, Request, Response
from sqlalchemy.orm import Session

from app.core.http import BaseUrl, Link, Service, ServiceDep, existing, link, link_documents
from app.core.settings import Settings
from app.core.standby.use import MapRoute
from app.core.text import GEO_JSON, dumps, utc_text
from app.map.coverage import dem_names, dem_names_at
from app.map.items import pages, store
from app.map.items.collection_routes import collection_crumbs, property_schema
from app.map.items.collections import COLLECTIONS, Collection, Property
from app.map.items.cql import LANGUAGES, TEXT
from app.map.items.places import CRS84, CRSS, Crs
from app.map.items.request import ItemRequest, item_parameters, parse_item, parse_items
from app.map.items.table import TABLE_EXAMPLE, table_answer
from app.map.segment import HEIGHT_DATUM, attribution
from app.map.segments import EXAMPLE_ADDRESS, FEATURE_EXAMPLE, MAX_ID

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
        {"type": "string", "enum": ["geojson", "json", "html", "csv"]},
        "The form of the answer, where the Accept header cannot say it; `csv` of many items only.",
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
        return _comparison(collection.properties[name])
    schema, text = _DESCRIBED[name]
    lists = _LISTS if schema["type"] == "array" else {}
    return {"name": name, "in": "query", "required": False, "description": text, "schema": schema, **lists}


def _comparison(one: Property) -> Json:
    known = property_schema(one)
    text = f"{known.pop('title')}: {known.pop('description')} Several values with commas: any of them."
    schema = {name: value for name, value in known.items() if not name.startswith("x-")}
    return {"name": one.name, "in": "query", "required": False, "description": text, "schema": schema}


ITEMS_EXAMPLE: dict[str, Any] = {
    "type": "FeatureCollection",
    "attribution": attribution(),
    "height_datum": HEIGHT_DATUM,
    "timeStamp": "2026-11-20T09:14:00.000Z",
    "numberReturned": 1,
    "links": [
        {"href": f"{EXAMPLE_ADDRESS}?limit=1", "rel": "self", "type": GEO_JSON},
        {"href": f"{EXAMPLE_ADDRESS}?limit=1&after=17", "rel": "next", "type": GEO_JSON},
    ],
    "features": [FEATURE_EXAMPLE],
}
_POINT = re.compile(r"\[(-?[\d.]+(?:[eE]-?\d+)?),(-?[\d.]+(?:[eE]-?\d+)?)\]")
_PROBLEMS = (400, 406, 503)
_SINCE = {True: (410,), False: ()}
"""What else may be wrong where ``updated_since`` names a version."""
ItemId = Annotated[int, Path(ge=1, le=MAX_ID, description="The item's number.", examples=[17])]

router = APIRouter(tags=["map"], route_class=MapRoute)


def items_answer(request: Request, service: Service, base: str, collection: Collection) -> Response:
    """One page of a collection's items."""
    form = pages.wanted(request, request.query_params.get("f"), pages.AS_GEOJSON, pages.AS_HTML, pages.AS_CSV)
    item_request = parse_items(collection, request.query_params.multi_items(), service.settings)
    if is_table := form.form is pages.AS_CSV:
        item_request = replace(item_request, shape=replace(item_request.shape, table=True))
    with service.reading() as session:
        shown = store.page(session, item_request)
        rasters = () if is_table else _rasters(service, session, shown.features, item_request)
        note = service.edition_note(session)
    source = attribution(rasters)
    here = f"{base}/collections/{collection.id}/items"
    links = [
        *form.links(here, item_request.pairs),
        link(f"{base}/collections/{collection.id}", "collection", title=collection.title),
    ]
    if shown.next_cursor is not None:
        following = pages.with_pairs(here, item_request.query(after=shown.next_cursor))
        links.insert(0, link(following, "next", form.media_type, "The next page"))
    if is_table:
        return table_answer(request, item_request.shape, shown, links)
    document = {
        "type": "FeatureCollection",
        "attribution": source,
        **note,
        "height_datum": HEIGHT_DATUM,
        **({} if shown.matched is None else {"numberMatched": shown.matched}),
        "numberReturned": len(shown.features),
        **({} if shown.version is None else {"version": shown.version}),
        "links": link_documents(links),
    }
    if not form.html:
        return _items_text(request, form, item_request.shape.crs, document, shown.features, links)
    return pages.page_answer(
        request,
        "items.html",
        f"{collection.title}: items",
        collection_crumbs(base, collection),
        links,
        document=document,
        features=[json.loads(text) for text in shown.features],
        properties=[collection.properties[name] for name in item_request.shape.properties if name != "id"],
        address=here,
        first=pages.with_pairs(here, item_request.query(after=None)) if item_request.after else None,
    )


def item_answer(
    request: Request, service: Service, base: str, collection: Collection, item_id: int
) -> Response:
    """One item."""
    form = pages.wanted(request, request.query_params.get("f"), pages.AS_GEOJSON, pages.AS_HTML)
    pairs = request.query_params.multi_items()
    shape = parse_item(collection, pairs)
    with service.reading() as session:
        text = existing(store.one(session, collection, item_id, shape), f"item of {collection.id}", item_id)
        note = service.edition_note(session)
    up = f"{base}/collections/{collection.id}"
    links = [*form.links(f"{up}/items/{item_id}", pairs), link(up, "collection", title=collection.title)]
    if collection.follows_changes:
        behind = f"{base}/v1/segments/{item_id}/observations"
        links.append(link(behind, "observations", title="The drives behind it"))
    if not form.html:
        body = f"{text[:-1]},{dumps({**note, 'links': link_documents(links)})[1:]}"
        return pages.answered(
            request, body, form.media_type, links=links, headers=pages.content_crs(shape.crs.uri)
        )
    return pages.page_answer(
        request,
        "item.html",
        f"{collection.title}: {item_id}",
        [*collection_crumbs(base, collection), ("Items", f"{up}/items")],
        links,
        document=json.loads(text),
        properties=[collection.properties[name] for name in shape.properties],
        attribution=attribution(),
    )


def _items_text(
    request: Request,
    form: pages.Wanted,
    crs: Crs,
    document: dict[str, Any],
    features: Sequence[str],
    links: Sequence[Link],
) -> Response:
    """The page as GeoJSON. Its tag tells what it says, but not when it was said."""
    head, body = dumps(document)[:-1], ",".join(features).encode()
    tag = hashlib.blake2b(head.encode(), digest_size=12)
    tag.update(body)
    now = utc_text(datetime.now(UTC))
    return pages.answered(
        request,
        b"".join((head.encode(), f',"timeStamp":"{now}","features":['.encode(), body, b"]}")),
        form.media_type,
        links=links,
        headers=pages.content_crs(crs.uri),
        etag=f'W/"{tag.hexdigest()}"',
    )


def _rasters(
    service: Service, session: Session, features: Sequence[str], item_request: ItemRequest
) -> tuple[str, ...]:
    """The elevation rasters under the items that are shown."""
    if not item_request.shape.with_line:
        return dem_names(service, session) if features else ()
    crs = item_request.shape.crs

    def places() -> Iterable[tuple[float, float]]:
        for text in features:
            for x, y in _POINT.findall(text):
                yield crs.to_degrees(float(x), float(y))

    return dem_names_at(service, session, places())


def _routes(collection: Collection) -> None:
    """The routes to a collection's items."""

    page_of = "One page of items, by ascending id unless `sortby` says otherwise."
    statuses = (*_PROBLEMS, *_SINCE[collection.follows_changes])

    @router.get(
        f"/collections/{collection.id}/items",
        name=f"items_of_{collection.id}",
        summary=collection.title,
        description="Follow the `next` link until there is none: every matching item comes exactly once. As CSV it "
        "stands in the header `Link`, beside `OGC-NumberReturned` and `OGC-NumberMatched`.\n\n"
        "`numberMatched` is given where it costs little. A segment with a slope and 0 drives is a gap (see `gaps`): "
        "its slope comes from the roads on both its sides.",
        response_class=Response,
        responses=pages.described(page_of, {GEO_JSON: ITEMS_EXAMPLE, pages.CSV: TABLE_EXAMPLE}, *statuses),
        openapi_extra={"parameters": items_parameters(collection)},
    )
    def items(request: Request, service: ServiceDep, base: BaseUrl) -> Response:
        return items_answer(request, service, base, collection)

    @router.get(
        f"/collections/{collection.id}/items/{{item_id}}",
        name=f"item_of_{collection.id}",
        summary=f"One item of {collection.id}",
        response_class=Response,
        responses=pages.described("The item.", {GEO_JSON: FEATURE_EXAMPLE}, *_PROBLEMS, 404),
        openapi_extra={"parameters": item_parameters_of_one(collection)},
    )
    def item(item_id: ItemId, request: Request, service: ServiceDep, base: BaseUrl) -> Response:
        """The item with the slope that all its drives together give; `gaps` as for many items."""
        return item_answer(request, service, base, collection, item_id)


for _collection in COLLECTIONS.values():
    _routes(_collection)
