"""What a file is made of: segments, ways and tiles of one moment, as far as an export asks for them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Bounds
from app.core.messages import say
from app.core.settings.places import FilePlace
from app.map.segment import Segment, Way
from app.map.store import (
    FULL_ZOOM,
    PAGE,
    all_segments,
    corners,
    count_segments,
    in_box_sql,
    segments_of_ways,
    way_ids,
)
from app.map.tiles.store import mvt
from app.network import ZOOM
from app.network.cells import cell_bounds
from app.roads.region_files import kept_file
from app.roads.store import Region, all_regions
from app.terrain.store import current_dem
from fusion.errors import RoadsError
from fusion.types import Floats, Ints

if TYPE_CHECKING:
    from fusion.terrain.dem import Dem

PARTS_APART = 1000
"""Records after which it is looked how far an export is, and whether it is to go on."""

Tile = tuple[int, int, int]
"""Zoom, column, row."""
OnProgress = Callable[[float], None]
"""Takes the share of the work done, 0..1, and raises to end it."""

_WAYS = """
    SELECT {columns}, ST_AsBinary(w.geom) AS line FROM ways AS w
    WHERE w.id > :after_id AND {driven} AND {in_box} AND {in_region} ORDER BY w.id LIMIT :limit
"""
_IN_REGION = """
    EXISTS (SELECT FROM segments AS s WHERE s.id = w.id AND s.regions @> ARRAY[CAST(:region AS smallint)])
"""

# Cells in which anything was ever shown. A tile that turns out to be empty is left out.
_CELLS = text("SELECT id FROM cells WHERE version > 0 ORDER BY id")
_EXTENT = text(
    "SELECT ST_XMin(e), ST_YMin(e), ST_XMax(e), ST_YMax(e) FROM (SELECT ST_Extent(geom) AS e FROM segments) AS x"
)


@dataclass(frozen=True)
class Query:
    """Which part of the map is asked for."""

    bbox: Bounds | None = None
    """West > east: across the antimeridian."""
    region: Region | None = None
    driven: bool = False
    gaps: bool = False
    most_sigma_percent: float | None = None
    """The largest sigma of a slope; None: any, and unknown ones as well."""
    least_drives: int = 0

    def passes(self, record: Segment | Way) -> bool:
        """Whether it is as sure as is asked for."""
        sigma = record.slope_sigma_percent
        sure = self.most_sigma_percent is None or (sigma is not None and sigma <= self.most_sigma_percent)
        return sure and record.drives >= self.least_drives


@dataclass(eq=False)
class Source:
    """The data of a snapshot, for as long as it lasts. Every iterator is consumed once and holds a page at a time."""

    session: Session
    """Its transaction is the snapshot (``app.core.db.snapshot``)."""
    place: FilePlace
    """Where rasters and files of roads are kept (``Settings.dem_dir``)."""
    query: Query
    on_progress: OnProgress = lambda share: None
    full_zoom: int = field(default=FULL_ZOOM, kw_only=True)
    """From which zoom on tiles hold every road (``Settings``)."""
    notes: list[str] = field(default_factory=list, init=False)
    """What a person is told about the file, in order."""

    @property
    def bbox(self) -> Bounds | None:
        """The box that is asked for."""
        return self.query.bbox

    def note(self, text: str) -> None:
        """Tell a person something about what is written, as one sentence."""
        self.notes.append(text)

    def asked_segments(self) -> Iterator[Segment]:
        """The segments that are asked for, by ascending id."""
        return filter(self.query.passes, self.segments(gaps=self.query.gaps, driven=self.query.driven))

    def segments(self, *, gaps: bool = False, driven: bool = False) -> Iterator[Segment]:
        """Those of the box and the region, by ascending id, for a format that knows itself which others it wants."""
        box, region = self.query.bbox, self.query.region
        count = count_segments(self.session, bbox=box, driven=driven or None)
        count = max(1, count if region is None else min(count, region.segments))  # at most so many
        region_id = None if region is None else region.id
        rows = all_segments(self.session, box, driven=driven or None, gaps=gaps, region=region_id)
        for number, row in enumerate(rows):
            if not number % PARTS_APART:
                self.on_progress(min(number / count, 1.0))
            yield row

    def whole_ways(self, osm_way_ids: Sequence[int]) -> list[Segment]:
        """All segments of these OpenStreetMap ways, whether they are asked for or not, by ascending id."""
        return segments_of_ways(self.session, osm_way_ids)

    def osm_way_ids(self) -> Ints:
        """Of all segments there are, ascending."""
        return way_ids(self.session)

    def asked_ways(self) -> Iterator[Way]:
        """The ways that are asked for, by ascending id; driven: any of them is measured."""
        asked = self.query
        query = text(
            _WAYS.format(
                columns=", ".join(f"{column.sql} AS {name}" for name, column in Way.columns.items()),
                driven="w.drives > 0" if asked.driven else "true",
                in_box=in_box_sql("w.geom", asked.bbox),
                in_region="true" if asked.region is None else _IN_REGION,
            )
        )
        region = None if asked.region is None else asked.region.id
        values: dict[str, Any] = {"after_id": 0, "limit": PAGE, "region": region, **corners(asked.bbox)}
        while rows := self.session.execute(query, values).all():
            yield from filter(asked.passes, map(_way, rows))
            values["after_id"] = rows[-1].id
            self.on_progress(0.0)

    def tiles(
        self, zooms: tuple[int, int], number: Callable[[int, int, int], int]
    ) -> Iterator[tuple[Tile, bytes]]:
        """The vector tiles of these zooms that hold anything, as the service shows them; in each by their numbers."""
        addresses = [
            (z, *place)
            for z in range(zooms[0], zooms[1] + 1)
            for place in sorted(self._places(z), key=lambda place, z=z: number(z, *place))  # type: ignore[misc]
        ]
        for done, (z, x, y) in enumerate(addresses):
            self.on_progress(done / len(addresses))
            if data := mvt(self.session, z, x, y, full_zoom=self.full_zoom):
                yield (z, x, y), data

    def extent(self) -> Bounds:
        """The box that is asked for, or that of all segments; degrees."""
        if self.bbox is not None:
            return self.bbox
        west, south, east, north = self.session.execute(_EXTENT).one()
        return (0.0, 0.0, 0.0, 0.0) if west is None else (west, south, east, north)

    @cached_property
    def road_files(self) -> Sequence[Path]:
        """The ways with a ``highway`` and their nodes, with all tags, as each region's last import kept them (PBF).

        That of the newest import in front, for a way may be in several. ``RoadsError`` where a file is missing.
        """
        regions = all_regions(self.session)
        if not regions:
            raise RoadsError(say("export.no_roads"))
        newest_first = sorted(regions, key=lambda region: (region.imported_at, region.id), reverse=True)
        return tuple(kept_file(self.place, region) for region in newest_first)

    @contextmanager
    def ground(self) -> Iterator[Dem | None]:
        """The active elevation rasters as one model, for as long as they are open; None without any."""
        from app.terrain.heights import open_dem  # noqa: PLC0415 - with it compilers and rasterio are loaded

        active = current_dem(self.session, self.place)
        if active is None:
            yield None
            return
        with open_dem(active) as dem:
            yield dem

    def ground_heights(self, lon_deg: Floats, lat_deg: Floats) -> Floats:
        """Of the ground by the active elevation rasters, m, above their own datum; NaN unknown; shapes (n,)."""
        if not len(lon_deg):
            return np.full(0, np.nan)
        with self.ground() as dem:
            return np.full(len(lon_deg), np.nan) if dem is None else dem.heights(lon_deg, lat_deg)

    def ground_datum(self) -> str | None:
        """What these refer to, as it was stated when the rasters were imported; None without any."""
        active = current_dem(self.session, self.place)
        return None if active is None else active.datum

    def _places(self, z: int) -> set[tuple[int, int]]:
        """Columns and rows of the tiles of a zoom, at most that of cells, in which there may be something."""
        cells = self.session.execute(_CELLS).scalars()
        shift = ZOOM - z
        return {
            (cell >> ZOOM >> shift, (cell & (1 << ZOOM) - 1) >> shift)
            for cell in cells
            if self.bbox is None or _meet(cell_bounds(cell), self.bbox)
        }


def parts_of(bbox: Bounds) -> list[Bounds]:
    """The box in parts that do not cross the antimeridian."""
    west, south, east, north = bbox
    return [bbox] if west <= east else [(west, south, 180.0, north), (-180.0, south, east, north)]


def _meet(one: Bounds, other: Bounds) -> bool:
    west, south, east, north = one
    return any(west <= e and w <= east and south <= n and s <= north for w, s, e, n in parts_of(other))


def _way(row: Any) -> Way:
    line = shapely.get_coordinates(shapely.from_wkb(bytes(row.line)))
    properties = dict(zip(Way.columns, row, strict=False))
    return Way(**properties, coordinates=tuple((float(lon), float(lat)) for lon, lat in line))
