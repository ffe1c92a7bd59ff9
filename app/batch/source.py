"""What files are made of where there is no database: the segments of a solution, the file of roads, the rasters."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np

from app.exports.writing.solved import segments_of
from app.map.segment import Segment
from fusion.results import Solution
from fusion.terrain.dem import Dem
from fusion.types import Floats

Bounds = tuple[float, float, float, float]


@dataclass(eq=False)
class SolvedSource:
    """As ``app.exports.source.Source``, but of ways, which only a database has; every segment has a slope."""

    solution: Solution
    newest: datetime
    """What was measured is as new as that."""
    road_files: Sequence[Path]
    terrain: Callable[[], Dem | None]
    """The rasters, wherever it is called: a source can be sent to another process"""
    bbox: None = None
    notes: list[str] = field(default_factory=list)

    def note(self, text: str) -> None:
        """Tell a person something about what is written, as one sentence."""
        self.notes.append(text)

    def on_progress(self, share: float) -> None:
        """Nobody waits for a share of one file."""

    def asked_segments(self) -> Iterator[Segment]:
        """All of them."""
        return segments_of(self.solution, self.newest)

    def segments(self, *, gaps: bool = False, driven: bool = False) -> Iterator[Segment]:
        """Those of them that are asked for."""
        return (one for one in self.asked_segments() if one.drives or (gaps and not driven))

    def tiles(
        self, zooms: tuple[int, int], number: Callable[[int, int, int], int]
    ) -> Iterator[tuple[tuple[int, int, int], bytes]]:
        """The vector tiles of those of these zooms that show single segments."""
        from app.exports.writing.vector_tiles import tiles_of  # noqa: PLC0415 - with it the map's statements are loaded
        from app.map.store import FULL_ZOOM  # noqa: PLC0415 - as above

        return tiles_of(list(self.asked_segments()), (max(zooms[0], FULL_ZOOM), zooms[1]), number)

    def extent(self) -> Bounds:
        """The box of all segments, degrees."""
        return self.solution.roads.bounds_deg() if len(self.solution) else (0.0, 0.0, 0.0, 0.0)

    @contextmanager
    def ground(self) -> Iterator[Dem | None]:
        """The rasters as one model; None without any."""
        yield self.terrain()

    def ground_heights(self, lon_deg: Floats, lat_deg: Floats) -> Floats:
        """Of the ground by the rasters, m; NaN unknown; shapes (n,)."""
        dem = self.terrain()
        return np.full(len(lon_deg), np.nan) if dem is None else dem.heights(lon_deg, lat_deg)

    def ground_datum(self) -> str | None:
        """What these refer to."""
        dem = self.terrain()
        return None if dem is None else dem.datum
