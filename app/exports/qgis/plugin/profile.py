"""Heights and slopes of the roads along lines, as points."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
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
    QgsProcessingParameterFeatureSink,
    QgsProcessingParameterFeatureSource,
    QgsProcessingParameterNumber,
    QgsWkbTypes,
)
from qgis.PyQt.QtCore import QVariant

from .algorithm import OUTPUT, Finish, VersantAlgorithm
from .slopes import DEGREES
from .words import either

LINES, STEP, RADIUS = "LINES", "STEP", "RADIUS"
COLUMNS = {
    "line": QVariant.LongLong,
    "part": QVariant.Int,
    "distance_m": QVariant.Double,
    "height_m": QVariant.Double,
    "sigma": QVariant.Double,
    "slope_percent": QVariant.Double,
    "slope_sigma_percent": QVariant.Double,
    "source": QVariant.String,
}
"""``line``: the number of the feature that the point is of; ``sigma``: of the height, metres."""
_OF_SERVICE = ("sigma", "slope_percent", "slope_sigma_percent", "source")


class Profile(VersantAlgorithm):
    """A layer of points along lines."""

    NAME = "profile"
    TITLE = ("Profile along a line", "Profil entlang einer Linie")
    HELP = (
        "Height and slope of the road at equal distances along each line: of a layer, or of one that you draw "
        "(Layer > Create Layer > New Temporary Scratch Layer). Slopes are positive where the line goes up; source "
        "tells what was measured from what is the elevation model's; off the roads the values are empty.",
        "Höhe und Steigung der Straße in gleichen Abständen entlang jeder Linie: einer Ebene oder einer, die Sie "
        "zeichnen (Layer > Layer erstellen > Neuer Temporärlayer). Steigungen sind positiv, wo die Linie "
        "bergauf geht; source sagt, was gemessen ist und was vom Höhenmodell; abseits der Straßen sind die Werte leer.",
    )

    def add_more(self) -> None:
        """Lines, step, radius, points."""
        kind = QgsProcessing.TypeVectorLine
        self.addParameter(QgsProcessingParameterFeatureSource(LINES, either("Lines", "Linien"), [kind]))
        real = QgsProcessingParameterNumber.Double
        step = either("Metres between points", "Meter zwischen Punkten")
        self.addParameter(QgsProcessingParameterNumber(STEP, step, real, 10.0, False, 1.0))
        radius = either(
            "Farthest off a road, metres",
            "Höchstens so weit neben einer Straße, Meter",
        )
        self.addParameter(QgsProcessingParameterNumber(RADIUS, radius, real, 25.0, False, 0.1, 100.0))
        points = QgsProcessing.TypeVectorPoint
        self.addParameter(QgsProcessingParameterFeatureSink(OUTPUT, either("Profile", "Profil"), points))

    def processAlgorithm(
        self, parameters: Any, context: QgsProcessingContext, feedback: QgsFeedback
    ) -> dict[str, Any]:
        """Ask for each part of each line."""
        service = self.service(parameters, context, feedback)
        source = self.parameterAsSource(parameters, LINES, context)
        if source is None:
            raise QgsProcessingException(self.invalidSourceError(parameters, LINES))
        degrees = QgsCoordinateReferenceSystem(DEGREES)
        to_degrees = QgsCoordinateTransform(source.sourceCrs(), degrees, context.transformContext())
        asked = {
            "range": True,
            "slope": True,
            "resample_distance": self.parameterAsDouble(parameters, STEP, context),
            "radius_m": self.parameterAsDouble(parameters, RADIUS, context),
        }
        fields = QgsFields()
        for name, kind in COLUMNS.items():
            fields.append(QgsField(name, kind))
        sink, destination = self.sink(parameters, context, fields, QgsWkbTypes.Point, degrees)
        credits_: set[str] = set()
        total = source.featureCount()
        for n, line in enumerate(source.getFeatures(), 1):
            for part, places in enumerate(parts_of(line.geometry(), to_degrees), 1):
                answer = service.post("/height", {"shape": places, **asked})
                credits_.add(answer["attribution"])
                feedback.pushInfo(climb_of(line.id(), answer))
                points = [*points_of(line.id(), part, answer, fields)]
                if not sink.addFeatures(points, QgsFeatureSink.FastInsert):
                    raise QgsProcessingException(self.writeFeatureError(sink, parameters, OUTPUT))
            if total > 0:
                feedback.setProgress(100 * n / total)
            if feedback.isCanceled():
                break
        del sink
        self.keep(parameters, context)
        Finish.of(context, destination, credits_)
        return {OUTPUT: destination}


def parts_of(geometry: QgsGeometry, to_degrees: QgsCoordinateTransform) -> Iterator[list[dict[str, float]]]:
    """The places of each part of a line, as the service takes them."""
    if geometry.isNull():
        return
    moved = QgsGeometry(geometry)
    moved.transform(to_degrees)
    moved.convertToMultiType()
    for part in moved.asMultiPolyline():
        if len(part) > 1:
            yield [{"lat": place.y(), "lon": place.x()} for place in part]


def points_of(line: int, part: int, answer: Any, fields: QgsFields) -> Iterator[QgsFeature]:
    """A point at each place of an answer."""
    columns = [answer[name] for name in _OF_SERVICE]
    for place, (distance, height), *more in zip(answer["shape"], answer["range_height"], *columns):
        sigma, slope, slope_sigma, source = more
        row = [line, part, distance, height, sigma, slope, slope_sigma, source]
        point = QgsFeature(fields)
        point.setAttributes(
            [QVariant(kind) if value is None else value for value, kind in zip(row, COLUMNS.values())]
        )
        point.setGeometry(QgsGeometry.fromPointXY(QgsPointXY(place["lon"], place["lat"])))
        yield point


def climb_of(line: int, answer: Any) -> str:
    """What a line goes up and down, in one sentence."""
    climb = answer.get("climb")
    if climb is None:
        return ""
    up, down = climb["ascent_m"], climb["descent_m"]
    measured = 100 * climb["measured_share"]
    return either(
        f"Line {line}: {up:.0f} m up, {down:.0f} m down; {measured:.0f} % of it was measured.",
        f"Linie {line}: {up:.0f} m hinauf, {down:.0f} m hinab; {measured:.0f} % davon sind gemessen.",
    )
