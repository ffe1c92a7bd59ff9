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
from app.map.picture.slope_map import stored_segments
from app.map.segment import Segment

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
    from app.map.picture.slope_picture import write_map  # noqa: PLC0415 - it draws with matplotlib

    folder.mkdir(parents=True, exist_ok=True)
    geojson, picture = folder / "slopes.geojson", folder / "slopes.png"
    profile, errors = folder / "profile.png", folder / "errors.csv"
    document = {"type": "FeatureCollection", "attribution": CREDIT, "features": result.features}
    geojson.write_text(json.dumps(document, separators=(",", ":")) + "\n", encoding="utf-8")
    segments = [Segment(**f["properties"], coordinates=f["geometry"]["coordinates"]) for f in result.features]
    title = "Slopes measured by the simulated drives"
    write_map(picture, stored_segments(segments), title=title, credit=CREDIT)
    profile.write_bytes(result.profile_png)
    _write_errors(result, errors)
    return {
        "every segment with its slope": geojson,
        "map of the slopes": picture,
        "elevation profile of one drive": profile,
        "every slope beside the truth": errors,
    }


def map_page(features: Sequence[Mapping[str, Any]]) -> str:
    """The path of the map page, on the roads of these features."""
    places = np.array([place for f in features for place in f["geometry"]["coordinates"]], float)
    box = [*places.min(axis=0), *places.max(axis=0)]
    return f"/map?bbox={','.join(f'{degrees:.5f}' for degrees in box)}"


def figures(result: DemoResult) -> dict[str, Any]:
    """What ``--json`` says."""
    return {
        "scores": _figures(result.scores()),
        "by_kind": _figures(result.scores_by_kind()),
        "by_structure": {kind: _figures(scores) for kind, scores in result.scores_by_structure().items()},
        "drives": [
            {"file": path.name, "drive": drive.id, "report": drive.document.get("report")}
            for path, drive in zip(result.bundle.drives, result.drives, strict=True)
        ],
        "seconds": result.seconds,
    }


def _figures(scores: Mapping[str, Score]) -> dict[str, Any]:
    return {name: asdict(score) for name, score in scores.items()}


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
