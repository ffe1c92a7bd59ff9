"""What properties a collection has, what may be filtered and sorted by: JSON Schema, and XML Schema for GDAL.

OGC API Features, parts 3 and 5: a property has one type; those that are not ``required`` may be null. GDAL and what
stands on it (QGIS) take the types of properties from an XML Schema that a collection is ``describedby`` and no other
document tells them of integers of 64 bits: its reader of JSON Schema makes 32 bits of every integer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any
from xml.sax.saxutils import quoteattr

from fastapi import APIRouter, Request, Response

from app.core.http import BaseUrl, Link, link
from app.core.query import refuse_unknown
from app.map.items.collections import COLLECTIONS, GEOMETRY, Collection, Property
from app.map.items.negotiation import (
    AS_HTML,
    AS_SCHEMA,
    AS_XSD,
    SCHEMA_JSON,
    XML,
    FormatQuery,
    answered,
    wanted,
)
from app.map.items.pages import described, document_answer

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

router = APIRouter(tags=["map"])


def schema_links(base: str, collection: Collection) -> list[Link]:
    """The links of a collection to what describes it."""
    here = f"{base}/collections/{collection.id}"
    schema, queryables, sortables = (f"{here}/{name}" for name in ("schema", "queryables", "sortables"))
    return [
        link(schema, SCHEMA_RELATION, SCHEMA_JSON, "The properties of the items, JSON Schema"),
        link(f"{schema}?f=xsd", "describedby", XML, "The properties of the items, XML Schema"),
        link(f"{schema}?f=xsd", "describedBy", XML, "The same, as GDAL before 3.7 writes the relation"),
        link(queryables, QUERYABLES_RELATION, SCHEMA_JSON, "What may be filtered by"),
        link(sortables, SORTABLES_RELATION, SCHEMA_JSON, "What may be sorted by"),
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
    properties = {**_properties(collection.queryables.values()), GEOMETRY: dict(_LINE)}
    text = "What filters may name. Each but geometry is a parameter of its own as well, as in highway=residential."
    return _schema(address, f"{collection.title}: queryables", text, properties)


def sortables(address: str, collection: Collection) -> dict[str, Any]:
    """What ``sortby`` may name."""
    text = "What sortby may name, with a minus before it for descending order. The unknown comes last."
    properties = _properties(collection.sortables.values())
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
    return {
        "$schema": DIALECT,
        "$id": address,
        "type": "object",
        "title": title,
        "description": description,
        "properties": properties,
        "additionalProperties": False,
    }


def _properties(known: Iterable[Property]) -> dict[str, dict[str, Any]]:
    return {one.name: property_schema(one) for one in known}


_LINE = {
    "title": "Line",
    "description": "From from_node to to_node.",
    "format": "geometry-linestring",
}
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
_EXAMPLE = {"$schema": DIALECT, "type": "object", "properties": {"highway": {"type": "string"}}}
Maker = Callable[[str, Collection], dict[str, Any]]


def _route(collection: Collection, name: str, title: str, text: str, make: Maker) -> None:
    """The route to one of the documents of one collection."""
    forms = (AS_SCHEMA, AS_XSD, AS_HTML) if make is returnables else (AS_SCHEMA, AS_HTML)

    def document(request: Request, base: BaseUrl, f: FormatQuery = None) -> Response:
        refuse_unknown(request, {"f"})
        form = wanted(request, f, *forms)
        up = f"{base}/collections/{collection.id}"
        address = f"{up}/{name}"
        links = [*form.links(address), link(up, "collection", title=collection.title)]
        if form.form is AS_XSD:
            return answered(request, xml_schema(collection), form.media_type, links=links)
        schema = make(address, collection)
        above = [("Versant", f"{base}/"), ("Collections", f"{base}/collections"), (collection.title, up)]
        return document_answer(
            request, form, schema, links, template="schema.html", title=schema["title"], crumbs=above
        )

    document.__doc__ = text
    contents: dict[str, Any] = {SCHEMA_JSON: _EXAMPLE, **({XML: "<xs:schema/>"} if AS_XSD in forms else {})}
    router.add_api_route(
        f"/collections/{collection.id}/{name}",
        document,
        name=f"{name}_of_{collection.id}",
        summary=f"{title} of {collection.id}",
        response_class=Response,
        responses=described(f"{title}.", contents, 400, 406),
    )


for _collection in COLLECTIONS.values():
    _route(
        _collection,
        "schema",
        "Schema",
        "Every property of an item: type, unit, meaning. Also as XML Schema.",
        returnables,
    )
    _route(_collection, "queryables", "Queryables", "What `filter` may name.", queryables)
    _route(_collection, "sortables", "Sortables", "What `sortby` may name.", sortables)
