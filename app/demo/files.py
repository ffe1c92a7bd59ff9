"""What the demonstration leaves behind, to be opened."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from app.demo.run import DemoResult
from app.demo.score import Score
from app.map.picture.slope_map import MapSegments

CREDIT = "Simulated town; no real place. Made by `versant demo`."


ERROR_COLUMNS = (
    "osm_way_id",
    "from_node",
    "to_node",
    "highway",
    "true_slope_percent",
    "slope_percent",
    "slope_sigma_percent",
    "error_percent",
    "drives",
)


def write_files(result: DemoResult, folder: Path) -> dict[str, Path]:
    """Write slopes.geojson, slopes.png, profile.png and errors.csv; returns what each is and where."""
    folder.mkdir(parents=True, exist_ok=True)
    geojson, picture = folder / "slopes.geojson", folder / "slopes.png"
    profile, errors = folder / "profile.png", folder / "errors.csv"
    document = {"type": "FeatureCollection", "attribution": CREDIT, "features": result.features}
    geojson.write_text(json.dumps(document, separators=(",", ":")) + "\n", encoding="utf-8")
    draw_map(result.features, picture, title="Slopes measured by the simulated drives", credit=CREDIT)
    profile.write_bytes(result.profile_png)
    _write_errors(result, errors)
    return {
        "every segment with its slope": geojson,
        "map of the slopes": picture,
        "elevation profile of one drive": profile,
        "every slope beside the truth": errors,
    }


def draw_map(features: Sequence[Mapping[str, Any]], path: Path, *, title: str, credit: str) -> None:
    """Draw a service's features as a slope map."""
    from app.map.picture.slope_picture import write_map  # noqa: PLC0415 - it draws with matplotlib

    ends = np.array([[f["geometry"]["coordinates"][0], f["geometry"]["coordinates"][-1]] for f in features])
    columns = [f["properties"] for f in features]
    segments = MapSegments(
        ends_deg=ends,
        slope_percent=_column(columns, "slope_percent"),
        slope_sigma_percent=_column(columns, "slope_sigma_percent"),
        bridge=np.array([bool(c["bridge"]) for c in columns]),
        tunnel=np.array([bool(c["tunnel"]) for c in columns]),
        name=np.array([c["name"] for c in columns], np.object_),
    )
    write_map(path, segments, title=title, credit=credit)


def map_address(service: str, features: Sequence[Mapping[str, Any]]) -> str:
    """The map page, on the roads of these features."""
    places = np.array([place for f in features for place in f["geometry"]["coordinates"]], float)
    box = [*places.min(axis=0), *places.max(axis=0)]
    return f"{service}/map?bbox={','.join(f'{degrees:.5f}' for degrees in box)}"


def figures(result: DemoResult) -> dict[str, Any]:
    """What ``--json`` says."""
    return {
        "scores": {name: _figures(s) for name, s in result.scores().items()},
        "by_kind": {name: _figures(s) for name, s in result.scores_by_kind().items()},
        "by_structure": {
            kind: {name: _figures(s) for name, s in scores.items()}
            for kind, scores in result.scores_by_structure().items()
        },
        "drives": [
            {"file": path.name, "drive": drive.id, "report": drive.document.get("report")}
            for path, drive in zip(result.bundle.drives, result.drives, strict=True)
        ],
        "seconds": result.seconds,
    }


def _figures(one: Score) -> dict[str, Any]:
    return {**asdict(one), "coverage": one.coverage}


def _column(columns: Sequence[Mapping[str, Any]], name: str) -> Any:
    return np.array([np.nan if c[name] is None else c[name] for c in columns], float)


def _write_errors(result: DemoResult, path: Path) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(ERROR_COLUMNS)
        features = result.properties
        for key, road in result.truth.items():
            got = features[key]
            slope = got["slope_percent"]
            error = None if slope is None else round(slope - road.slope_percent, 4)
            estimate = (slope, got["slope_sigma_percent"], error, got["drives"])
            table.writerow([*key, road.highway, round(road.slope_percent, 4), *estimate])
