"""Logs to the service, and what became of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsFeature,
    QgsFeatureSink,
    QgsFeedback,
    QgsField,
    QgsFields,
    QgsProcessing,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingOutputNumber,
    QgsProcessingOutputString,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterFeatureSink,
    QgsProcessingParameterMultipleLayers,
    QgsWkbTypes,
)
from qgis.PyQt.QtCore import QThread, QVariant

from .algorithm import OUTPUT, VersantAlgorithm
from .client import Service
from .words import either

FILES, WAIT, DRIVES, DONE = "FILES", "WAIT", "DRIVES", "DONE"
COLUMNS = ("file", "drive", "status", "reason", "address")
ENDED = ("done", "failed", "cancelled")
POLL_MS = 1000
SLEEP_MS = 100
Row = dict[str, Any]


class Upload(VersantAlgorithm):
    """A table of drives."""

    NAME = "upload"
    TITLE = ("Upload drives", "Fahrten hochladen")
    HELP = (
        "Sends logs to the service: u-blox, NMEA, GPX, FIT, CSV and others, or zips of them. The same file again is "
        "the same drive. The table has a row for each drive, with its number, its state and, where it failed, why.",
        "Schickt Aufzeichnungen an den Dienst: u-blox, NMEA, GPX, FIT, CSV und andere, oder Zips davon. Dieselbe Datei "
        "noch einmal ist dieselbe Fahrt. Die Tabelle hat eine Zeile je Fahrt mit Nummer, Zustand und, wenn sie "
        "gescheitert ist, dem Grund.",
    )

    def add_more(self) -> None:
        """Files, patience, table."""
        files = either("Files", "Dateien")
        self.addParameter(QgsProcessingParameterMultipleLayers(FILES, files, QgsProcessing.TypeFile))
        wait = either(
            "Wait until each drive is done or failed", "Warten, bis jede Fahrt fertig oder gescheitert ist"
        )
        self.addParameter(QgsProcessingParameterBoolean(WAIT, wait, False))
        table = QgsProcessing.TypeVector
        self.addParameter(QgsProcessingParameterFeatureSink(OUTPUT, either("Drives", "Fahrten"), table))
        self.addOutput(
            QgsProcessingOutputString(DRIVES, either("Numbers of the drives", "Nummern der Fahrten"))
        )
        self.addOutput(QgsProcessingOutputNumber(DONE, either("Drives that are done", "Fertige Fahrten")))

    def processAlgorithm(
        self, parameters: Any, context: QgsProcessingContext, feedback: QgsFeedback
    ) -> dict[str, Any]:
        """Send one file after the other, then wait for all."""
        service = self.service(parameters, context, feedback)
        files = [Path(name) for name in self.parameterAsFileList(parameters, FILES, context)]
        waits = self.parameterAsBool(parameters, WAIT, context)
        rows: list[Row] = []
        for n, file in enumerate(files, 1):
            if feedback.isCanceled():
                break
            feedback.setProgressText(file.name)
            rows += _sent(service, file, feedback)
            feedback.setProgress((50 if waits else 100) * n / len(files))
        if waits:
            _follow(service, [row for row in rows if row["drive"]], feedback)
        destination = self._table(parameters, context, rows)
        if any(row["drive"] for row in rows):
            self.keep(parameters, context)
        drives = [row["drive"] for row in rows if row["drive"]]
        done = sum(row["status"] == "done" for row in rows)
        return {OUTPUT: destination, DRIVES: ",".join(drives), DONE: done}

    def _table(self, parameters: Any, context: QgsProcessingContext, rows: list[Row]) -> str:
        fields = QgsFields()
        for name in COLUMNS:
            fields.append(QgsField(name, QVariant.String))
        nowhere = QgsCoordinateReferenceSystem()
        sink, destination = self.sink(parameters, context, fields, QgsWkbTypes.NoGeometry, nowhere)
        for row in rows:
            feature = QgsFeature(fields)
            feature.setAttributes([row[name] or QVariant(QVariant.String) for name in COLUMNS])
            sink.addFeature(feature, QgsFeatureSink.FastInsert)
        return destination


def _sent(service: Service, file: Path, feedback: QgsFeedback) -> list[Row]:
    """A row for each drive of a file, and for each file in it that is in none; what is refused ends nothing."""
    try:
        answer = service.post_file("/v1/drives", file)
    except QgsProcessingException as error:
        if feedback.isCanceled():
            raise
        feedback.reportError(f"{file.name}: {error}")
        return [_told(file.name, None, "not sent", str(error), None)]
    rows = [
        _told(
            ", ".join(one["files"]) or file.name,
            one["id"],
            one["status"],
            None,
            f"{service.address}/drives/{one['id']}",
        )
        for one in answer["drives"]
    ]
    return rows + [_told(one["file"], None, "left out", one["reason"], None) for one in answer["left_out"]]


def _told(*values: str | None) -> Row:
    return dict(zip(COLUMNS, values))


def _follow(service: Service, rows: list[Row], feedback: QgsFeedback) -> None:
    """Ask for the states until all have ended, or until a person has waited enough."""
    waiting = list(rows)
    while waiting and not feedback.isCanceled():
        for row in waiting:
            drive = service.get(f"/v1/drives/{row['drive']}")
            row["status"] = drive["status"]
            row["reason"] = (drive.get("failure") or {}).get("reason")
            if row["status"] in ENDED:
                feedback.pushInfo(f"{row['file']}: {row['status']}")
            if row["reason"]:
                feedback.reportError(f"{row['file']}: {row['reason']}")
        waiting = [row for row in waiting if row["status"] not in ENDED]
        feedback.setProgress(50 + 50 * (len(rows) - len(waiting)) / len(rows))
        for _ in range(POLL_MS // SLEEP_MS if waiting else 0):
            if not feedback.isCanceled():
                QThread.msleep(SLEEP_MS)
