"""The collections of features: what each is, where it lies, and where its items and what describes them are."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request, Response
from sqlalchemy.orm import Session

from app.core.errors import NotFoundError
from app.core.http import JSON, BaseUrl, Link, Service, ServiceDep, link, link_documents
from app.core.query import refuse_unknown
from app.core.text import GEO_JSON, utc_text
from app.map.attribution import OSM_LICENSE, OSM_LICENSE_URL, attribution
from app.map.coverage import cached_extent, dem_names
from app.map.items.collections import COLLECTIONS, Collection
from app.map.items.negotiation import AS_HTML, AS_JSON, HTML, FormatQuery, wanted
from app.map.items.pages import described, document_answer
from app.map.items.places import CRSS
from app.map.items.schemas import schema_links
from app.map.tiles.documents import tilesets_link
from app.network.cells import last_change

CRS84 = "http://www.opengis.net/def/crs/OGC/1.3/CRS84"
GREGORIAN = "http://www.opengis.net/def/uom/ISO-8601/0/Gregorian"
_EXAMPLE = {"id": "segments", "title": "Slopes of road segments", "itemType": "feature", "links": []}

router = APIRouter(tags=["map"])
unknown = APIRouter(include_in_schema=False)
"""What is asked of collections that do not exist. After all other routes."""


def collection_document(
    service: Service, session: Session, base: str, collection: Collection, links: list[Link]
) -> dict[str, Any]:
    """What is said of one collection, with these links."""
    bounds = cached_extent(service, session)
    changed = last_change(session)
    extent: dict[str, Any] = {}
    if bounds is not None:
        extent["spatial"] = {"bbox": [list(bounds)], "crs": CRS84}
    if changed is not None:
        # The first change would take a look at everything.
        extent["temporal"] = {"interval": [[None, utc_text(changed)]], "trs": GREGORIAN}
    return {
        "id": collection.id,
        "title": collection.title,
        "description": collection.description,
        "attribution": attribution(dem_names(service, session)),
        "itemType": "feature",
        "crs": list(CRSS),
        "storageCrs": CRS84,
        "extent": extent,
        "links": link_documents(links),
    }


def collection_links(base: str, collection: Collection) -> list[Link]:
    """Where what belongs to a collection is."""
    here = f"{base}/collections/{collection.id}"
    return [
        link(f"{here}/items", "items", GEO_JSON, "The items, GeoJSON"),
        link(f"{here}/items?f=html", "items", HTML, "The items as a table"),
        *schema_links(base, collection),
        link(f"{base}/tiles.json", "tiles", JSON, "Vector tiles, TileJSON"),
        tilesets_link(base, collection.id),
        link(OSM_LICENSE_URL, "license", HTML, OSM_LICENSE),
    ]


@router.get(
    "/collections",
    summary="Collections",
    response_class=Response,
    responses=described("All of them.", {JSON: {"links": [], "collections": [_EXAMPLE]}}, 400, 406, 503),
)
def collections(request: Request, service: ServiceDep, base: BaseUrl, f: FormatQuery = None) -> Response:
    """The road segments, and the ways that they make up."""
    refuse_unknown(request, {"f"})
    form = wanted(request, f, AS_JSON, AS_HTML)
    here = f"{base}/collections"
    with service.reading() as session:
        documents = [
            collection_document(service, session, base, one, [_self(here, one), *collection_links(base, one)])
            for one in COLLECTIONS.values()
        ]
    links = [*form.links(here), link(f"{base}/", "root", title="Versant")]
    document = {"links": link_documents(links), "crs": list(CRSS), "collections": documents}
    return document_answer(
        request,
        form,
        document,
        links,
        template="collections.html",
        title="Collections",
        crumbs=[("Versant", f"{base}/")],
        address=here,
    )


def _self(here: str, collection: Collection) -> Link:
    return link(f"{here}/{collection.id}", "self", title=collection.title)


def _route(collection: Collection) -> None:
    """The route to what is said of one collection."""

    def document(request: Request, service: ServiceDep, base: BaseUrl, f: FormatQuery = None) -> Response:
        refuse_unknown(request, {"f"})
        form = wanted(request, f, AS_JSON, AS_HTML)
        here = f"{base}/collections/{collection.id}"
        links = [
            *form.links(here),
            link(f"{base}/collections", "parent", title="Collections"),
            *collection_links(base, collection),
        ]
        with service.reading() as session:
            content = collection_document(service, session, base, collection, links)
        return document_answer(
            request,
            form,
            content,
            links,
            template="collection.html",
            title=collection.title,
            crumbs=[("Versant", f"{base}/"), ("Collections", f"{base}/collections")],
            address=here,
        )

    document.__doc__ = "Title, extent, reference systems, and where its items, its schema and its tiles are."
    router.add_api_route(
        f"/collections/{collection.id}",
        document,
        name=f"collection_{collection.id}",
        summary=f"The collection of {collection.id}",
        response_class=Response,
        responses=described("The collection.", {JSON: _EXAMPLE}, 400, 406, 503),
    )


for _collection in COLLECTIONS.values():
    _route(_collection)


@unknown.get("/collections/{collection_id}")
@unknown.get("/collections/{collection_id}/{rest:path}")
def no_such_collection(collection_id: str, rest: str = "") -> Response:
    """Say which there are."""
    if collection_id in COLLECTIONS:
        raise NotFoundError(f"There is nothing at /collections/{collection_id}/{rest}.")
    raise NotFoundError(f"There is no collection {collection_id!r}. There are: {', '.join(COLLECTIONS)}.")
