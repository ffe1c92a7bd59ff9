"""What a file is made of: segments, ways and tiles of one moment, as far as an export asks for them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import shapely
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Bounds, Sessions
from app.core.settings.places import FilePlace
from app.exports.stored_source import StoredSource
from app.exports.writing.layers import WAY_COLUMNS, Way
from app.exports.writing.pmtiles_archive import Tile, tile_number
from app.map.pages import PAGE, all_segments
from app.map.segment import Segment
from app.map.store import count_segments
from app.map.tiles.store import mvt
from app.network.cells import ZOOM, square_bounds
from app.roads.regions import Region

PARTS_APART = 1000
"""Records after which it is looked how far an export is, and whether it is to go on."""

Told = Callable[[float], None]
"""Takes the share of the work done, 0..1, and raises to end it."""

_WAYS = """
    SELECT {columns}, ST_AsBinary(w.geom) AS line FROM ways AS w
    WHERE w.id > :after_id AND {driven} AND {in_box} AND {in_region} ORDER BY w.id LIMIT :limit
"""
_BOX = "ST_Intersects(w.geom, ST_MakeEnvelope({west}, :south, {east}, :north, 4326))"
_IN_REGION = """
    EXISTS (SELECT FROM segments AS s WHERE s.id = w.id AND s.regions @> ARRAY[CAST(:region AS smallint)])
"""

# Squares in which anything was ever shown. A tile that turns out to be empty is left out.
_SQUARES = text("SELECT id FROM cells WHERE version > 0 ORDER BY id")
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


def _nothing(share: float) -> None:
    """Nobody wants to know."""


class Source(StoredSource):
    """The data of a snapshot, for as long as it lasts. Every iterator is consumed once and holds a page at a time."""

    def __init__(
        self,
        session: Session,
        place: FilePlace,
        query: Query,
        told: Told = _nothing,
        *,
        full_zoom: int = 13,
    ) -> None:
        """``place``: of rasters; ``full_zoom``: from which zoom on tiles hold every road (``Settings``)."""
        super().__init__(session, place, query.bbox)
        self.query, self._told, self._full_zoom = query, told, full_zoom

    def asked_segments(self) -> Iterator[Segment]:
        """The segments that are asked for, by ascending id."""
        return self._counted(gaps=self.query.gaps, driven=self.query.driven)

    def segments(self, *, gaps: bool = False, driven: bool = False) -> Iterator[Segment]:
        """Those of the box and the region, for a form that knows itself which others it wants."""
        return self._counted(gaps=gaps, driven=driven)

    def ways(self) -> Iterator[Way]:
        """The ways that are asked for, by ascending id; driven: any of them is measured."""
        asked, after = self.query, 0
        query = text(
            _WAYS.format(
                columns=", ".join(f"{column.sql} AS {name}" for name, column in WAY_COLUMNS.items()),
                driven="w.drives > 0" if asked.driven else "true",
                in_box=_in_box(asked.bbox),
                in_region="true" if asked.region is None else _IN_REGION,
            )
        )
        box = (
            {}
            if asked.bbox is None
            else dict(zip(("west", "south", "east", "north"), asked.bbox, strict=True))
        )
        region = None if asked.region is None else asked.region.id
        while rows := self.session.execute(
            query, {"after_id": after, "limit": PAGE, "region": region, **box}
        ).all():
            yield from map(_way, rows)
            after = rows[-1].id
            self._told(0.0)

    def tiles(self, zooms: tuple[int, int]) -> Iterator[tuple[Tile, bytes]]:
        """The vector tiles of these zooms that hold anything, in the order of an archive, as the service shows them."""
        wanted = [
            (z, *place)
            for z in range(zooms[0], zooms[1] + 1)
            for place in sorted(self._places(z), key=lambda place, z=z: tile_number(z, *place))  # type: ignore[misc]
        ]
        for done, (z, x, y) in enumerate(wanted):
            self._told(done / len(wanted))
            if data := mvt(self.session, z, x, y, full_zoom=self._full_zoom):
                yield (z, x, y), data

    def extent(self) -> Bounds:
        """The box that is asked for, or that of all segments; degrees."""
        if self.bbox is not None:
            return self.bbox
        west, south, east, north = self.session.execute(_EXTENT).one()
        return (0.0, 0.0, 0.0, 0.0) if west is None else (west, south, east, north)

    def _places(self, z: int) -> set[tuple[int, int]]:
        """Columns and rows of the tiles of a zoom, at most that of squares, in which there may be something."""
        squares = self.session.execute(_SQUARES).scalars()
        shift = ZOOM - z
        return {
            (square >> ZOOM >> shift, (square & (1 << ZOOM) - 1) >> shift)
            for square in squares
            if self.bbox is None or _meet(square_bounds(square), self.bbox)
        }

    def _counted(self, *, gaps: bool, driven: bool) -> Iterator[Segment]:
        box, region = self.query.bbox, self.query.region
        count = count_segments(self.session, bbox=box, driven=True if driven else None)
        count = count if region is None else min(count, region.segments)  # at most so many
        only = None if region is None else region.id
        rows = all_segments(self.session, box, driven=driven, gaps=gaps, region=only)
        yield from self._looked_after(rows, max(count, 1))

    def _by_way(self, gaps: bool, driven: bool) -> Iterator[Segment]:
        yield from self._looked_after(super()._by_way(gaps, driven), None)

    def _looked_after(self, rows: Iterator[Segment], count: int | None) -> Iterator[Segment]:
        for done, row in enumerate(rows):
            if not done % PARTS_APART:
                self._told(0.0 if count is None else min(done / count, 1.0))
            yield row


@contextmanager
def snapshot(sessions: Sessions) -> Iterator[Session]:
    """A session that sees one moment and changes nothing: a drive that ends meanwhile is in it whole or not at all."""
    with sessions() as session:
        session.connection(
            execution_options={"isolation_level": "REPEATABLE READ", "postgresql_readonly": True}
        )
        yield session


def _in_box(bbox: Bounds | None) -> str:
    if bbox is None:
        return "true"
    if bbox[0] <= bbox[2]:
        return _BOX.format(west=":west", east=":east")
    return f"({_BOX.format(west=':west', east='180')} OR {_BOX.format(west='-180', east=':east')})"


def _meet(one: Bounds, other: Bounds) -> bool:
    (west, south, east, north), (w, s, e, n) = one, other
    if w > e:
        return _meet(one, (w, s, 180.0, n)) or _meet(one, (-180.0, s, e, n))
    return west <= e and w <= east and south <= n and s <= north


def _way(row: Any) -> Way:
    line = shapely.get_coordinates(shapely.from_wkb(bytes(row.line)))
    properties = dict(zip(WAY_COLUMNS, row, strict=False))
    return Way(**properties, coordinates=tuple((float(lon), float(lat)) for lon, lat in line))
