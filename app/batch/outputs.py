"""The files of a batch's slopes."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from app.batch.folder import BatchError, BatchFolder
from app.batch.hands import DEAD, Hands
from app.core.messages import say
from app.core.text import utc_text, whole_file
from app.exports.format import WAYS, Format, TableFormat, statements
from app.exports.formats import FORMATS, SEGMENT_FORMATS, write_companions
from app.exports.writing.solved import segments_of
from app.map.segment import Segment
from fusion.results import Solution
from fusion.terrain.dem import Dem
from fusion.types import Floats

if TYPE_CHECKING:
    from app.exports.source import Source

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


OF_DATABASE = ("opensidewalks", "overture")
"""Formats that name segments by the numbers that a database gives them; only one makes ways, too."""


def formats_of_segments() -> list[str]:
    """Names of the formats that can be written without a database."""
    return [name for name, one in FORMATS.items() if name not in OF_DATABASE and not _of_ways(one)]


def _of_ways(one: Format) -> bool:
    return isinstance(one, TableFormat) and one.layer is WAYS


def file_name(chosen: Format) -> str:
    """What a file of a format is called: others than tables of segments and tiles by the format as well."""
    usual = chosen.name in SEGMENT_FORMATS or chosen.suffixes[0] == f".{chosen.name}"
    return f"slopes{'' if usual else f'-{chosen.name}'}{chosen.suffixes[0]}"


def write_outputs(
    hands: Hands, folder: BatchFolder, formats: Sequence[str], source: SolvedSource, attribution: str
) -> list[Path]:
    """Write the segments in each of the formats, side by side; equal solutions make equal bytes.

    What there is to say of the files is noted in the ``source``.
    """
    stated = statements(attribution, source.solution.height_datum)
    stated["changed_at"] = utc_text(source.newest) or ""
    folder.scratch.mkdir(parents=True, exist_ok=True)
    place = folder.scratch / "solved"
    place.write_bytes(pickle.dumps(source, pickle.HIGHEST_PROTOCOL))
    made: dict[str, Written] = {}
    for name, written in hands.results(formats, lambda name: (_write, folder, name, place, stated)):
        if written is DEAD:
            raise BatchError(say("batch.writer_died", name=name))
        made[name] = written
    place.unlink()
    kept = set[Path]()
    for name in formats:
        source.notes += made[name].notes
        kept |= {made[name].path, *made[name].beside}
    remove_outputs(folder, kept)
    return [made[name].path for name in formats]


class Written(NamedTuple):
    """A file, those that belong to it, and what there is to say of them."""

    path: Path
    beside: list[Path]
    notes: list[str]


def _write(folder: BatchFolder, name: str, place: Path, stated: dict[str, str]) -> Written:
    """One format, by whoever it is given to."""
    source: SolvedSource = pickle.loads(place.read_bytes())  # noqa: S301 - our own file
    chosen = FORMATS[name]
    path = folder.slopes(file_name(chosen))
    with whole_file(path) as partial:
        # What formats ask of a source, this one has; but of ways.
        chosen.write(cast("Source", source), partial, stated, chosen.parse_options({}, local=True))
    beside = chosen.companions(path, stated)
    write_companions(beside)
    return Written(path, [*beside], source.notes)


def remove_outputs(folder: BatchFolder, kept: set[Path]) -> None:
    """Remove files of slopes that were written before, of other formats or logs."""
    for path in folder.path.glob("slopes*"):
        if path not in kept:
            path.unlink()
