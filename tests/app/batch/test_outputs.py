"""Every format that needs no database is written from a solution alone, by equal bytes."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from app.batch.folder import BatchFolder
from app.batch.outputs import formats_of_segments, write_outputs
from app.batch.source import SolvedSource
from app.cli.fuse_files import Fusion
from fusion.pipeline import parse_options
from fusion.roads.osm import read_roads
from fusion.simulate.demonstration import write_all
from fusion.terrain.dem import Dem

NEWEST = datetime(2024, 6, 3, 8, tzinfo=UTC)


@pytest.mark.slow
def test_every_format_is_written(tmp_path: Path) -> None:
    town = write_all(tmp_path / "town", 1, seed=1, duration_s=60.0)
    with Dem.open([town.dem]) as dem:
        fusion = Fusion("raw", parse_options("raw"), read_roads(town.osm), dem)
        fusion.add(town.drives[0])
        solution = fusion.solve().solution
        written = []
        for name in ("one", "two"):
            (tmp_path / name).mkdir()
            source = SolvedSource(solution, NEWEST, [town.osm], dem)
            files = write_outputs(BatchFolder(tmp_path / name), formats_of_segments(), source, "Roads")
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
