"""What a loaded lorry takes in SUMO, by the heights of an elevation model, and by measured ones.

    PYTHONPATH=.:benchmarks python -m routers.sumo MAP.osm.pbf --programs DIR [--relief HGT] [--drives 60]
        [--minutes 15] [--trips 300] [--seeds 1 2 3] [--keep DIR] [--json FILE]

MAP is Heidelberg's extract (or any that holds ``routers.made.WINDOW``); DIR is SUMO's folder, with ``bin/netconvert``
and ``bin/sumo`` in it (``SUMO_HOME`` by default). Roads, made heights, drives and their solution are those of
``routers.valhalla``. netconvert builds one network of the roads, which gets heights in four ways:

    elevation model   ``--heightmap.geotiff``: the erring model, which knows no bridge, bank or cutting
    osm-ele           ``--osm.elevation`` of the file with ``ele`` that is exported
    sumo              the export ``sumo`` of the network
    truth             the true heights, put in as the last way does

Lorries of 40 t with electric drive (SUMO's own model ``Energy``) make the same trips in each, none in another's way.
Printed: energy of trips, of those over bridges, and on the edges of bridges alone, in kWh by truth, and the RMS of
errors as a share of the mean; medians of scenes.

Aim: the error is halved.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

import defusedxml.ElementTree
import numpy as np
import osmium
import rasterio
from affine import Affine

from accuracy.arguments import parser_of
from accuracy.scoring import rms, show_progress, text_table, write_json
from app.batch.outputs import SolvedSource
from app.cli.logs.fusing import Fusion
from app.exports.formats import FORMATS
from app.exports.source import Source
from app.exports.writing.road_courses import Course, Courses
from app.exports.writing.sumo_net import add_heights, read_net, write_net
from fusion.pipeline import parse_options
from fusion.registry import DEFAULT_METHOD
from fusion.roads.osm import read_roads
from fusion.simulate.demonstration import demo_drives
from fusion.terrain.corrected.files import HGT_VOID
from fusion.terrain.dem import Dem
from routers.made import WINDOW, Scene, make_scene
from routers.samplers import HgtTile

APART_S = 200
"""Between departures: lorries never meet on most roads."""
COLUMNS = {"heights": ("heights", ""), "what": ("what", ""), "n": ("n", "d"), "mean_kwh": ("kWh", ".3f"),
           "error": ("error", ".1%"), "bias": ("bias", "+.1%")}  # fmt: skip
LORRY = """<vType id="lorry" vClass="truck" emissionClass="Energy/unknown" mass="40000" length="16.5" accel="0.7"
 decel="2" maxSpeed="22.2" sigma="0"><param key="frontSurfaceArea" value="9"/><param key="airDragCoefficient"
 value="0.6"/><param key="rollDragCoefficient" value="0.006"/><param key="constantPowerIntake" value="4000"/>
 <param key="propulsionEfficiency" value="0.86"/><param key="recuperationEfficiency" value="0.7"/>
 <param key="radialDragCoefficient" value="0"/></vType>"""


def main() -> None:
    """Run it."""
    asked = _arguments()
    if not (asked.programs / "bin" / "sumo").is_file():
        raise SystemExit("--programs DIR has to name a folder with bin/netconvert and bin/sumo in it.")
    roads, scenes = read_roads(asked.map), []
    for seed in asked.seeds:
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch if asked.keep is None else asked.keep / str(seed))
            folder.mkdir(parents=True, exist_ok=True)
            scenes.append(_one_scene(make_scene(roads, WINDOW, asked.relief, seed), folder, asked, seed))
    rows = [
        {"heights": same[0]["heights"], "what": same[0]["what"], "n": round(np.median([row["n"] for row in same])),
         **{name: float(np.median([row[name] for row in same])) for name in ("mean_kwh", "error", "bias")}}
        for same in zip(*scenes, strict=True)
    ]  # fmt: skip
    print(text_table(rows, COLUMNS))
    write_json(asked.json, {"rows": rows, "scenes": scenes})


def _arguments() -> argparse.Namespace:
    parser = parser_of(__doc__)
    parser.add_argument("map", type=Path)
    parser.add_argument("--programs", type=Path, default=Path(os.environ.get("SUMO_HOME", ".")))
    for name in ("--relief", "--keep"):
        parser.add_argument(name, type=Path)
    for name, usual in (("--drives", 60), ("--minutes", 15), ("--trips", 300)):
        parser.add_argument(name, type=int, default=usual)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    return parser.parse_args()


def _one_scene(scene: Scene, folder: Path, asked: argparse.Namespace, seed: int) -> list[dict[str, Any]]:
    def run(program: str, *told: object) -> None:
        command = [str(asked.programs / "bin" / program), *map(str, told)]
        env = {**os.environ, "SUMO_HOME": str(asked.programs)}
        done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"{program} failed: {done.stderr[-500:]}")

    tile = scene.write_tile(folder / "before", seed)
    _write_roads(scene, asked.map, folder / "roads.osm")
    show_progress("networks")
    run("netconvert", "--osm-files", "roads.osm", "--proj.utm", "--no-warnings", "-o", "flat.net.xml")
    nets = {name: folder / f"{name}.net.xml" for name in ("truth", "elevation model", "osm-ele", "sumo")}
    _write_geotiff(tile, folder / "model.tif")
    run("netconvert", "-s", "flat.net.xml", "--heightmap.geotiff", "model.tif", "-o", nets["elevation model"])
    root = read_net(folder / "flat.net.xml")
    add_heights(root, _true_courses(scene))
    write_net(root, nets["truth"])
    _export(scene, tile, folder, asked, seed)
    run("netconvert", "--osm-files", "ele.osm", "--osm.elevation", "--proj.utm", "--no-warnings",
        "-o", nets["osm-ele"])  # fmt: skip
    _write_trips(folder, asked.trips, seed)
    found = {}
    for name, net in nets.items():
        show_progress(f"lorries over {name}")
        run("sumo", "-n", net, "-r", "trips.xml", "-a", "edges.xml", "--tripinfo-output", "trips.out.xml",
            "--vehroute-output", "routes.out.xml", "--vehroute-output.exit-times", "false", "--no-step-log",
            "--no-warnings", "--ignore-route-errors", "--device.emissions.probability", "1")  # fmt: skip
        found[name] = _energies(folder)
    return _rows(scene, folder, found)


def _write_roads(scene: Scene, source: Path, path: Path) -> None:
    """The scene's ways and their nodes, as OSM XML, which netconvert reads."""
    ways = set(scene.town.roads.osm_way_id.tolist())
    nodes = {
        node.ref
        for way in osmium.FileProcessor(str(source), osmium.osm.WAY)
        if way.id in ways
        for node in cast(Any, way).nodes
    }
    with osmium.SimpleWriter(osmium.io.File(str(path), "osm"), overwrite=True) as writer:
        for one in osmium.FileProcessor(str(source), osmium.osm.NODE | osmium.osm.WAY):
            if one.id in (nodes if cast(Any, one).is_node() else ways):
                writer.add(one)


def _write_geotiff(tile: Path, path: Path) -> None:
    """What of a tile holds heights, for netconvert."""
    z = HgtTile(tile).z
    rows, columns = np.flatnonzero((z != HGT_VOID).any(axis=1)), np.flatnonzero((z != HGT_VOID).any(axis=0))
    west = float(tile.stem[4:]) + (columns[0] - 0.5) / 3600
    north = float(tile.stem[1:3]) + 1 - (rows[0] - 0.5) / 3600
    part = z[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].astype(np.int16)
    place = Affine(1 / 3600, 0, west, 0, -1 / 3600, north)
    with rasterio.open(path, "w", driver="GTiff", height=part.shape[0], width=part.shape[1], count=1, dtype="int16",
                       crs="EPSG:4326", transform=place) as file:  # fmt: skip
        file.write(part, 1)


def _true_courses(scene: Scene) -> Courses:
    """Each segment with the true heights of its ends."""
    town = scene.town
    ends = zip(town.roads.osm_way_id.tolist(), town.start.tolist(), town.end.tolist(), strict=True)
    courses = [
        Course(way, part, np.array([a, b]), {"highway": "road"}) for part, (way, a, b) in enumerate(ends)
    ]
    known = np.ones(len(town.node_id), bool)
    return Courses(courses, town.node_id, town.node_lon_deg, town.node_lat_deg, town.node_height_m, known)


def _export(scene: Scene, tile: Path, folder: Path, asked: argparse.Namespace, seed: int) -> None:
    """Drive and solve; the file with ele, and the network with heights."""
    with Dem.open([tile]) as dem:
        fusion = Fusion(DEFAULT_METHOD, parse_options(DEFAULT_METHOD), scene.roads, dem)
        drives = demo_drives(scene.town, asked.drives, seed, duration_s=60.0 * asked.minutes)
        for number, named in enumerate(drives):
            show_progress(f"drive {number + 1} of {asked.drives}")
            fusion.add(named.write(folder))
        source = SolvedSource(fusion.solve().solution, datetime.now(UTC), [folder / "roads.osm"], lambda: dem)
        own = {"net": str(folder / "flat.net.xml")}
        for name, file, options in (("osm-ele", "ele.osm", {}), ("sumo", "sumo.net.xml", own)):
            form = FORMATS[name]
            chosen = form.parse_options(options, local=True)
            form.write(cast(Source, source), folder / file, {"attribution": ""}, chosen)


def _root(path: Path) -> Any:
    return defusedxml.ElementTree.parse(path).getroot()


def _write_trips(folder: Path, count: int, seed: int) -> None:
    """Trips between random edges; ``edges.xml`` asks for what is taken on each edge."""
    root = _root(folder / "flat.net.xml")
    edges = [one.attrib["id"] for one in root.findall("edge") if one.get("function") is None]
    rng = np.random.default_rng([seed, 74])
    trips = "".join(
        f'<trip id="{n}" type="lorry" depart="{n * APART_S}" from="{edges[a]}" to="{edges[b]}"/>\n'
        for n, (a, b) in enumerate(rng.integers(len(edges), size=(count, 2)).tolist())
    )
    (folder / "trips.xml").write_text(f"<routes>{LORRY}\n{trips}</routes>")
    (folder / "edges.xml").write_text(
        '<additional><edgeData id="e" type="emissions" file="edges.out.xml" excludeEmpty="true"/></additional>'
    )


Energies = tuple[dict[str, float], dict[str, float]]
"""kWh of trips and of edges, by their ids."""


def _energies(folder: Path) -> Energies:
    trips = {
        trip.attrib["id"]: float(trip.find("emissions").attrib["electricity_abs"]) / 1000
        for trip in _root(folder / "trips.out.xml").findall("tripinfo")
    }
    edges = {
        edge.attrib["id"]: float(edge.attrib["electricity_abs"]) / 1000
        for edge in _root(folder / "edges.out.xml").iter("edge")
    }
    return trips, edges


def _rows(scene: Scene, folder: Path, found: Mapping[str, Energies]) -> list[dict[str, Any]]:
    decks = {int(way) for way in scene.town.roads.osm_way_id[scene.town.roads.bridge]}

    def on_deck(edge: str) -> bool:
        return int(edge.lstrip("-").split("#")[0]) in decks

    routes = {
        one.attrib["id"]: one.find("route").attrib["edges"].split()
        for one in _root(folder / "routes.out.xml").findall("vehicle")
    }
    trips = sorted(set.intersection(*(set(one[0]) for one in found.values())))
    edges = sorted(set.intersection(*(set(one[1]) for one in found.values())))
    groups: list[tuple[str, int, Sequence[str]]] = [
        ("trips", 0, trips),
        ("trips over bridges", 0, [name for name in trips if any(map(on_deck, routes[name]))]),
        ("edges of bridges", 1, [name for name in edges if not name.startswith(":") and on_deck(name)]),
    ]
    rows = []
    for what, kind, names in groups:
        true = np.array([found["truth"][kind][name] for name in names])
        for heights in [name for name in found if name != "truth"]:
            off = np.array([found[heights][kind][name] for name in names]) - true
            error, bias = rms(off) / abs(true).mean(), float(off.mean() / abs(true).mean())
            rows.append({"heights": heights, "what": what, "n": len(names), "mean_kwh": float(true.mean()),
                         "error": error, "bias": bias})  # fmt: skip
    return rows


if __name__ == "__main__":
    main()
