"""The newest slopes of an area, page by page, with the types of the service's own schema."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any
from urllib.parse import urlencode, urlsplit

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsFeature,
    QgsFeatureSink,
    QgsFeedback,
    QgsField,
    QgsFields,
    QgsGeometry,
    QgsPointXY,
    QgsProcessing,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterExtent,
    QgsProcessingParameterFeatureSink,
    QgsRectangle,
    QgsWkbTypes,
)
from qgis.PyQt.QtCore import QDateTime, Qt, QVariant

from .algorithm import OUTPUT, STYLE, Finish, VersantAlgorithm
from .client import Service
from .words import either

EXTENT, DRIVEN = "EXTENT", "DRIVEN"
PAGE = 10_000
"""Items that are asked for at once; a service gives fewer where it may."""
DEGREES = "EPSG:4326"
COLLECTION = "/collections/segments"
_KINDS = {
    "integer": QVariant.LongLong,  # numbers of OpenStreetMap exceed 32 bits
    "number": QVariant.Double,
    "boolean": QVariant.Bool,
    "string": QVariant.String,
}
Item = Mapping[str, Any]


class Slopes(VersantAlgorithm):
    """A layer of segments."""

    NAME = "slopes"
    TITLE = ("Newest slopes of an area", "Neueste Steigungen eines Gebiets")
    HELP = (
        "The road segments of an area with the slopes that the service has now. Slopes are in percent, positive uphill "
        "from from_node to to_node, the direction of the line; sigma is one standard deviation; unknown is empty. The "
        "layer is drawn as the service's map is: colour is steepness, width is certainty.",
        "Die Straßensegmente eines Gebiets mit den Steigungen, die der Dienst jetzt hat. In Prozent, positiv "
        "bergauf von from_node nach to_node, in Richtung der Linie; Sigma ist eine Standardabweichung; Unbekanntes "
        "ist leer. Die Ebene wird wie die Karte des Dienstes gezeichnet: Farbe ist Steilheit, Breite ist Sicherheit.",
    )

    def add_more(self) -> None:
        """Area, choice, layer."""
        self.addParameter(QgsProcessingParameterExtent(EXTENT, either("Area", "Gebiet")))
        driven = either("Only segments that were driven", "Nur befahrene Segmente")
        self.addParameter(QgsProcessingParameterBoolean(DRIVEN, driven, True))
        kind = QgsProcessing.TypeVectorLine
        self.addParameter(QgsProcessingParameterFeatureSink(OUTPUT, either("Slopes", "Steigungen"), kind))

    def processAlgorithm(
        self, parameters: Any, context: QgsProcessingContext, feedback: QgsFeedback
    ) -> dict[str, Any]:
        """Read the schema, then all pages."""
        service = self.service(parameters, context, feedback)
        degrees = QgsCoordinateReferenceSystem(DEGREES)
        area = self.parameterAsExtent(parameters, EXTENT, context, degrees)
        query = {"bbox": box_of(area), "limit": PAGE}
        if self.parameterAsBool(parameters, DRIVEN, context):
            query["driven"] = "true"
        columns = columns_of(service.get(f"{COLLECTION}/schema")["properties"])
        fields = QgsFields()
        for name, kind in columns.items():
            fields.append(QgsField(name, kind))
        sink, destination = self.sink(parameters, context, fields, QgsWkbTypes.LineString, degrees)
        credits_: set[str] = set()
        count = 0
        for page in pages(service, query):
            credits_.add(page.get("attribution", ""))
            features = [feature_of(item, columns, fields) for item in page["features"]]
            if not sink.addFeatures(features, QgsFeatureSink.FastInsert):
                raise QgsProcessingException(self.writeFeatureError(sink, parameters, OUTPUT))
            count += len(features)
            if page.get("numberMatched"):
                feedback.setProgress(100 * count / page["numberMatched"])
            feedback.setProgressText(either(f"{count} segments", f"{count} Segmente"))
            if feedback.isCanceled():
                break
        del sink  # writes what is left
        self.keep(parameters, context)
        Finish.of(context, destination, credits_ - {""}, STYLE)
        return {OUTPUT: destination}


def box_of(area: QgsRectangle) -> str:
    """The area as the service takes it, within what degrees there are."""
    west, east = (min(180.0, max(-180.0, x)) for x in (area.xMinimum(), area.xMaximum()))
    south, north = (min(90.0, max(-90.0, y)) for y in (area.yMinimum(), area.yMaximum()))
    return f"{west:.9f},{south:.9f},{east:.9f},{north:.9f}"


def columns_of(properties: Mapping[str, Item]) -> dict[str, Any]:
    """Name and type of each field, by the schema of the collection; what is no plain value is no field."""
    return {
        name: QVariant.DateTime if one.get("format") == "date-time" else _KINDS[one["type"]]
        for name, one in properties.items()
        if one.get("type") in _KINDS
    }


def pages(service: Service, query: Mapping[str, Any]) -> Iterator[Item]:
    """Every page. Of the links to the next one only the query counts: a key goes to the address that it is for."""
    following = urlencode(query, safe=",")
    while following:
        page = service.get_query(f"{COLLECTION}/items", following)
        yield page
        links = [one["href"] for one in page["links"] if one["rel"] == "next"]
        following = urlsplit(links[0]).query if links else ""


def feature_of(item: Item, columns: Mapping[str, Any], fields: QgsFields) -> QgsFeature:
    """An item as a feature; unknown values are NULL."""
    feature = QgsFeature(fields)
    known = {"id": item["id"], **item["properties"]}
    feature.setAttributes([_value(known.get(name), kind) for name, kind in columns.items()])
    line = (item["geometry"] or {}).get("coordinates", [])
    if line:
        feature.setGeometry(QgsGeometry.fromPolylineXY([QgsPointXY(*place[:2]) for place in line]))
    return feature


def _value(value: Any, kind: Any) -> Any:
    if value is None:
        return QVariant(kind)
    if kind == QVariant.DateTime:
        return QDateTime.fromString(value, Qt.ISODateWithMs)
    return float(value) if kind == QVariant.Double else value
