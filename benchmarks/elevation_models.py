#!/usr/bin/env python3
"""What elevation models of different quality do to slopes: none, SRTM, one made of the true road heights, a wrong one.

    python benchmarks/elevation_models.py DATA_DIR [--method NAME] [--seeds 5] [--sequences 09,10] [--profile m8]
                                          [--drives 1] [--json FILE]

DATA_DIR is the folder ``karlsruhe``, or the one that holds it. Logs are those of ``slope_accuracy.py``. The models:

    none            no elevation model
    SRTM            the tiles of the folder
    road + 0.3 m    posts 5 m apart with the height of the nearest place of the reference track, as a lidar model has
                    them where there is a road, and an error of 0.3 m (one sigma) that hangs together over 30 m
    road + 3 m      the same with an error of 3 m
    corner off      as the first of these, but 30 m too high in the quarter of its extent in which about a quarter of
                    the drive lies: a tile on another datum

Printed for each sequence and model: RMSE (spread over the seeds), share of the true slopes that have an estimate, share
of errors within 1.96 sigma, root mean square of error over sigma; then what the reports of the drives say of the model:
its measurements, the share of outliers among them, the level of its noise as it was learned, and the warnings that name
it (numbers as #). A model as good as lidar ought to count as such, and one that is wrong ought to be called wrong.
"""

from __future__ import annotations

import re
import tempfile
from argparse import Namespace
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import rasterio
from rasterio import Affine
from scipy.spatial import cKDTree

from accuracy.arguments import data_parser_of, plain_errors
from accuracy.logs import read_columns
from accuracy.scoring import Errors, Row, figures, show_progress, text_table, write_json
from accuracy.sequences import (
    RECEIVERS,
    Sequence,
    find_sequences,
    folder_of,
    fuse,
    load_tool,
    make_log,
    slopes_of,
    tool_beside,
)
from fusion.frames import METRES_PER_DEGREE
from fusion.registry import DEFAULT_METHOD
from fusion.simulate.write.dem_file import correlated_field
from fusion.terrain.dem import Dem
from fusion.types import Bools, Floats

POSTING_M = 5.0
MARGIN_M = 100.0
ERROR_LENGTH_M = 30.0
"""Distance over which the error of a made model hangs together."""
CORNER_M = 30.0
CORNER_SHARE = 0.25
COLUMNS = {
    "sequence": ("sequence", ""),
    "model": ("model", ""),
    "rmse_percent": ("RMSE %", ".3f"),
    "rmse_spread": ("(spread)", ".3f"),
    "coverage": ("cover", ".1%"),
    "within_95": ("in 1.96s", ".1%"),
    "z_rms": ("z-rms", ".2f"),
    "measurements": ("measured", ".0f"),
    "outliers": ("outliers", ".1%"),
    "noise": ("learned noise", ""),
}
_NAMED = re.compile(r"\b(dem|elevation|terrain)\b", re.IGNORECASE)


class Model(NamedTuple):
    """A made elevation model: one sigma of its error, and what is added in its wrong corner."""

    error_m: float
    corner_m: float = 0.0


MODELS: dict[str, Model | None] = {
    "none": None,
    "SRTM": None,
    "road + 0.3 m": Model(0.3),
    "road + 3 m": Model(3.0),
    "corner off": Model(0.3, CORNER_M),
}


class Grid(NamedTuple):
    """Posts of a raster: degrees, shapes (columns,) and (rows,) with rows from the north."""

    lon_deg: Floats
    lat_deg: Floats


def grid_around(lon_deg: Floats, lat_deg: Floats) -> Grid:
    """Posts ``POSTING_M`` apart over the extent of a track and ``MARGIN_M`` around it."""
    step_lat = POSTING_M / METRES_PER_DEGREE
    step_lon = step_lat / float(np.cos(np.radians(lat_deg.mean())))
    more = MARGIN_M / POSTING_M
    return Grid(
        np.arange(lon_deg.min() - more * step_lon, lon_deg.max() + more * step_lon, step_lon),
        np.arange(lat_deg.min() - more * step_lat, lat_deg.max() + more * step_lat, step_lat)[::-1],
    )


def road_heights(grid: Grid, lon_deg: Floats, lat_deg: Floats, height_m: Floats) -> Floats:
    """The height of the nearest place of a track at every post, shape (rows, columns)."""
    shrink = float(np.cos(np.radians(lat_deg.mean())))
    tree = cKDTree(np.column_stack([lon_deg * shrink, lat_deg]))
    lon, lat = np.meshgrid(grid.lon_deg * shrink, grid.lat_deg)
    return np.asarray(height_m[tree.query(np.column_stack([lon.ravel(), lat.ravel()]))[1]]).reshape(lon.shape)


def wrong_corner(grid: Grid, lon_deg: Floats, lat_deg: Floats) -> Bools:
    """The quarter of the grid that holds the share of the track nearest to ``CORNER_SHARE``, shape (rows, columns)."""
    middle = (grid.lon_deg.mean(), grid.lat_deg.mean())
    east, north = lon_deg > middle[0], lat_deg > middle[1]
    corners = [(e, n) for e in (False, True) for n in (False, True)]
    share = [float(np.mean((east == e) & (north == n))) for e, n in corners]
    e, n = corners[int(np.argmin(np.abs(np.array(share) - CORNER_SHARE)))]
    return np.asarray(((grid.lon_deg > middle[0]) == e) & ((grid.lat_deg > middle[1]) == n)[:, None])


def make_model(model: Model, reference: Path, seed: int, path: Path) -> Path:
    """Write an elevation model made of a reference track as a GeoTIFF."""
    track = read_columns(reference)
    keep = track.get("valid", np.ones(len(track["lat_deg"]))) == 1
    lon, lat, height = (track[name][keep] for name in ("lon_deg", "lat_deg", "alt_m"))
    grid = grid_around(lon, lat)
    posts = road_heights(grid, lon, lat, height)
    rng = np.random.default_rng([seed, 3])
    posts += model.error_m * correlated_field(rng, posts.shape, (POSTING_M, POSTING_M), ERROR_LENGTH_M)
    posts += model.corner_m * wrong_corner(grid, lon, lat)
    write_geotiff(grid, posts, path)
    return path


def write_geotiff(grid: Grid, posts_m: Floats, path: Path) -> None:
    """Heights of posts as a raster of single precision, WGS 84 with heights above EGM96."""
    step_lon, step_lat = grid.lon_deg[1] - grid.lon_deg[0], grid.lat_deg[0] - grid.lat_deg[1]
    corner = Affine(
        step_lon, 0.0, grid.lon_deg[0] - step_lon / 2, 0.0, -step_lat, grid.lat_deg[0] + step_lat / 2
    )
    rows, columns = posts_m.shape
    profile = {"driver": "GTiff", "width": columns, "height": rows, "count": 1, "dtype": "float32"}
    with rasterio.open(path, "w", **profile, crs="EPSG:9707", transform=corner) as target:
        target.write(posts_m.astype(np.float32), 1)


@dataclass(frozen=True)
class Setup:
    """What logs are made with."""

    args: Namespace
    tool: ModuleType
    folder: Path

    def row(self, sequence: Sequence, model: str) -> Row:
        """The figures of one sequence with one model."""
        runs, reports = [], []
        for seed in range(self.args.seeds):
            show_progress(f"{sequence.name}, {model}: {seed + 1}/{self.args.seeds}")
            seeds = range(seed * self.args.drives, (seed + 1) * self.args.drives)
            logs = [make_log(self.tool, sequence, k, self.folder, self.args.profile) for k in seeds]
            road = replace(sequence, dem=self.dem(sequence, model, seed))
            fusion = fuse(road, logs, self.args.method)
            runs.append([Errors.of(sequence.truth, slopes_of(fusion))])
            reports += [one.result.report for one in fusion.fused]
        row = {"sequence": sequence.name, "model": model, **reported(reports)}
        return {"coverage": 0.0, **(figures(runs) or {}), **row}

    def dem(self, sequence: Sequence, name: str, seed: int) -> Dem | None:
        """The elevation model of a name; a made one has errors of its own for each seed."""
        model = MODELS[name]
        if model is None or sequence.reference is None:
            return sequence.dem if name == "SRTM" else None
        path = self.folder / f"{sequence.name}_{list(MODELS).index(name)}_{seed}.tif"
        return Dem.open([make_model(model, sequence.reference, seed, path)])


def reported(reports: list[dict[str, Any]]) -> Row:
    """What the drives' reports say of the elevation model."""
    dem = [sensors["dem"] for r in reports if "dem" in (sensors := r.get("sensors", {}))]
    count = sum(one["measurements"] for one in dem)
    texts = [text for r in reports for text in r.get("warnings", ()) if _NAMED.search(text)]
    warnings = Counter(re.sub(r"\d+(\.\d+)?", "#", text) for text in texts)
    return {
        "measurements": count / len(dem) if dem else None,
        "outliers": sum(one["outliers"] for one in dem) / count if count else None,
        "noise": learned_noise(reports) if dem else None,
        "warnings": dict(warnings),
    }


def learned_noise(reports: list[dict[str, Any]]) -> str | None:
    """The means of what the drives learned of the model's noise, by the names that the reports give it."""
    found: dict[str, list[float]] = {}
    for report in reports:
        for name, value in report.get("noise", {}).items():
            if name.startswith(("dem", "terrain")) and isinstance(value, int | float):
                found.setdefault(name, []).append(float(value))
    return ", ".join(f"{name} {np.mean(values):.3g}" for name, values in found.items()) or None


def run(args: Namespace) -> list[Row]:
    """Every sequence with every model."""
    folder = folder_of(args.data_dir, "karlsruhe")
    tool = load_tool(args.roadtruth or tool_beside(folder))
    sequences = find_sequences(folder, names=args.sequences)
    with tempfile.TemporaryDirectory() as temporary:
        setup = Setup(args, tool, Path(temporary))
        rows = [setup.row(sequence, model) for sequence in sequences for model in MODELS]
    show_progress("")
    return rows


def show(rows: list[Row]) -> None:
    """The table, and the warnings below it."""
    print(text_table(rows, COLUMNS))
    print("\nwarnings that name the elevation model, by how many drives got them")
    warnings = [(row, text, count) for row in rows for text, count in row["warnings"].items()]
    for row, text, count in warnings:
        print(f"  {row['sequence']} {row['model']}, {count}: {text}")
    if not warnings:
        print("  none")


def main() -> None:
    """Parse the command line, run, print."""
    parser = data_parser_of(__doc__)
    parser.add_argument("--method", default=DEFAULT_METHOD)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--drives", type=int, default=1, help="drives fused together for each seed")
    parser.add_argument("--profile", default="m8", choices=RECEIVERS)
    parser.add_argument("--sequences", default="09,10")
    args = parser.parse_args()
    with plain_errors():
        rows = run(args)
    show(rows)
    write_json(args.json, rows)


if __name__ == "__main__":
    main()
