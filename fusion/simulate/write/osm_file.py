"""The town's map as OpenStreetMap XML."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from fusion.simulate.scene.plan import BRIDGE, TUNNEL
from fusion.simulate.scene.segments import FIRST_WAY_ID, Way, layer_of
from fusion.simulate.scene.town import Town

_STAMP = 'version="1" timestamp="2024-05-01T00:00:00Z"'
_FIRST_OTHER_WAY = FIRST_WAY_ID + 5_000_000
_FIRST_OTHER_NODE = 9_200_000_001
_BUILDINGS = 60
_SPEED_LIMIT = {"motorway": "110", "primary": "70", "residential": "30", "living_street": "walk"}


def write_osm(town: Town, path: Path) -> None:
    """Write nodes, drivable ways, and what a reader of roads must pass over: footways, buildings, a route."""
    lon, lat = town.node_lon_deg, town.node_lat_deg
    buildings = _buildings(town)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<osm version="0.6" generator="versant simulate">',
        f'  <bounds minlat="{lat.min():.7f}" minlon="{lon.min():.7f}" '
        f'maxlat="{lat.max():.7f}" maxlon="{lon.max():.7f}"/>',
    ]
    lines += [_node(int(i), u, v) for i, u, v in zip(town.node_id, lon, lat, strict=True)]
    corner_id = _FIRST_OTHER_NODE + np.arange(4 * len(buildings)).reshape(-1, 4)
    for ids, corners in zip(corner_id, buildings, strict=True):
        lines += [_node(int(i), u, v) for i, (u, v) in zip(ids, corners, strict=True)]
    for way in town.ways:
        lines += _way(way.way_id, [int(i) for i in town.node_id[list(way.nodes)]], road_tags(way))
    for k, ends in enumerate(town.footways):
        tags = {"highway": "footway", "bicycle": "no"}
        lines += _way(_FIRST_OTHER_WAY + k, [int(i) for i in town.node_id[list(ends)]], tags)
    for k, ids in enumerate(corner_id):
        nodes = [int(i) for i in (*ids, ids[0])]
        lines += _way(_FIRST_OTHER_WAY + 1000 + k, nodes, {"building": "yes"})
    lines += _relation(town)
    Path(path).write_text("\n".join([*lines, "</osm>", ""]), encoding="utf-8")


def road_tags(way: Way) -> dict[str, str]:
    """The tags of a road; an implied ``oneway`` (motorways, roundabouts) is left out at times."""
    kind = way.kind
    tags = {"highway": kind.highway}
    if way.name is not None:
        tags["name"] = way.name
    if kind.junction:
        tags["junction"] = kind.junction
    implied = bool(kind.junction) or (kind.highway == "motorway" and way.way_id % 2 == 0)
    if kind.oneway and not implied:
        tags["oneway"] = "yes" if kind.oneway > 0 else "-1"
    if kind.structure in (BRIDGE, TUNNEL):
        tags["bridge" if kind.structure == BRIDGE else "tunnel"] = "yes"
        tags["layer"] = str(layer_of(kind))
    if kind.highway in _SPEED_LIMIT:
        tags["maxspeed"] = _SPEED_LIMIT[kind.highway]
    return tags


def _node(node_id: int, lon: float, lat: float) -> str:
    return f'  <node id="{node_id}" lat="{lat:.7f}" lon="{lon:.7f}" {_STAMP}/>'


def _way(way_id: int, nodes: list[int], tags: dict[str, str]) -> list[str]:
    lines = [f'  <way id="{way_id}" {_STAMP}>']
    lines += [f'    <nd ref="{n}"/>' for n in nodes]
    lines += [f"    <tag k={quoteattr(k)} v={quoteattr(v)}/>" for k, v in tags.items()]
    return [*lines, "  </way>"]


def _relation(town: Town) -> list[str]:
    member = next((w.way_id for w in town.ways if w.name == "High Street"), town.ways[0].way_id)
    return [
        f'  <relation id="700001" {_STAMP}>',
        f'    <member type="way" ref="{member}" role=""/>',
        '    <tag k="type" v="route"/>',
        '    <tag k="route" v="bus"/>',
        "  </relation>",
    ]


def _buildings(town: Town) -> list[list[tuple[float, float]]]:
    """Corners (lon, lat) of square houses, scattered over the town."""
    rng = np.random.default_rng([town.seed, 4])
    centre = rng.uniform(-800.0, 800.0, (_BUILDINGS, 2))
    half = rng.uniform(5.0, 10.0, _BUILDINGS)[:, None]
    x = centre[:, :1] + half * np.array([[-1.0, 1.0, 1.0, -1.0]])
    y = centre[:, 1:] + half * np.array([[-1.0, -1.0, 1.0, 1.0]])
    lon, lat = town.projection.to_lonlat(x, y)
    return [list(zip(u.tolist(), v.tolist(), strict=True)) for u, v in zip(lon, lat, strict=True)]
