"""Every format that needs no database is written from a solution alone, by equal bytes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from functools import cache, partial
from pathlib import Path
from typing import Any, cast

import pyarrow.parquet as pq
import pytest

from app.batch.folder import BatchFolder
from app.batch.hands import Hands
from app.batch.outputs import SolvedSource, formats_of_segments, write_outputs
from app.cli.logs.fusing import Fusion
from fusion.pipeline import parse_options
from fusion.roads.osm import read_roads
from fusion.simulate.demonstration import write_all
from fusion.terrain.dem import Dem

NEWEST = datetime(2024, 6, 3, 8, tzinfo=UTC)


class Own:
    """This process's hands."""

    def results(
        self, items: Sequence[Any], call: Callable[[Any], tuple[Any, ...]]
    ) -> Iterator[tuple[Any, Any]]:
        """The last item first: who is done when is nobody's to say."""
        for item in reversed(items):
            work, *arguments = call(item)
            yield item, work(*arguments)


@cache
def terrain(raster: Path) -> Dem:
    """Opened once."""
    return Dem.open([raster])


@pytest.mark.slow
def test_every_format_is_written(tmp_path: Path) -> None:
    town = write_all(tmp_path / "town", 1, seed=1, duration_s=60.0)
    with terrain(town.dem) as dem:
        fusion = Fusion("profile", parse_options("profile"), read_roads(town.osm), dem)
        fusion.add(town.drives[0])
        solution = fusion.solve().solution
        written = []
        for name in ("one", "two"):
            (tmp_path / name).mkdir()
            source = SolvedSource(solution, NEWEST, [town.osm], partial(terrain, town.dem))
            folder, formats = BatchFolder(tmp_path / name), formats_of_segments()
            files = write_outputs(cast("Hands", Own()), folder, formats, source, "Roads")
            written.append([path.read_bytes() for path in files])
    assert len({path.name for path in files}) == len(formats_of_segments()) > 10
    empty = {path.name for path, data in zip(files, written[0], strict=True) if not data}
    assert empty <= {"slopes-maproulette.geojsonl"}, "on roads without tags nothing is proposed"
    same = [path.name for path, a, b in zip(files, *written, strict=True) if a == b]
    assert same == [path.name for path in files]
    table = pq.read_table(tmp_path / "one" / "slopes.parquet")
    assert len(table) == len(solution) > 3
    assert set(table["updated_at"].to_pylist()) == {NEWEST}
    west, south, east, north = source.extent()
    assert west < east
    assert south < north
