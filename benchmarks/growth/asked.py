"""What is asked of a service in each round, and how long it takes."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from functools import partial

import httpx
import numpy as np
from sqlalchemy import text

from app.core.db import Bounds, Sessions
from app.map.tiles.store import column_of, row_of
from app.network.cells import raise_versions
from app.ops.admin.queries import QUERIES
from served.million import NUMBERS

ZOOMS = (14, 12, 8)
TILES = 15
PAGES = 11
_WAIT_S = 0.02

_BOX = text("""
    SELECT min(ST_XMin(geom)), min(ST_YMin(geom)), max(ST_XMax(geom)), max(ST_YMax(geom))
    FROM segments WHERE osm_way_id < :numbers
""")
_CELLS_IN = text("SELECT DISTINCT cell FROM segments WHERE geom && ST_MakeEnvelope(:w, :s, :e, :n, 4326)")


def box_of(sessions: Sessions) -> Bounds:
    """Where the original roads are, degrees."""
    with sessions() as session:
        west, south, east, north = session.execute(_BOX, {"numbers": NUMBERS}).one()
    return west, south, east, north


class Asked:
    """A client of one service, which knows where the original roads are."""

    def __init__(self, client: httpx.Client, sessions: Sessions, box: Bounds) -> None:
        self._client, self._sessions, self._box = client, sessions, box

    def reads(self) -> dict[str, Callable[[], float]]:
        """What is read, by the name of the figure: each call returns the median of some reads, ms."""
        boxes = {
            "items in a box, ms": {"bbox": ",".join(map(str, self._middle()))},
            "items, steepest, ms": {"sortby": "-steepness_percent"},
        }
        return {
            **{f"tile {zoom}, ms": partial(self._tiles, zoom) for zoom in ZOOMS},
            **{
                name: partial(self._pages, "/collections/segments/items", {"limit": "1000", **more})
                for name, more in boxes.items()
            },
            **{f"query {name}, ms": partial(self._pages, f"/v1/admin/{name}", {}) for name in QUERIES},
        }

    def newest_drives(self, count: int) -> list[str]:
        """The addresses of those that were uploaded last."""
        found = self._client.get("/v1/drives", params={"limit": count}).raise_for_status().json()
        return [f"/v1/drives/{drive['id']}" for drive in found["drives"]]

    def removed(self, address: str) -> float:
        """Seconds from the request until nothing is left of the drive."""
        began_s = time.monotonic()
        self._client.delete(address).raise_for_status()
        number = address.rsplit("/", 1)[1]
        gone = text("SELECT NOT EXISTS (SELECT FROM drives WHERE id = CAST(:id AS uuid))")
        while True:
            with self._sessions() as session:
                if session.execute(gone, {"id": number}).scalar_one():
                    return time.monotonic() - began_s
            time.sleep(_WAIT_S)

    def _middle(self) -> Bounds:
        west, south, east, north = self._box
        return (
            west + 0.4 * (east - west), south + 0.4 * (north - south),
            west + 0.6 * (east - west), south + 0.6 * (north - south),
        )  # fmt: skip

    def _tiles(self, zoom: int) -> float:
        w, s, e, n = self._box
        with self._sessions.begin() as session:
            cells = session.execute(_CELLS_IN, {"w": w, "s": s, "e": e, "n": n}).scalars().all()
            raise_versions(session, cells)
        return statistics.median(
            _ms(lambda: self._client.get(f"/tiles/{zoom}/{x}/{y}.mvt").raise_for_status())  # noqa: B023
            for x, y in self._places(zoom)
        )

    def _places(self, zoom: int) -> Iterator[tuple[int, int]]:
        west, south, east, north = self._box
        rng = np.random.default_rng(zoom)
        for _ in range(TILES):
            lon, lat = rng.uniform(west, east), rng.uniform(south, north)
            yield column_of(zoom, lon), row_of(zoom, lat)

    def _pages(self, path: str, parameters: dict[str, str]) -> float:
        return statistics.median(
            _ms(lambda: self._client.get(path, params=parameters).raise_for_status()) for _ in range(PAGES)
        )


def _ms(work: Callable[[], object]) -> float:
    began_s = time.perf_counter()
    work()
    return 1e3 * (time.perf_counter() - began_s)
