"""A page of items as CSV: the same properties, unknown as an empty cell, and the line as well-known text.

What a document says around its items is said in headers, by the names that OGC API servers have for it. A page is
bounded by ``limit`` whatever its form, so it is sent as one piece, with a tag.
"""

from __future__ import annotations

from collections.abc import Sequence

from fastapi import Request, Response

from app.core.errors import BadQueryError
from app.core.http import Link, link
from app.core.messages import say
from app.map.items import pages
from app.map.items.pages import MOST_IN_HEADER
from app.map.items.request import Shape
from app.map.items.store import Page
from app.map.items.writing import columns_of
from app.map.segment import OSM_LICENSE_URL

_END = "\r\n"
_LONGEST_NEXT = 6000
"""Characters. Without the next link a table would seem to end: it goes into the header before all else, or the query is
refused."""
TABLE_EXAMPLE = _END.join(
    (
        "id,osm_way_id,from_node,to_node,name,slope_percent,slope_sigma_percent,wkt",
        '17,23456789,1001,1002,"Turmbergstraße",6.8214,0.3127,"LINESTRING(8.4812345 48.9912345,8.4815678 48.9915432)"',
        "",
    )
)


def table_answer(request: Request, shape: Shape, shown: Page, links: Sequence[Link]) -> Response:
    """The page, whose rows are ``shown.features``; the link to the next one comes first in ``links``."""
    if any(one.rel == "next" and len(one.href) > _LONGEST_NEXT for one in links):
        raise BadQueryError(say("items.csv_long"), field="f")
    license_link = link(OSM_LICENSE_URL, "license")
    more = {
        **pages.content_crs(shape.crs.uri),
        "OGC-NumberReturned": str(len(shown.features)),
        **({} if shown.matched is None else {"OGC-NumberMatched": str(shown.matched)}),
        **({} if shown.version is None else {"Versant-Version": shown.version}),
    }
    header = ",".join(columns_of(shape.properties, with_line=shape.with_line))
    body = _END.join((header, *shown.features, ""))
    return pages.answered(
        request,
        body,
        pages.CSV,
        links=[*links, license_link],
        headers=more,
        longest_links=_LONGEST_NEXT + MOST_IN_HEADER,
    )
