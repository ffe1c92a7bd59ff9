"""What a soak works with: short drives through the simulated town, its maps as they change, its elevations."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from accuracy.scoring import show_progress
from app.map.tiles.road_store import Place
from app.map.tiles.store import column_of, row_of
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.plan import GROUND
from fusion.simulate.scene.town import Town, make_town
from fusion.simulate.write.csv_file import write_csv
from fusion.simulate.write.dem_file import write_dem
from fusion.simulate.write.osm_file import write_osm

DURATION_S = (60.0, 120.0)
RECEIVERS = ("m8", "f9p")
"""Both state the accuracy of their heights: nothing that a drive says of itself depends on who drove before."""

TILE_ZOOM = 14
MOVED_NODES = 6
MOVED_DEG = 3e-5
"""Two or three metres: as when somebody draws a street anew."""


@dataclass(frozen=True)
class Material:
    """Logs, no two alike, and files."""

    logs: tuple[bytes, ...]
    maps: Mapping[str, Path]
    """The town as it is, with nodes that moved, and without a way."""
    dem: Path
    tiles: tuple[Place, ...] = ()
    """Those of single segments over the town."""

    @cached_property
    def log_of(self) -> dict[str, int]:
        """The number of a log by the SHA-256 of its bytes, hex."""
        return {hashlib.sha256(log).hexdigest(): k for k, log in enumerate(self.logs)}


def make_material(folder: Path, count: int, seed: int) -> Material:
    """So many logs, each of another time, and the files of the town in ``folder``."""
    town, rng = make_town(1), np.random.default_rng([seed, 1])
    logs = []
    for k in range(count):
        show_progress(f"log {k + 1} of {count}")
        duration_s = float(rng.uniform(*DURATION_S))
        drive = simulate_drive(town, 5000 * seed + k, duration_s, receiver=RECEIVERS[k % len(RECEIVERS)])
        write_csv(drive, folder / "log.csv")
        logs.append((folder / "log.csv").read_bytes())
    maps = {}
    for name, drawn in (
        ("as it is", town),
        ("moved", with_moved_nodes(town, rng)),
        ("less", without_way(town, rng)),
    ):
        maps[name] = folder / f"town {name}.osm"
        write_osm(drawn, maps[name])
    write_dem(town, folder / "dem.tif")
    return Material(tuple(logs), maps, folder / "dem.tif", _tiles_over(town))


def _tiles_over(town: Town) -> tuple[Place, ...]:
    columns = {column_of(TILE_ZOOM, lon) for lon in town.node_lon_deg.tolist()}
    rows = {row_of(TILE_ZOOM, lat) for lat in town.node_lat_deg.tolist()}
    return tuple(Place(TILE_ZOOM, x, y) for x in sorted(columns) for y in sorted(rows))


def with_moved_nodes(town: Town, rng: np.random.Generator) -> Town:
    """The town as somebody draws it who places a few nodes elsewhere."""
    lon, lat = town.node_lon_deg.copy(), town.node_lat_deg.copy()
    which = rng.choice(len(lon), MOVED_NODES, replace=False)
    lon[which] += rng.choice([-MOVED_DEG, MOVED_DEG], MOVED_NODES)
    lat[which] += rng.choice([-MOVED_DEG, MOVED_DEG], MOVED_NODES)
    return replace(town, node_lon_deg=lon, node_lat_deg=lat)


def without_way(town: Town, rng: np.random.Generator) -> Town:
    """The town without one of its streets."""
    streets = [
        k for k, w in enumerate(town.ways) if w.kind.highway == "residential" and w.kind.structure == GROUND
    ]
    street = int(rng.choice(streets))
    return replace(town, ways=tuple(way for k, way in enumerate(town.ways) if k != street))
