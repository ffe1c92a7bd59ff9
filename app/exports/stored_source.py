"""The stored map as handovers read it: one snapshot of the database, and the files of roads and rasters beside it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
from sqlalchemy.orm import Session

from app.core.db import Bounds
from app.core.settings.places import FilePlace
from app.map.pages import PAGE, all_segments
from app.map.segment import Segment
from app.map.store import segments_by_way
from app.roads.region_files import kept_file
from app.roads.regions import all_regions
from app.terrain.store import current_dem
from fusion.errors import RoadsError
from fusion.types import Floats


class StoredSource:
    """The map in a database; ``place`` is where rasters and files of roads are kept (``Settings.dem_dir``).

    The session's transaction is the snapshot: it should be of isolation level REPEATABLE READ. ``notes`` are what was
    told, in order.
    """

    def __init__(self, session: Session, place: FilePlace, bbox: Bounds | None = None) -> None:
        self.session, self.bbox, self._place = session, bbox, place
        self.notes: list[str] = []

    def segments(self, *, gaps: bool = False, driven: bool = False) -> Iterator[Segment]:
        """As ``Source`` says."""
        return all_segments(self.session, self.bbox, driven=driven, gaps=gaps)

    def in_way_order(self, *, gaps: bool = False, driven: bool = False) -> Iterator[list[Segment]]:
        """As ``Source`` says; a way at a time is held."""
        way: list[Segment] = []
        for segment in self._by_way(gaps, driven):
            if way and way[0].osm_way_id != segment.osm_way_id:
                yield from chains(way)
                way = []
            way.append(segment)
        yield from chains(way)

    def road_files(self) -> Sequence[Path]:
        """As ``Source`` says."""
        return self._road_files

    def ground_heights(self, lon_deg: Floats, lat_deg: Floats) -> Floats:
        """As ``Source`` says; all unknown without rasters."""
        from app.terrain.heights import open_dem  # noqa: PLC0415 - with it compilers and rasterio are loaded

        active = current_dem(self.session, self._place)
        if active is None or not len(lon_deg):
            return np.full(len(lon_deg), np.nan)
        with open_dem(active) as dem:
            return dem.heights(lon_deg, lat_deg)

    def ground_datum(self) -> str | None:
        """As ``Source`` says."""
        active = current_dem(self.session, self._place)
        return None if active is None else active.datum

    def note(self, text: str) -> None:
        """Keep what a person is to be told."""
        self.notes.append(text)

    @cached_property
    def _road_files(self) -> tuple[Path, ...]:
        regions = all_regions(self.session)
        if not regions:
            raise RoadsError("There are no roads yet. Import a file of roads first.")
        newest_first = sorted(regions, key=lambda region: (region.imported_at, region.id), reverse=True)
        return tuple(kept_file(self._place, region) for region in newest_first)

    def _by_way(self, gaps: bool, driven: bool) -> Iterator[Segment]:
        after = (-(2**63), 0, 0)
        wanted = True if driven else None
        while rows := segments_by_way(
            self.session, bbox=self.bbox, after=after, limit=PAGE, driven=wanted, gaps=gaps
        ):
            yield from rows
            after = (rows[-1].osm_way_id, rows[-1].from_node, rows[-1].to_node)


def chains(way: Iterable[Segment]) -> Iterator[list[Segment]]:
    """Segments of one way as chains, each from node to node; by the smallest id in front of a ring.

    A chain ends at a node that the way passes more than once, since nothing says how it goes on there.
    """
    segments = sorted(way, key=lambda s: (s.from_node, s.to_node))
    leaving: dict[int, list[Segment]] = {}
    entering: dict[int, int] = {}
    for segment in segments:
        leaving.setdefault(segment.from_node, []).append(segment)
        entering[segment.to_node] = entering.get(segment.to_node, 0) + 1
    through = {node for node, out in leaving.items() if len(out) == 1 and entering.get(node) == 1}
    left = {id(segment) for segment in segments}
    starts = [segment for segment in segments if segment.from_node not in through]
    for start in (*starts, *sorted(segments, key=lambda s: s.id or 0)):  # what is left then are rings
        if id(start) not in left:
            continue
        chain = [start]
        left.discard(id(start))
        while chain[-1].to_node in through and id(following := leaving[chain[-1].to_node][0]) in left:
            chain.append(following)
            left.discard(id(following))
        yield chain
