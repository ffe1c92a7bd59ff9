"""OGC API Features, part 1: landing page, conformance, and the collection of segments.

Conformance classes are declared only where they hold: the OpenAPI document is version 3.1, so not ``oas30``.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response

from app.core.errors import BadQueryError
from app.core.http import (
    JSON,
    REVALIDATE,
    BaseUrl,
    Link,
    Service,
    ServiceDep,
    etag_matches,
    found,
    geojson_answer,
    geojson_response,
    json_answer,
    link,
    link_documents,
    problems,
    with_query,
)
from app.core.query import check_datetime, parse_bbox, refuse_unknown
from app.core.text import GEO_JSON, utc_text
from app.map import store as segments
from app.map.attribution import OSM_LICENSE, OSM_LICENSE_URL, attribution
from app.map.coverage import cached_extent, dem_names
from app.map.segment import HEIGHT_DATUM
from app.map.segments import EXAMPLE_ADDRESS, FEATURE_EXAMPLE, MAX_ID, GapsQuery, SegmentId
from app.network.cells import data_version_tag
from app.terrain.store import dem_version_id

COLLECTION = "segments"
CRS84 = "http://www.opengis.net/def/crs/OGC/1.3/CRS84"
CONFORMANCE = (
    "http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/core",
    "http://www.opengis.net/spec/ogcapi-features-1/1.0/conf/geojson",
)
OPENAPI_TYPE = "application/vnd.oai.openapi+json;version=3.1"
DESCRIPTION = (
    "Inclinations of road segments, measured by vehicles. slope_percent is positive uphill from from_node to "
    "to_node, the direction in which the way is drawn; slope_sigma_percent is one standard deviation; "
    "unknown is null. dem_slope_percent is what the elevation model alone says. height_from_m and height_to_m are "
    f"heights of the nodes, with one standard deviation height_sigma_m, above {HEIGHT_DATUM}; steepest_percent is the "
    "mean grade over the steepest 20 m inside, from steepest_from_m to steepest_to_m; driven_share is how much of the "
    "segment was driven, 0 to 1."
)
BIND_NOTE = (
    "There is no access control yet: the service listens only on this machine's loopback address unless it "
    "is told otherwise (VERSANT_HOST, --host). Whoever reaches it can read, upload and delete drives."
)
ITEMS_SCHEMA = 2
"""Raise it whenever items change without their data changing, so that caches notice."""
ITEM_PARAMETERS = frozenset({"bbox", "limit", "driven", "gaps", "datetime", "after", "f"})

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

FormatQuery = Annotated[str | None, Query(description="Only `json`; for clients that ask for it.")]

router = APIRouter(tags=["map"])


@router.get(
    f"/collections/{COLLECTION}/items",
    summary="Segments",
    response_class=Response,
    responses={
        200: geojson_answer("One page of segments by ascending id.", ITEMS_EXAMPLE),
        304: {"description": "Unchanged since the ETag."},
        **problems(400, 503),
    },
)
def items(
    request: Request,
    service: ServiceDep,
    base: BaseUrl,
    bbox: Annotated[
        str | None,
        Query(
            description="west,south,east,north in degrees; west > east crosses the antimeridian.",
            examples=["8.46,48.95,8.50,48.99"],
        ),
    ] = None,
    limit: Annotated[
        int | None, Query(ge=1, description="Items per page; reduced to the service's maximum.")
    ] = None,
    driven: Annotated[
        bool | None, Query(description="Only segments that were (true) or were not (false) driven.")
    ] = None,
    gaps: GapsQuery = None,
    datetime_: Annotated[
        str | None,
        Query(
            alias="datetime",
            description="Checked and otherwise without effect: slopes have no time of their own.",
        ),
    ] = None,
    after: Annotated[
        int, Query(ge=0, le=MAX_ID, description="For `next` links: the last id before the page.")
    ] = 0,
    f: FormatQuery = None,
) -> Response:
    """Follow the `next` link until there is none: every matching segment comes exactly once.

    `numberMatched` is given where it costs nothing: when all matching segments are on one page. A segment with
    a slope and 0 drives is a gap (see `gaps`): its slope comes from the roads on both its sides.
    """
    _only_json(request, f, ITEM_PARAMETERS)
    check_datetime(datetime_)
    box = parse_bbox(bbox)
    size = min(limit or service.settings.items_limit_default, service.settings.items_limit_max)
    with service.reading() as session:
        etag = f'W/"{data_version_tag(session)}.{dem_version_id(session)}-{ITEMS_SCHEMA}.{size}"'
        headers = {"ETag": etag, "Cache-Control": REVALIDATE}
        if etag_matches(request, etag):
            return Response(status_code=304, headers=headers)
        # One more than shown tells whether there is a next page.
        rows = segments.segment_items(
            session, bbox=box, after_id=after, limit=size + 1, driven=driven, gaps=bool(gaps)
        )
        shown, more = rows[:size], len(rows) > size
        source = attribution(dem_names(service, session, shown))
    query = {"bbox": bbox, "limit": size, "driven": driven, "gaps": gaps, "datetime": datetime_}
    here = f"{base}/collections/{COLLECTION}/items"
    links = [
        link(with_query(here, **query, after=after or None), "self", GEO_JSON),
        link(f"{base}/collections/{COLLECTION}", "collection"),
    ]
    if more:
        links.append(link(with_query(here, **query, after=shown[-1].id), "next", GEO_JSON, "The next page"))
    document = {
        "type": "FeatureCollection",
        "attribution": source,
        "height_datum": HEIGHT_DATUM,
        "timeStamp": utc_text(datetime.now(UTC)),
        **({"numberMatched": len(shown)} if not more and not after else {}),
        "numberReturned": len(shown),
        "links": link_documents(links),
        "features": (row.geojson() for row in shown),
    }
    return geojson_response(document, headers)


@router.get(
    f"/collections/{COLLECTION}/items/{{segment_id}}",
    summary="One segment as an item",
    response_class=Response,
    responses={200: geojson_answer("The segment.", FEATURE_EXAMPLE), **problems(400, 404, 503)},
)
def item(
    segment_id: SegmentId,
    request: Request,
    service: ServiceDep,
    base: BaseUrl,
    gaps: GapsQuery = None,
    f: FormatQuery = None,
) -> Response:
    """The segment with the slope that all its drives together give; `gaps` as for many segments."""
    _only_json(request, f, frozenset({"f", "gaps"}))
    with service.reading() as session:
        row = found(segments.get_segment(session, segment_id, gaps=bool(gaps)), "segment", segment_id)
    here = f"{base}/collections/{COLLECTION}/items/{segment_id}"
    links = [
        link(with_query(here, gaps=gaps), "self", GEO_JSON),
        link(f"{base}/collections/{COLLECTION}", "collection"),
        link(f"{base}/v1/segments/{segment_id}/observations", "observations", title="The drives behind it"),
    ]
    return geojson_response({**row.geojson(), "links": link_documents(links)})


def _collection(service: Service, base: str) -> dict[str, Any]:
    with service.reading() as session:
        bounds = cached_extent(service, session)
        source = attribution(dem_names(service, session))
    here = f"{base}/collections/{COLLECTION}"
    links: list[Link] = [
        link(here, "self"),
        link(f"{here}/items", "items", GEO_JSON, "The segments"),
        link(f"{base}/tiles.json", "tiles", JSON, "Vector tiles"),
        link(OSM_LICENSE_URL, "license", "text/html", OSM_LICENSE),
    ]
    description: dict[str, Any] = {
        "id": COLLECTION,
        "title": "Slopes of road segments",
        "description": DESCRIPTION,
        "attribution": source,
        "itemType": "feature",
        "crs": [CRS84],
        "links": link_documents(links),
    }
    if bounds is not None:
        description["extent"] = {"spatial": {"bbox": [list(bounds)], "crs": CRS84}}
    return description


def _only_json(request: Request, f: str | None, known: frozenset[str] = frozenset({"f"})) -> None:
    refuse_unknown(request, known)
    if f not in {None, "json", "geojson"}:
        raise BadQueryError(f"There is no format {f!r} here. There is: json.", field="f")
