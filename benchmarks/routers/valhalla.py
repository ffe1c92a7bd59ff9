"""Grades that routers take from an elevation model alone, and from the same with measured roads in it.

    PYTHONPATH=.:benchmarks python -m routers.valhalla MAP.osm.pbf --programs DIR [--relief HGT] [--drives 60]
        [--minutes 15] [--routes 200] [--seeds 1 2 3 4 5] [--crossings shared|ground|upper] [--keep DIR] [--json FILE]

MAP is Heidelberg's extract (or any that holds ``routers.made.WINDOW``); DIR is the folder ``valhalla`` of the package
with its Python bindings, with ``bin/valhalla_build_tiles`` and ``bin/valhalla_service`` in it. Its programs run without
that Python. Where they are missing the rows of Valhalla are left out, and it is said. ``--relief`` gives the ground its
broad shape (an HGT tile); hills are made up without it.

Roads are real, their heights are made (``routers.made``), so the truth is known. Drives with mixed receivers are
simulated over them, fused with an elevation model that errs and knows no bridge, bank or cutting, and solved together,
as a service does; the export ``dem-hgt`` of that solution, for each router, is the second model. Valhalla builds the
map with both.

    weighted_grade, max_upward_grade   of the edges of ``--routes`` routes that Valhalla finds between random places,
                                       against what it would say of true heights
    height                             ``/height`` along these routes every 30 m: grades from place to place
    GraphHopper, BRouter               their samplers (``routers.samplers``) at the nodes of all segments of 20 m or
                                       more, and at the ends of bridges and tunnels

Printed: root mean square errors in percent of grade before and after, for all, for bridges and tunnels, for edges that
touch one, for banks and cuttings (a metre off the ground and more), on segments that drives measured and on all; the
median of scenes by their seeds, and of the shares that are left the largest. Heights, drives and routes are other ones
in each scene.

Aim: halved overall.
"""

from __future__ import annotations

import argparse
import tempfile
import zipfile
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

import numpy as np

from accuracy.arguments import parser_of
from accuracy.scoring import show_progress, text_table, write_json
from app.batch.outputs import SolvedSource
from app.cli.logs.fusing import Fusion
from app.exports.formats import FORMATS
from app.exports.source import Source
from fusion.pipeline import parse_options
from fusion.registry import DEFAULT_METHOD
from fusion.roads.osm import read_roads
from fusion.simulate.demonstration import demo_drives
from fusion.terrain.dem import Dem
from fusion.types import Bools, Floats, Ints
from routers.errors import Collected, Rows, median_rows
from routers.made import WINDOW, Scene, make_scene, on_structure
from routers.nodes import BANK_M, sampled_rows
from routers.programs import Valhalla, decoded
from routers.samplers import HgtTile, stations_m, valhalla_grades

STEP_M = 30.0
PLACES_AT_ONCE = 1500
"""A request is an argument of a program, which is bounded."""
OFF_ROAD_M = 3.0
"""Places of an edge farther from the made roads are not of them."""
COLUMNS = {"what": ("what", ""), "where": ("where", ""), "n": ("n", "d"), "before": ("before %", ".2f"),
           "after": ("after %", ".2f"), "left": ("left", ".0%"), "most_left": ("most", ".0%")}  # fmt: skip


class Places:
    """The made roads by their ways: which segment a place of a way is on, and its true height."""

    def __init__(self, scene: Scene, measured: Bools) -> None:
        self.scene, self.measured = scene, measured
        way = scene.town.roads.osm_way_id
        self._first = {int(w): int(k) for k, w in reversed(list(enumerate(way.tolist())))}
        self._count = {int(w): int(c) for w, c in zip(*np.unique(way, return_counts=True), strict=True)}

    def on(self, way: int, lon_deg: Floats, lat_deg: Floats) -> tuple[Ints, Floats] | None:
        """Rows of segments and true heights (n,); None where a place is not on the way as it was made."""
        if way not in self._first:
            return None
        town, first = self.scene.town, self._first[way]
        rows = np.arange(first, first + self._count[way])
        x, y = town.projection.to_xy(lon_deg, lat_deg)
        ax, ay = town.node_x_m[town.start[rows]], town.node_y_m[town.start[rows]]
        dx, dy = town.node_x_m[town.end[rows]] - ax, town.node_y_m[town.end[rows]] - ay
        along = (x[:, None] - ax) * dx + (y[:, None] - ay) * dy
        share = np.clip(along / np.maximum(dx**2 + dy**2, 1e-9), 0, 1)
        off = np.hypot(x[:, None] - ax - share * dx, y[:, None] - ay - share * dy)
        best, n = off.argmin(axis=1), np.arange(len(x))
        if off[n, best].max() > OFF_ROAD_M:
            return None
        return rows[best], np.asarray(town.road_height(rows[best], share[n, best]))


def main() -> None:
    """Run it."""
    asked = _arguments()
    if not _has_valhalla(asked):
        print("Valhalla is left out: --programs DIR has to name a folder with bin/valhalla_service in it.")
    roads = read_roads(asked.map)
    each = []
    for seed in asked.seeds:
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch if asked.keep is None else asked.keep / str(seed))
            each.append(_one_scene(make_scene(roads, WINDOW, asked.relief, seed), folder, asked, seed))
    rows = median_rows([one["rows"] for one in each])
    print(text_table(rows, COLUMNS))
    write_json(asked.json, {"rows": rows, "scenes": each})


def _has_valhalla(asked: argparse.Namespace) -> bool:
    return asked.programs is not None and (asked.programs / "bin" / "valhalla_service").is_file()


def _one_scene(scene: Scene, folder: Path, asked: argparse.Namespace, seed: int) -> dict[str, Any]:
    """The rows of one scene."""
    folder.mkdir(parents=True, exist_ok=True)
    before = scene.write_tile(folder / "before", seed)
    measured = _measured(scene, before, folder, asked, seed)
    both = HgtTile(folder / "brouter" / before.name), HgtTile(folder / "graphhopper" / before.name)
    rows = _driven(scene, folder, measured, asked, seed) if _has_valhalla(asked) else []
    rows += sampled_rows(scene, HgtTile(before), both, measured)
    share = scene.town.length_m[measured].sum() / scene.town.length_m.sum()
    km = scene.town.length_m.sum() / 1000
    print(f"scene {seed}: {len(scene.town.roads)} segments, {km:.0f} km, {share:.0%} measured")
    return {"seed": seed, "segments": len(scene.town.roads), "measured": int(measured.sum()), "rows": rows}


def _arguments() -> argparse.Namespace:
    parser = parser_of(__doc__)
    parser.add_argument("map", type=Path)
    for name in ("--programs", "--relief", "--keep"):
        parser.add_argument(name, type=Path)
    for name, usual in (("--drives", 60), ("--minutes", 15), ("--routes", 200)):
        parser.add_argument(name, type=int, default=usual)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5])
    parser.add_argument("--crossings", choices=["shared", "ground", "upper"])
    return parser.parse_args()


def _measured(scene: Scene, tile: Path, folder: Path, asked: argparse.Namespace, seed: int) -> Bools:
    """Drive, solve and export; which segments of the scene have a measured height."""
    with Dem.open([tile]) as dem:
        fusion = Fusion(DEFAULT_METHOD, parse_options(DEFAULT_METHOD), scene.roads, dem)
        drives = demo_drives(scene.town, asked.drives, seed, duration_s=60.0 * asked.minutes)
        for number, named in enumerate(drives):
            show_progress(f"drive {number + 1} of {asked.drives}")
            fusion.add(named.write(folder))
        show_progress("network")
        solution = fusion.solve().solution
        source = SolvedSource(solution, datetime.now(UTC), [asked.map], lambda: dem)
        form = FORMATS["dem-hgt"]
        crossings = {} if asked.crossings is None else {"crossings": asked.crossings}
        for router in ("valhalla", "graphhopper", "brouter"):
            archive, options = (
                folder / f"{router}.hgt.zip",
                form.parse_options({"router": router} | crossings, local=True),
            )
            form.write(cast(Source, source), archive, {"attribution": ""}, options)
            zipfile.ZipFile(archive).extractall(folder / router)
        print(source.notes[0])
    for inner in (folder / "graphhopper").glob("*.hgt.zip"):
        zipfile.ZipFile(inner).extractall(inner.parent)
    ours, known = scene.town.roads, solution.roads
    keys = set(zip(known.osm_way_id.tolist(), known.from_node.tolist(), known.to_node.tolist(), strict=True))
    mine = zip(ours.osm_way_id.tolist(), ours.from_node.tolist(), ours.to_node.tolist(), strict=True)
    return np.array([key in keys for key in mine], bool)


def _driven(scene: Scene, folder: Path, measured: Bools, asked: argparse.Namespace, seed: int) -> Rows:
    """Valhalla's edges and heights along routes."""
    valhalla = Valhalla(asked.programs, folder)
    show_progress("Valhalla's tiles")
    valhalla.build(asked.map)
    for name, elevation in (("before", folder / "before"), ("after", folder / "valhalla")):
        valhalla.with_elevation(f"tiles-{name}", elevation, asked.map)
    places, chance = Places(scene, measured), np.random.default_rng([seed, 73])
    edges, steps = Collected(), Collected()
    done = tries = 0
    while done < asked.routes and tries < 3 * asked.routes:
        tries += 1
        show_progress(f"route {done + 1} of {asked.routes}")
        done += _route(valhalla, places, scene, chance, edges, steps)
    show_progress("heights")
    _ask_heights(valhalla, steps)
    return [
        *edges.errors(0).rows("weighted_grade"),
        *edges.errors(1).rows("max_upward_grade"),
        *steps.errors(0).rows("height"),
    ]


def _route(
    valhalla: Valhalla,
    places: Places,
    scene: Scene,
    chance: np.random.Generator,
    edges: Collected,
    steps: Collected,
) -> bool:
    """One route: its edges and steps are added; whether there is one."""
    town = scene.town
    two = chance.choice(len(town.node_id), 2, replace=False)
    ends = [{"lat": float(town.node_lat_deg[k]), "lon": float(town.node_lon_deg[k])} for k in two]
    route = valhalla.ask("tiles-before", "route", {"locations": ends, "costing": "auto"})
    if "trip" not in route:
        return False
    walk = {
        "encoded_polyline": route["trip"]["legs"][0]["shape"],
        "costing": "auto",
        "shape_match": "edge_walk",
    }
    traced = [valhalla.ask(f"tiles-{name}", "trace_attributes", walk) for name in ("before", "after")]
    if any("edges" not in one for one in traced):
        return False
    line = decoded(traced[0]["shape"])
    for before, after in list(zip(traced[0]["edges"], traced[1]["edges"], strict=True))[1:-1]:
        _edge(places, scene, line, (before, after), (edges, steps))
    return True


def _edge(
    places: Places,
    scene: Scene,
    line: Floats,
    both: tuple[Any, Any],
    to: tuple[Collected, Collected],
) -> None:
    edge = both[0]
    shape = line[edge["begin_shape_index"] : edge["end_shape_index"] + 1]
    x, y = scene.town.projection.to_xy(shape[:, 0], shape[:, 1])
    along = np.r_[0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y)))]
    stations = stations_m(float(along[-1]))
    at = [np.interp(stations, along, shape[:, k]) for k in range(2)]
    known = places.on(edge["way_id"], *at)
    if known is None:
        return
    rows, height = known
    deck = bool(edge.get("bridge") or edge.get("tunnel"))
    decks = on_structure(scene.town)
    nodes = np.r_[scene.town.start[decks], scene.town.end[decks]]
    mine = np.r_[scene.town.start[rows], scene.town.end[rows]]
    facts = (bool(places.measured[rows].all()), deck, bool(np.isin(mine, nodes).any()),
             bool((np.abs(scene.above_ground_m[rows]) > BANK_M).any()))  # fmt: skip
    edges, steps = to
    edges.true.append(valhalla_grades(height, float(along[-1]), deck))
    edges.facts.append(facts)
    for found, one in zip(edges.found, both, strict=True):
        found.append((one["weighted_grade"], one["max_upward_grade"]))
    _steps(places, edge["way_id"], (along, shape), facts, steps)


def _steps(
    places: Places,
    way: int,
    edge: tuple[Floats, Floats],
    facts: tuple[bool, bool, bool, bool],
    steps: Collected,
) -> None:
    """Where heights are to be asked for along an edge, and the true grades between."""
    along, shape = edge
    if along[-1] < STEP_M:
        return
    count = int(along[-1] // STEP_M)
    stations = np.linspace(0, along[-1], count + 1)
    lon, lat = (np.interp(stations, along, shape[:, k]).round(7) for k in range(2))
    known = places.on(way, lon, lat)
    if known is None:
        return
    run = along[-1] / count
    steps.true += [(100 * rise / run,) for rise in np.diff(known[1]).tolist()]
    steps.facts += [facts] * count
    steps.runs_m += [run] * count
    ends = np.column_stack([lon[:-1], lat[:-1], lon[1:], lat[1:]])
    steps.places += ends.reshape(-1, 2).tolist()


def _ask_heights(valhalla: Valhalla, steps: Collected) -> None:
    """The grades that ``/height`` has between pairs of places."""
    for name, kept in zip(("before", "after"), steps.found, strict=True):
        heights: list[float] = []
        for first in range(0, len(steps.places), PLACES_AT_ONCE):
            part = steps.places[first : first + PLACES_AT_ONCE]
            asked = {"shape": [{"lat": lat, "lon": lon} for lon, lat in part], "height_precision": 2}
            heights += valhalla.ask(f"tiles-{name}", "height", asked)["height"]
        rise = np.diff(np.array(heights, float).reshape(-1, 2), axis=1)[:, 0]
        kept += [(grade,) for grade in (100 * rise / np.array(steps.runs_m)).tolist()]


if __name__ == "__main__":
    main()
