"""The collections of features: what each is, where it lies, which properties it has, and where its items are.

What may be filtered and sorted by is JSON Schema (OGC API Features, parts 3 and 5): a property has one type; those
that are not ``required`` may be null. GDAL and what stands on it (QGIS) take the types of properties from an XML
Schema that a collection is ``describedby`` and no other document tells them of integers of 64 bits: its reader of
JSON Schema makes 32 bits of every integer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any
from xml.sax.saxutils import quoteattr

from fastapi import APIRouter, Request, Response
from sqlalchemy.orm import Session

from app.core.errors import NotFoundError
from app.core.http import JSON, BaseUrl, Link, Service, ServiceDep, link, link_documents
from app.core.messages import say
from app.core.query import refuse_unknown
from app.core.standby.use import MapRoute
from app.core.text import GEO_JSON, utc_text
from app.map.coverage import cached_extent, dem_names
from app.map.items import pages
from app.map.items.collections import COLLECTIONS, GEOMETRY, Collection, Property
from app.map.items.places import CRSS
from app.map.segment import CRS84, OSM_LICENSE, OSM_LICENSE_URL, attribution
from app.map.tiles.documents import tilesets_link
from app.network.cells import last_change

GREGORIAN = "http://www.opengis.net/def/uom/ISO-8601/0/Gregorian"
_EXAMPLE = {"id": "segments", "title": "Slopes of road segments", "itemType": "feature", "links": []}

router = APIRouter(tags=["map"], route_class=MapRoute)
unknown = APIRouter(include_in_schema=False)
"""What is asked of collections that do not exist. After all other routes."""


def collection_document(
    service: Service, session: Session, collection: Collection, links: list[Link]
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
        **service.edition_note(session),
        "itemType": "feature",
        "crs": list(CRSS),
        "storageCrs": CRS84,
        "extent": extent,
        "links": link_documents(links),
    }


def collection_crumbs(base: str, collection: Collection) -> pages.Crumbs:
    """The way to the pages below that of a collection."""
    return pages.crumbs(
        base, ("Collections", "collections"), (collection.title, f"collections/{collection.id}")
    )


def collection_links(base: str, collection: Collection) -> list[Link]:
    """Where what belongs to a collection is."""
    here = f"{base}/collections/{collection.id}"
    return [
        link(f"{here}/items", "items", GEO_JSON, "The items, GeoJSON"),
        link(f"{here}/items?f=html", "items", pages.HTML, "The items as a table"),
        *schema_links(base, collection),
        link(f"{base}/tiles.json", "tiles", JSON, "Vector tiles, TileJSON"),
        tilesets_link(base, collection.id),
        link(OSM_LICENSE_URL, "license", pages.HTML, OSM_LICENSE),
    ]


@router.get(
    "/collections",
    summary="Collections",
    response_class=Response,
    responses=pages.described(
        "All of them.", {JSON: {"links": [], "collections": [_EXAMPLE]}}, 400, 406, 503
    ),
)
def collections(request: Request, service: ServiceDep, base: BaseUrl, form: pages.FormDep) -> Response:
    """The road segments, and the ways that they make up."""
    here = f"{base}/collections"
    links = [*form.links(here), link(f"{base}/", "root", title="Versant")]
    document: dict[str, Any] = {"links": link_documents(links), "crs": list(CRSS), "collections": []}
    with service.reading() as session:
        for one in COLLECTIONS.values():
            own = [link(f"{here}/{one.id}", "self", title=one.title), *collection_links(base, one)]
            document["collections"].append(collection_document(service, session, one, own))
        document |= service.edition_note(session)
    above = pages.crumbs(base)
    return pages.document_answer(
        request, form, document, links, "collections.html", "Collections", above, address=here
    )


def _route(collection: Collection) -> None:
    """The route to what is said of one collection."""

    @router.get(
        f"/collections/{collection.id}",
        name=f"collection_{collection.id}",
        summary=f"The collection of {collection.id}",
        response_class=Response,
        responses=pages.described("The collection.", {JSON: _EXAMPLE}, 400, 406, 503),
    )
    def document(request: Request, service: ServiceDep, base: BaseUrl, form: pages.FormDep) -> Response:
        """Title, extent, reference systems, and where its items, its schema and its tiles are."""
        here = f"{base}/collections/{collection.id}"
        up = link(f"{base}/collections", "parent", title="Collections")
        links = [*form.links(here), up, *collection_links(base, collection)]
        with service.reading() as session:
            content = collection_document(service, session, collection, links)
        above = pages.crumbs(base, ("Collections", "collections"))
        return pages.document_answer(
            request, form, content, links, "collection.html", collection.title, above, address=here
        )


for _collection in COLLECTIONS.values():
    _route(_collection)


@unknown.get("/collections/{collection_id}")
@unknown.get("/collections/{collection_id}/{rest:path}")
def no_such_collection(collection_id: str, rest: str = "") -> Response:
    """Say which there are."""
    if collection_id in COLLECTIONS:
        raise NotFoundError(say("items.nothing_at", collection=collection_id, rest=rest))
    raise NotFoundError(say("items.no_collection", name=collection_id, names=", ".join(COLLECTIONS)))


DIALECT = "https://json-schema.org/draft/2020-12/schema"
_RELATIONS = "http://www.opengis.net/def/rel/ogc/1.0/"
SCHEMA_RELATION = _RELATIONS + "schema"
QUERYABLES_RELATION = _RELATIONS + "queryables"
SORTABLES_RELATION = _RELATIONS + "sortables"

_ROLES = {"id": "id", "updated_at": "primary-instant"}
_XSD_TYPES = {
    ("integer", "int64"): "long",
    ("integer", "int32"): "int",
    ("number", None): "double",
    ("string", None): "string",
    ("string", "date-time"): "dateTime",
    ("boolean", None): "boolean",
}


def schema_links(base: str, collection: Collection) -> list[Link]:
    """The links of a collection to what describes it."""
    here = f"{base}/collections/{collection.id}"
    schema, queryables, sortables = (f"{here}/{name}" for name in ("schema", "queryables", "sortables"))
    return [
        link(schema, SCHEMA_RELATION, pages.SCHEMA_JSON, "The properties of the items, JSON Schema"),
        link(f"{schema}?f=xsd", "describedby", pages.XML, "The properties of the items, XML Schema"),
        link(f"{schema}?f=xsd", "describedBy", pages.XML, "The same, as GDAL before 3.7 writes the relation"),
        link(queryables, QUERYABLES_RELATION, pages.SCHEMA_JSON, "What may be filtered by"),
        link(sortables, SORTABLES_RELATION, pages.SCHEMA_JSON, "What may be sorted by"),
    ]


def property_schema(one: Property) -> dict[str, Any]:
    """The schema of a property's value where it is known."""
    document: dict[str, Any] = {"title": one.title, "description": one.description, "type": one.type}
    if one.format:
        document["format"] = one.format
    if one.values:
        document["enum"] = list(one.values)
    if one.unit:
        document["x-ogc-unit"] = one.unit
    return document


def returnables(address: str, collection: Collection) -> dict[str, Any]:
    """The schema of the items: all that is answered of each."""
    properties = _properties(collection.properties.values())
    for name, role in _ROLES.items():
        if name in properties:
            properties[name]["x-ogc-role"] = role
    properties[GEOMETRY] = {**_LINE, "x-ogc-role": "primary-geometry"}
    for n, one in enumerate(properties.values(), start=1):
        one["x-ogc-propertySeq"] = n
        one["readOnly"] = True
    required = [name for name, one in collection.properties.items() if not one.nullable]
    text = (
        f"{collection.title}: the properties of each item. Those that are not required may be null: unknown."
    )
    return {**_schema(address, collection.title, text, properties), "required": [*required, GEOMETRY]}


def queryables(address: str, collection: Collection) -> dict[str, Any]:
    """What ``filter`` may name; all but the line are parameters of their own, too."""
    properties = {**_properties(collection.properties.values()), GEOMETRY: dict(_LINE)}
    text = "What filters may name. Each but geometry is a parameter of its own as well, as in highway=residential."
    return _schema(address, f"{collection.title}: queryables", text, properties)


def sortables(address: str, collection: Collection) -> dict[str, Any]:
    """What ``sortby`` may name."""
    text = "What sortby may name, with a minus before it for descending order. The unknown comes last."
    properties = _properties(collection.properties.values())
    return _schema(address, f"{collection.title}: sortables", text, properties)


def xml_schema(collection: Collection) -> str:
    """The properties as elements of an XML Schema (GML), but for the id, which is the feature's own."""
    elements = "\n".join(
        f'    <xs:element name={quoteattr(one.name)} type="xs:{_XSD_TYPES[one.type, one.format]}" '
        f'minOccurs="{int(not one.nullable)}"/>'
        for one in collection.properties.values()
        if _ROLES.get(one.name) != "id"
    )
    return _XSD.format(name=collection.id, elements=elements)


def _schema(address: str, title: str, description: str, properties: Mapping[str, Any]) -> dict[str, Any]:
    head = {"$schema": DIALECT, "$id": address, "type": "object", "title": title, "description": description}
    return {**head, "properties": properties, "additionalProperties": False}


def _properties(known: Iterable[Property]) -> dict[str, dict[str, Any]]:
    return {one.name: property_schema(one) for one in known}


_LINE = {"title": "Line", "description": "From from_node to to_node.", "format": "geometry-linestring"}
_XSD = """<?xml version="1.0" encoding="UTF-8"?>
<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" xmlns:gml="http://www.opengis.net/gml/3.2"
    xmlns:versant="urn:versant:{name}" targetNamespace="urn:versant:{name}" elementFormDefault="qualified">
  <xs:import namespace="http://www.opengis.net/gml/3.2" schemaLocation="http://schemas.opengis.net/gml/3.2.1/gml.xsd"/>
  <xs:element name="{name}" type="versant:{name}Type" substitutionGroup="gml:AbstractFeature"/>
  <xs:complexType name="{name}Type"><xs:complexContent><xs:extension base="gml:AbstractFeatureType"><xs:sequence>
{elements}
    <xs:element name="geometry" type="gml:CurvePropertyType"/>
  </xs:sequence></xs:extension></xs:complexContent></xs:complexType>
</xs:schema>
"""
_SCHEMA_EXAMPLE = {"$schema": DIALECT, "type": "object", "properties": {"highway": {"type": "string"}}}
Maker = Callable[[str, Collection], dict[str, Any]]


def _schema_route(collection: Collection, name: str, title: str, text: str, make: Maker) -> None:
    """The route to one of the documents of one collection."""
    forms: tuple[pages.Form, ...] = (pages.AS_SCHEMA, pages.AS_HTML)
    contents: dict[str, Any] = {pages.SCHEMA_JSON: _SCHEMA_EXAMPLE}
    if make is returnables:
        forms = (pages.AS_SCHEMA, pages.AS_XSD, pages.AS_HTML)
        contents[pages.XML] = "<xs:schema/>"

    @router.get(
        f"/collections/{collection.id}/{name}",
        name=f"{name}_of_{collection.id}",
        summary=f"{title} of {collection.id}",
        description=text,
        response_class=Response,
        responses=pages.described(f"{title}.", contents, 400, 406),
    )
    def document(request: Request, base: BaseUrl, f: pages.FormatQuery = None) -> Response:
        refuse_unknown(request, {"f"})
        form = pages.wanted(request, f, *forms)
        up = f"{base}/collections/{collection.id}"
        address = f"{up}/{name}"
        links = [*form.links(address), link(up, "collection", title=collection.title)]
        if form.form is pages.AS_XSD:
            return pages.answered(request, xml_schema(collection), form.media_type, links=links)
        schema = make(address, collection)
        above = collection_crumbs(base, collection)
        return pages.document_answer(request, form, schema, links, "schema.html", schema["title"], above)


_ALL_OF_IT = "Every property of an item: type, unit, meaning. Also as XML Schema."
for _collection in COLLECTIONS.values():
    _schema_route(_collection, "schema", "Schema", _ALL_OF_IT, returnables)
    _schema_route(_collection, "queryables", "Queryables", "What `filter` may name.", queryables)
    _schema_route(_collection, "sortables", "Sortables", "What `sortby` may name.", sortables)
