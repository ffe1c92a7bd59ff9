"""Clients of OGC API Features: GDAL on the command line and inside pyogrio, OWSLib, QGIS."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import pyogrio
from geopandas import GeoDataFrame

from app.map.segment import PROPERTIES
from clients.truth import ENDS, Reading, Row

LIMIT_S = 600.0
PAGE = 10_000
PAGED = ("-oo", f"PAGE_SIZE={PAGE}")
COLLECTION = "segments"
NAMES = (*PROPERTIES, *ENDS)


def complete(client: Callable[[str, Path], Reading], address: str, folder: Path) -> Reading:
    """What a client got, with all rows at hand: a reading that another process may send."""
    reading = client(address, folder)
    return replace(reading, rows=list(reading.rows))


def ogr2ogr(address: str, folder: Path, options: Sequence[str] = ()) -> Reading:
    """The whole collection into a GeoPackage, by GDAL's own command; what is in it then.

    GDAL before 3.8 asks for ten features at a time unless it is told otherwise (``PAGED``).
    """
    target = folder / "ogr2ogr.gpkg"
    began = time.perf_counter()
    _run(
        "ogr2ogr",
        "-f",
        "GPKG",
        str(target),
        f"OAPIF:{address}",
        COLLECTION,
        "-lco",
        "FID=fid_of_gpkg",
        *options,
    )
    seconds = time.perf_counter() - began
    frame = pyogrio.read_dataframe(target, layer=COLLECTION)
    version = _run("ogrinfo", "--version").split(",")[0]
    return Reading(frame_rows(frame), NAMES, version, frame_kinds(frame), seconds=seconds)


def in_pyogrio(address: str, folder: Path) -> Reading:
    """The same by the GDAL inside pyogrio's wheel, as geopandas reads it."""
    began = time.perf_counter()
    frame = pyogrio.read_dataframe(f"OAPIF:{address}", layer=COLLECTION)
    seconds = time.perf_counter() - began
    gdal = ".".join(map(str, pyogrio.__gdal_version__))
    return Reading(
        frame_rows(frame), NAMES, f"{pyogrio.__version__}, GDAL {gdal}", frame_kinds(frame), seconds=seconds
    )


def owslib(address: str, folder: Path) -> Reading:
    """OWSLib, page by page along the ``next`` links."""
    from owslib.ogcapi.features import Features  # noqa: PLC0415 - only where it is installed

    began = time.perf_counter()
    client = Features(address)
    if COLLECTION not in client.feature_collections():
        raise RuntimeError(f"OWSLib does not see {COLLECTION}: {client.feature_collections()}")
    features: list[dict[str, Any]] = []
    parameters: dict[str, Any] = {"limit": PAGE}
    while parameters:
        page = client.collection_items(COLLECTION, **parameters)
        features += page["features"]
        following = [link["href"] for link in page["links"] if link["rel"] == "next"]
        parameters = dict(parse_qsl(urlsplit(following[0]).query)) if following else {}
    seconds = time.perf_counter() - began
    return Reading(map(geojson_row, features), NAMES, version("OWSLib"), seconds=seconds)


QGIS_SCRIPT = """
import json, sys
from qgis.core import Qgis, QgsApplication, QgsVectorLayer
application = QgsApplication([], False)
application.initQgis()
where = f"url='{sys.argv[1]}' typename='segments' pagingEnabled='true' pageSize='{sys.argv[2]}'"
layer = QgsVectorLayer(where, "segments", "OAPIF")
if not layer.isValid():
    sys.exit("QGIS cannot open it: " + str(layer.error().message()))
fields = layer.fields()
names = [field.name() for field in fields]
print(json.dumps({"version": Qgis.QGIS_VERSION, "types": {field.name(): field.typeName() for field in fields}}))
for feature in layer.getFeatures():
    line = feature.geometry().constGet()
    line = line.geometryN(0) if hasattr(line, "geometryN") else line
    first, last = line.startPoint(), line.endPoint()
    values = {}
    for name, value in zip(names, feature.attributes()):
        if hasattr(value, "isNull"):
            value = None if value.isNull() else value
        values[name] = value.toString("yyyy-MM-ddTHH:mm:ss.zzz+00:00") if hasattr(value, "timeSpec") else value
    print(json.dumps([values, first.x(), first.y(), last.x(), last.y()]))
"""
QGIS_KINDS = {
    "integer": "integer", "integer64": "integer", "double": "number", "real": "number", "string": "text",
    "boolean": "boolean", "datetime": "time",
}  # fmt: skip
SYSTEM_PYTHON = "/usr/bin/python3"
"""QGIS comes with the system's Python, not with ours."""


def qgis(address: str, folder: Path) -> Reading:
    """QGIS without a screen: its own OAPIF provider.

    QGIS 3.22 takes no schema and guesses types from the first features: what is unknown in all of them becomes text,
    and numbers of nodes beyond 32 bits wrap around where the first ones are smaller.
    """
    began = time.perf_counter()
    environment = {"QT_QPA_PLATFORM": "offscreen", "HOME": str(folder), "PATH": "/usr/bin:/bin", "TZ": "UTC"}
    output = _run(
        SYSTEM_PYTHON, "-c", QGIS_SCRIPT, f"{address}/", str(PAGE), environment=environment
    ).splitlines()
    seconds = time.perf_counter() - began
    lines = [json.loads(line) for line in output if line.startswith(("{", "["))]
    about, features = lines[0], lines[1:]
    kinds = {name: QGIS_KINDS.get(kind.lower(), kind) for name, kind in about["types"].items()}
    rows = ({**values, **dict(zip(ENDS, ends, strict=True))} for values, *ends in features)
    return Reading(rows, NAMES, about["version"], kinds, seconds=seconds)


def geojson_row(feature: dict[str, Any]) -> Row:
    """A GeoJSON feature as a row."""
    places = feature["geometry"]["coordinates"]
    ends = dict(zip(ENDS, (*places[0][:2], *places[-1][:2]), strict=True))
    return {**feature["properties"], "id": feature["id"], **ends}


def frame_rows(frame: GeoDataFrame) -> Iterator[Row]:
    """The rows of a table that GDAL read."""
    names = [name for name in frame.columns if name != "geometry"]
    columns = [frame[name].tolist() for name in names]
    for line, *values in zip(frame.geometry, *columns, strict=True):
        ends = (*line.coords[0][:2], *line.coords[-1][:2])
        yield {**dict(zip(names, values, strict=True)), **dict(zip(ENDS, ends, strict=True))}


def frame_kinds(frame: GeoDataFrame) -> dict[str, str]:
    """The kind of each column; those that no contract names are left out."""
    return {name: _kind(str(frame[name].dtype)) for name in frame.columns if name in PROPERTIES}


def _kind(dtype: str) -> str:
    starts = {"int": "integer", "float": "number", "bool": "boolean", "datetime": "time"}
    return next((kind for start, kind in starts.items() if dtype.lower().startswith(start)), "text")


def _run(*command: str, environment: Mapping[str, str] | None = None) -> str:
    """What a program prints; RuntimeError with what it complains of."""
    process = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=LIMIT_S, env=environment
    )
    if process.returncode or "ERROR" in process.stderr:
        raise RuntimeError(f"{command[0]}: {process.stderr.strip()[-500:]}")
    return process.stdout
