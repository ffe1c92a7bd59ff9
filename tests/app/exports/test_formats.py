"""Every format of the stored map: the same bytes for the same data, its origin inside, and what others read of it."""

from __future__ import annotations

import csv
import gzip
import hashlib
import json
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import geopandas
import pyarrow.parquet as pq
import pyogrio
import pytest
import rasterio
from pmtiles.reader import MmapSource, Reader, all_tiles
from sqlalchemy import text
from typer.testing import CliRunner

from app.cli import app
from app.core import databases
from app.core.db import Sessions, make_engine, session_factory, snapshot
from app.core.settings import Settings
from app.embedded.cluster import EmbeddedPostgres
from app.exports.formats import FORMATS, SEGMENT_FORMATS, format_for
from app.exports.making import Made, make_file, request_of
from app.map.tiles.store import mvt
from app.roads.imports import import_roads
from drawn_support import draw
from fusion.errors import BadOptionsError, UnknownNameError
from fusion.simulate.scene.town import Town
from fusion.simulate.write.osm_file import write_osm

runner = CliRunner()
_KEPT_FILE = """
    UPDATE regions SET (file_uri, file_sha256) = (SELECT file_uri, file_sha256 FROM regions WHERE name = 'town')
"""
_MEASURED = """
    INSERT INTO segment_slopes (segment_id, slope_percent, slope_sigma_percent, drives, observations, updated_at,
                                height_from_m, height_to_m, height_sigma_m)
    SELECT id, 6.5, 0.4, 2, 30, now(), 120.0, 120.0 + 0.065 * length_m, 0.8 FROM segments
    WHERE highway <> 'service' ORDER BY id DESC LIMIT 40
"""
NAMES = [pytest.param(name, id=name) for name in FORMATS]
WITH_A_PLACE = [name for name, one in FORMATS.items() if not one.consumer]


def make(sessions: Sessions, settings: Settings, name: str, folder: Path, **asked: Any) -> tuple[Path, Made]:
    request = request_of(name, asked.pop("options", {}), **asked)
    folder.mkdir(exist_ok=True)
    path = folder / request.file_name
    with snapshot(sessions) as session:
        made = make_file(session, settings, request, path, lambda share: None)
    for place, said in request.format.companions(path, made.stated).items():
        place.write_text(said, encoding="utf-8")
    return path, made


def digest(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


@pytest.fixture(scope="module")
def pair(
    cluster: EmbeddedPostgres,
    template_db: str,
    new_database: Callable[[str], str],
    fill_map: Callable[[Sessions], None],
    town: Town,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[list[tuple[Sessions, Settings]]]:
    """Two databases with the same content, as one and its restored backup: the grid, and a town out of a file."""
    folder = tmp_path_factory.mktemp("formats")
    first = new_database(template_db)
    engine = make_engine(cluster.url_of(first))
    fill_map(session_factory(engine))
    write_osm(town, folder / "town.osm")
    settings = Settings(database_url=cluster.url_of(first), data_dir=folder)
    import_roads(session_factory(engine), folder / "town.osm", settings.dem_dir)
    with session_factory(engine).begin() as session:  # the grid came from no file: let that be the town's
        session.execute(text(_KEPT_FILE))
        session.execute(text(_MEASURED))
    draw(session_factory(engine))
    engine.dispose()  # what is copied must be used by nobody
    names = [first, new_database(first)]
    engines = [make_engine(cluster.url_of(name)) for name in names]
    with session_factory(engines[1]).begin() as session:  # another order in the table, as years bring it
        session.execute(text("UPDATE segments SET name = name WHERE id % 3 = 0"))
    yield [
        (session_factory(engine), Settings(database_url=cluster.url_of(name), data_dir=folder))
        for name, engine in zip(names, engines, strict=True)
    ]
    for name, engine in zip(names, engines, strict=True):
        engine.dispose()
        databases.drop_database(cluster.url, name)


def rows_of(sessions: Sessions, query: str) -> list[tuple[Any, ...]]:
    with sessions() as session:
        return [tuple(row) for row in session.execute(text(query))]


@pytest.mark.parametrize("name", NAMES)
def test_the_same_data_make_the_same_bytes(
    pair: list[tuple[Sessions, Settings]], tmp_path: Path, name: str
) -> None:
    """Whenever a file is made, and from whichever copy of the data."""
    made = []
    for number, (sessions, settings) in enumerate([*pair, pair[0]]):
        make(sessions, settings, name, tmp_path / str(number))
        made.append(digest(tmp_path / str(number)))
        time.sleep(0.005)  # times in files are of milliseconds
    assert made[0] == made[1] == made[2]
    assert made[0]


@pytest.mark.parametrize("name", [*SEGMENT_FORMATS])
def test_every_segment_is_in_every_output_with_the_values_of_the_database(
    pair: list[tuple[Sessions, Settings]], tmp_path: Path, name: str
) -> None:
    sessions, settings = pair[0]
    path, made = make(sessions, settings, name, tmp_path / "out")
    expected = rows_of(
        sessions,
        "SELECT s.id, s.to_node, round(a.slope_percent::numeric, 4)::float8 FROM segments AS s "
        "LEFT JOIN segment_slopes AS a ON a.segment_id = s.id AND a.drives > 0 ORDER BY s.id",
    )
    if name == "csv":
        with path.open(encoding="utf-8", newline="") as file:
            found = [
                (int(r["id"]), int(r["to_node"]), float(r["slope_percent"]) if r["slope_percent"] else None)
                for r in csv.DictReader(file)
            ]
    else:
        frame = (
            geopandas.read_parquet(path) if name == "geoparquet" else pyogrio.read_dataframe(path, layer=0)
        )
        if name == "geojson":  # a reader guesses its types
            frame = geopandas.read_file(path, engine="pyogrio")
        else:
            assert frame.to_node.dtype == "int64"
        found = [
            (
                int(r.id),
                int(r.to_node),
                None if r.slope_percent != r.slope_percent else float(r.slope_percent),
            )
            for r in frame.itertuples()
        ]
    assert sorted(found) == expected
    assert made.count == len(expected) > 100


def test_a_flatgeobuf_finds_by_place(pair: list[tuple[Sessions, Settings]], tmp_path: Path) -> None:
    path, _ = make(*pair[0], "flatgeobuf", tmp_path / "out")
    assert pyogrio.read_info(path)["capabilities"]["fast_spatial_filter"], "it has an index"
    box = (8.3995, 48.9995, 8.4005, 49.0005)
    frame = pyogrio.read_dataframe(path, bbox=box)
    query = "SELECT id FROM segments WHERE geom && ST_MakeEnvelope(8.3995, 48.9995, 8.4005, 49.0005, 4326) ORDER BY 1"
    assert sorted((int(i),) for i in frame.id) == rows_of(pair[0][0], query)


@pytest.mark.parametrize("name", ["ways-csv", "ways-parquet"])
def test_ways_are_a_table(pair: list[tuple[Sessions, Settings]], tmp_path: Path, name: str) -> None:
    sessions, settings = pair[0]
    path, made = make(sessions, settings, name, tmp_path / "out")
    expected = rows_of(sessions, "SELECT id, from_node, drives, ST_NPoints(geom) FROM ways ORDER BY id")
    assert made.count == len(expected) == 5
    if name == "ways-csv":
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        found = [(int(r["id"]), int(r["from_node"]), int(r["drives"]), r["wkt"].count(",") + 1) for r in rows]
        about = json.loads((path.parent / f"{path.name}-metadata.json").read_text())
        assert [column["name"] for column in about["tableSchema"]["columns"]] == list(rows[0])
    else:
        frame = geopandas.read_parquet(path)
        found = [(r.id, r.from_node, r.drives, len(r.geometry.coords)) for r in frame.itertuples()]
    assert found == expected
    _, driven = make(sessions, settings, name, tmp_path / "driven", driven=True)
    assert driven.count == sum(row[2] > 0 for row in expected) > 0


def test_an_archive_holds_the_tiles_that_the_service_shows(
    pair: list[tuple[Sessions, Settings]], tmp_path: Path
) -> None:
    sessions, settings = pair[0]
    path, made = make(sessions, settings, "pmtiles", tmp_path / "out", options={"min_zoom": 11})
    with path.open("rb") as file:
        source = MmapSource(file)
        header, metadata = Reader(source).header(), Reader(source).metadata()
        tiles = {place: gzip.decompress(data) for place, data in all_tiles(source)}
    assert (header["min_zoom"], header["max_zoom"], header["clustered"]) == (11, 14, True)
    assert len(tiles) == header["addressed_tiles_count"] == made.count
    assert {z for z, _, _ in tiles} == {11, 12, 13, 14}
    with snapshot(sessions) as session:
        for (z, x, y), data in tiles.items():
            assert data == mvt(session, z, x, y, full_zoom=settings.tile_full_zoom)
            assert data
        cells = rows_of(sessions, "SELECT id >> 14, id & 16383 FROM cells WHERE version > 0")
        assert {(14, *place) for place in cells if mvt(session, 14, *place)} <= set(tiles)
    assert metadata["vector_layers"][0]["id"] == "segments"
    assert json.loads(metadata["provenance"]) == made.provenance


def test_gdal_reads_every_segment_out_of_an_archive(
    pair: list[tuple[Sessions, Settings]], tmp_path: Path
) -> None:
    path, _ = make(*pair[0], "pmtiles", tmp_path / "out")
    frame = pyogrio.read_dataframe(path, layer="segments", fid_as_index=True)
    column = "mvt_id" if "mvt_id" in frame.columns else "id"
    assert frame.slope_percent.dtype == "float64"
    found = {
        (int(i), None if math.isnan(slope) else round(float(slope), 6))
        for i, slope in zip(frame[column], frame.slope_percent, strict=True)
    }
    expected = "SELECT s.id, round(a.slope_percent::numeric, 6)::float8 FROM segments AS s " + (
        "LEFT JOIN segment_slopes AS a ON a.segment_id = s.id AND a.drives > 0"
    )
    assert found == set(rows_of(pair[0][0], expected))


def test_a_box_across_the_antimeridian_has_both_sides(
    pair: list[tuple[Sessions, Settings]], tmp_path: Path
) -> None:
    box = (179.0, -18.0, -179.0, -16.0)
    for name, count in (("csv", 3), ("pmtiles", None), ("ways-csv", 0)):
        _, made = make(*pair[0], name, tmp_path / name, bbox=box)
        assert made.count == count or (count is None and made.count > 2)
        assert made.provenance["request"]["bbox"] == list(box)


def test_a_region_that_is_asked_for_is_all_there_is(
    pair: list[tuple[Sessions, Settings]], tmp_path: Path
) -> None:
    everything, grid, town = (
        make(*pair[0], "csv", tmp_path / str(region), region=region)[1].count
        for region in (None, "roads", "town")
    )
    assert grid + town == everything
    assert min(grid, town) > 100
    with pair[0][0].begin() as session:
        session.execute(text("UPDATE segments SET regions = '{}' WHERE osm_way_id = 900"))
        try:
            request = request_of("csv", {}, region="roads")
            made = make_file(session, pair[0][1], request, tmp_path / "a.csv", lambda share: None)
        finally:
            session.rollback()
    assert made.count == grid - 3


@pytest.mark.parametrize("name", WITH_A_PLACE)
def test_the_origin_is_inside_or_beside(
    pair: list[tuple[Sessions, Settings]], tmp_path: Path, name: str
) -> None:
    path, made = make(*pair[0], name, tmp_path / "out", bbox=(7.8, 47.9, 8.5, 49.1))
    said: Any
    if path.suffix == ".parquet":
        said = pq.read_metadata(path).metadata[b"provenance"]
    elif path.suffix in {".gpkg", ".fgb"}:
        layer = pyogrio.read_info(path, layer="segments")["layer_metadata"]
        said = layer["provenance"]
        assert layer["DESCRIPTION"] == made.provenance["attribution"]
        assert layer["changed_at"] == made.provenance["changed_at"]
    elif path.suffix == ".tif":
        with rasterio.open(path) as raster:
            said = raster.tags()["PROVENANCE"]
            assert raster.tags()["ATTRIBUTION"] == made.provenance["attribution"]
    elif path.suffix == ".geojson":
        said = json.dumps(json.loads(path.read_text())["provenance"])
    elif path.suffix == ".csv":
        said = json.loads((path.parent / f"{path.name}-metadata.json").read_text())["dc:provenance"]
    else:
        with path.open("rb") as file:
            said = Reader(MmapSource(file)).metadata()["provenance"]
    assert json.loads(said) == made.provenance
    assert made.provenance["request"]["format"] == name


def test_a_suffix_or_a_name_chooses() -> None:
    assert format_for(Path("a.csv")).name == "csv"
    assert format_for(Path("a.parquet")).name == "geoparquet"
    assert format_for(Path("A.FGB")).name == "flatgeobuf"
    assert format_for(Path("a.csv"), "ways-csv").name == "ways-csv"
    with pytest.raises(UnknownNameError, match=r"pmtiles.*ways|ways.*pmtiles"):
        format_for(Path("a.csv"), "nothing")
    with pytest.raises(UnknownNameError, match=r"\.shp.*\.pmtiles"):
        format_for(Path("a.shp"))
    with pytest.raises(BadOptionsError, match="takes"):
        request_of("csv", {"speed": 1})
    assert len({name for name, _ in FORMATS.items()}) == len(FORMATS)
    for _, one in FORMATS.items():
        assert one.suffixes
        assert all(suffix.startswith(".") for suffix in one.suffixes)
        assert one.media_type
        assert one.description


def test_the_command_takes_formats_and_options(
    pair: list[tuple[Sessions, Settings]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VERSANT_DATABASE_URL", str(pair[0][1].database_url))
    report = tmp_path / "figures.json"

    def run(*arguments: str | Path) -> str:
        done = runner.invoke(app, ["export", *map(str, arguments)])
        assert done.exit_code == 0, done.output
        return done.output

    assert "5 ways." in run("-o", tmp_path / "w.csv", "--as", "ways-csv")
    out = tmp_path / "t.pmtiles"
    assert "tiles." in run("-o", out, "--option", "min_zoom=13", "--json", report)
    assert json.loads(report.read_text())["format"] == "pmtiles"
    service, _ = make(*pair[0], "pmtiles", tmp_path / "out", options={"min_zoom": 13})
    assert service.read_bytes() == out.read_bytes(), "command and service make the same file"
    for wrong, says in (
        (["-o", "x.csv", "--as", "nothing"], "--as"),
        (["-o", "x.csv", "--option", "a=1"], "--option"),
        (["--as", "csv"], "--as"),
        (["-o", "x.pmtiles", "--driven"], "driven"),
    ):
        refused = runner.invoke(app, ["export", *wrong], env={"COLUMNS": "1000"})
        assert refused.exit_code == 2
        assert says in refused.output
