"""Pages of items and single items of each collection. The engine makes the text of features; here is what is around."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from typing import Annotated, Any

from fastapi import APIRouter, Path, Request, Response
from sqlalchemy.orm import Session

from app.core.http import BaseUrl, Link, Service, ServiceDep, existing, link, link_documents
from app.core.text import GEO_JSON, dumps, utc_text
from app.map.attribution import attribution
from app.map.coverage import dem_names, dem_names_at
from app.map.items import store
from app.map.items.collections import COLLECTIONS, Collection
from app.map.items.negotiation import AS_GEOJSON, AS_HTML, HTML, Wanted, answered, wanted, with_pairs
from app.map.items.pages import described, page, page_headers
from app.map.items.parameters import item_parameters_of_one, items_parameters
from app.map.items.places import Crs
from app.map.items.request import ItemRequest, parse_item, parse_items
from app.map.segment import HEIGHT_DATUM
from app.map.segments import EXAMPLE_ADDRESS, FEATURE_EXAMPLE, MAX_ID

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

router = APIRouter(tags=["map"])


def items_answer(request: Request, service: Service, base: str, collection: Collection) -> Response:
    """One page of a collection's items."""
    form = wanted(request, request.query_params.get("f"), AS_GEOJSON, AS_HTML)
    item_request = parse_items(collection, request.query_params.multi_items(), service.settings)
    with service.reading() as session:
        shown = store.page(session, item_request)
        source = attribution(_rasters(service, session, shown.features, item_request))
    here = f"{base}/collections/{collection.id}/items"
    links = [
        *form.links(here, item_request.pairs),
        link(f"{base}/collections/{collection.id}", "collection", title=collection.title),
    ]
    if shown.next_cursor is not None:
        following = with_pairs(here, item_request.query(after=shown.next_cursor))
        links.insert(0, link(following, "next", form.media_type, "The next page"))
    document = {
        "type": "FeatureCollection",
        "attribution": source,
        "height_datum": HEIGHT_DATUM,
        **({} if shown.matched is None else {"numberMatched": shown.matched}),
        "numberReturned": len(shown.features),
        **({} if shown.version is None else {"version": shown.version}),
        "links": link_documents(links),
    }
    if form.html:
        return _items_page(request, base, item_request, document, shown.features, links)
    return _items_text(request, form, item_request.shape.crs, document, shown.features, links)


def item_answer(
    request: Request, service: Service, base: str, collection: Collection, item_id: int
) -> Response:
    """One item."""
    form = wanted(request, request.query_params.get("f"), AS_GEOJSON, AS_HTML)
    pairs = request.query_params.multi_items()
    shape = parse_item(collection, pairs)
    with service.reading() as session:
        text = existing(store.one(session, collection, item_id, shape), f"item of {collection.id}", item_id)
    up = f"{base}/collections/{collection.id}"
    links = [*form.links(f"{up}/items/{item_id}", pairs), link(up, "collection", title=collection.title)]
    if collection.follows_changes:
        behind = f"{base}/v1/segments/{item_id}/observations"
        links.append(link(behind, "observations", title="The drives behind it"))
    if not form.html:
        body = f'{text[:-1]},"links":{dumps(link_documents(links))}}}'
        return answered(request, body, form.media_type, links=links, headers=_content_crs(shape.crs))
    shown = page(
        "item.html",
        title=f"{collection.title}: {item_id}",
        crumbs=[*_crumbs(base, collection), ("Items", f"{up}/items")],
        links=links,
        document=json.loads(text),
        properties=[collection.properties[name] for name in shape.properties],
        attribution=attribution(),
    )
    return answered(request, shown, HTML, links=links, headers=page_headers())


def _items_text(
    request: Request,
    form: Wanted,
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
    return answered(
        request,
        b"".join((head.encode(), f',"timeStamp":"{now}","features":['.encode(), body, b"]}")),
        form.media_type,
        links=links,
        headers=_content_crs(crs),
        etag=f'W/"{tag.hexdigest()}"',
    )


def _items_page(
    request: Request,
    base: str,
    item_request: ItemRequest,
    document: dict[str, Any],
    features: Iterable[str],
    links: Sequence[Link],
) -> Response:
    """The page as a table."""
    collection = item_request.collection
    here = f"{base}/collections/{collection.id}/items"
    shown = page(
        "items.html",
        title=f"{collection.title}: items",
        crumbs=_crumbs(base, collection),
        links=links,
        document=document,
        features=[json.loads(text) for text in features],
        properties=[collection.properties[name] for name in item_request.shape.properties if name != "id"],
        address=here,
        first=with_pairs(here, item_request.query(after=None)) if item_request.after else None,
    )
    return answered(request, shown, HTML, links=links, headers=page_headers())


def _crumbs(base: str, collection: Collection) -> list[tuple[str, str]]:
    here = f"{base}/collections"
    return [("Versant", f"{base}/"), ("Collections", here), (collection.title, f"{here}/{collection.id}")]


def _content_crs(crs: Crs) -> dict[str, str]:
    return {"Content-Crs": f"<{crs.uri}>"}


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

    def items(request: Request, service: ServiceDep, base: BaseUrl) -> Response:
        return items_answer(request, service, base, collection)

    def item(item_id: ItemId, request: Request, service: ServiceDep, base: BaseUrl) -> Response:
        return item_answer(request, service, base, collection, item_id)

    items.__doc__ = (
        "Follow the `next` link until there is none: every matching item comes exactly once.\n\n"
        "`numberMatched` is given where it costs little. A segment with a slope and 0 drives is a gap (see `gaps`): "
        "its slope comes from the roads on both its sides."
    )
    item.__doc__ = "The item with the slope that all its drives together give; `gaps` as for many items."
    page_of = "One page of items, by ascending id unless `sortby` says otherwise."
    router.add_api_route(
        f"/collections/{collection.id}/items",
        items,
        name=f"items_of_{collection.id}",
        summary=collection.title,
        response_class=Response,
        responses=described(
            page_of, {GEO_JSON: ITEMS_EXAMPLE}, *_PROBLEMS, *_SINCE[collection.follows_changes]
        ),
        openapi_extra={"parameters": items_parameters(collection)},
    )
    router.add_api_route(
        f"/collections/{collection.id}/items/{{item_id}}",
        item,
        name=f"item_of_{collection.id}",
        summary=f"One item of {collection.id}",
        response_class=Response,
        responses=described("The item.", {GEO_JSON: FEATURE_EXAMPLE}, *_PROBLEMS, 404),
        openapi_extra={"parameters": item_parameters_of_one(collection)},
    )


for _collection in COLLECTIONS.values():
    _routes(_collection)
