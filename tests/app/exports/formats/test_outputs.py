"""One contract for every output: what goes in comes out, unknown stays unknown, a failure leaves nothing."""

from __future__ import annotations

import csv
import json
import math
import time
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import Any
from weakref import WeakSet

import geopandas
import pandas as pd
import pyarrow.parquet as pq
import pyogrio
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from app.core.text import utc_text
from app.exports.formats import SEGMENT_FORMATS, segment_format_for, write_segments
from app.exports.writing import arrow
from app.exports.writing.arrow import arrow_tables
from app.map.segment import HEIGHT_DATUM, PROPERTIES, Segment, attribution, attribution_html
from fusion.errors import UnknownNameError

EXAMPLE = Segment(
    id=1,
    osm_way_id=2**40,
    from_node=-7,
    to_node=2**53 + 1,
    length_m=41.37449,
    highway="residential",
    name='Straße "Nord", 3\nb',
    oneway=-1,
    bridge=True,
    tunnel=False,
    slope_percent=-0.00001,
    slope_sigma_percent=0.31274,
    drives=3,
    observations=24,
    dem_slope_percent=float("nan"),
    updated_at=datetime(2026, 11, 20, 10, 13, 2, 4999, timezone(timedelta(hours=1))),
    coordinates=((8.48123456789, 48.99), (8.49, 49.0)),
    height_from_m=151.20449,
    height_to_m=-3.0,
    height_sigma_m=2.41,
    steepest_percent=-7.90371,
    steepest_from_m=0.0,
    steepest_to_m=20.0,
    driven_share=0.33333,
)
UNKNOWN = replace(
    EXAMPLE,
    id=None,
    name=None,
    slope_percent=None,
    slope_sigma_percent=float("inf"),
    drives=0,
    observations=0,
    dem_slope_percent=None,
    updated_at=None,
    height_from_m=None,
    height_to_m=float("nan"),
    height_sigma_m=None,
    steepest_percent=float("nan"),
    steepest_from_m=None,
    steepest_to_m=None,
    driven_share=None,
)
OF_NETWORK = (
    "height_from_m",
    "height_to_m",
    "height_sigma_m",
    "steepest_percent",
    "steepest_from_m",
    "steepest_to_m",
    "driven_share",
)
SOME = [EXAMPLE, UNKNOWN, replace(EXAMPLE, id=3, dem_slope_percent=4.5)]

NAMES = [pytest.param(name, id=name) for name in SEGMENT_FORMATS]


def read(path: Path) -> list[dict[str, Any]]:
    """The rows of a file by another reader than the writer: properties, and the line's coordinates."""
    if path.suffix == ".csv":
        with path.open(encoding="utf-8", newline="") as file:
            return [
                {name: value or None for name, value in row.items()}
                | {"line": list(shapely.from_wkt(row["wkt"]).coords)}
                for row in csv.DictReader(file)
            ]
    if path.suffix == ".geojson":
        found = json.loads(path.read_text(encoding="utf-8"))["features"]
        return [f["properties"] | {"line": [tuple(p) for p in f["geometry"]["coordinates"]]} for f in found]
    parquet = path.suffix == ".parquet"
    frame = geopandas.read_parquet(path) if parquet else geopandas.read_file(path, layer="segments")
    return [
        {name: None if pd.isna(row[name]) else row[name] for name in PROPERTIES}
        | {"line": list(row.geometry.coords)}
        for _, row in frame.iterrows()
    ]


def same(name: str, value: Any, expected: Any) -> bool:
    if expected is None or value is None:
        return value is expected
    if name == "updated_at":
        return bool(pd.Timestamp(value) == pd.Timestamp(expected))
    if isinstance(expected, bool):
        return str(value).lower() == str(expected).lower()
    if isinstance(expected, int):
        return int(value) == expected
    if isinstance(expected, float):
        return float(value) == expected
    return bool(value == expected)


@pytest.mark.parametrize("name", NAMES)
def test_what_goes_in_comes_out(tmp_path: Path, name: str) -> None:
    path = tmp_path / f"slopes{SEGMENT_FORMATS[name].suffixes[0]}"
    assert write_segments(iter(SOME), path) == len(SOME)
    rows = read(path)
    assert len(rows) == len(SOME)
    for row, feature in zip(rows, SOME, strict=True):
        for key, expected in feature.properties().items():
            if name == "gpkg" and key in {"id", "to_node"} and feature.id is None:
                continue  # the reader makes floats of a column with a null in it
            assert same(key, row[key], expected), (key, row[key], expected)
        assert row["line"] == [(8.4812346, 48.99), (8.49, 49.0)]


@pytest.mark.parametrize("name", NAMES)
def test_what_the_network_knows_is_in_every_output(tmp_path: Path, name: str) -> None:
    """As numbers, 0 as 0; unknown is null, whatever stood for it."""
    path = tmp_path / f"slopes{SEGMENT_FORMATS[name].suffixes[0]}"
    write_segments(SOME, path)
    known, unknown, _ = read(path)
    values = [None if known[key] is None else float(known[key]) for key in OF_NETWORK]
    assert values == [151.204, -3.0, 2.41, -7.9037, 0.0, 20.0, 0.3333]
    assert [unknown[key] for key in OF_NETWORK] == [None] * len(OF_NETWORK)
    assert PROPERTIES[-len(OF_NETWORK) - 1 :] == (*OF_NETWORK, "steepness_percent")


@pytest.mark.parametrize("name", NAMES)
def test_nothing_is_a_file_too(tmp_path: Path, name: str) -> None:
    path = tmp_path / f"none{SEGMENT_FORMATS[name].suffixes[0]}"
    assert write_segments([], path) == 0
    assert read(path) == []


@pytest.mark.parametrize("name", NAMES)
def test_a_file_is_replaced_whole_or_not_at_all(tmp_path: Path, name: str) -> None:
    path = tmp_path / f"slopes{SEGMENT_FORMATS[name].suffixes[0]}"
    write_segments(SOME, path)

    def broken() -> Iterator[Segment]:
        yield EXAMPLE
        raise RuntimeError("the database went away")

    with pytest.raises(RuntimeError, match="went away"):
        write_segments(broken(), path)
    assert len(read(path)) == len(SOME)
    beside = SEGMENT_FORMATS[name].companions(path, {})
    assert {*tmp_path.iterdir()} == {path, *beside}
    for place in beside:
        place.unlink()
    write_segments(SOME[:1], path)
    assert {*tmp_path.iterdir()} == {path, *beside}
    assert len(read(path)) == 1


@pytest.mark.parametrize("name", NAMES)
def test_segments_are_not_held(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of however many, an output has a table at most in memory."""
    for size in ("ROWS_PER_TABLE", "ROWS_PER_GROUP"):
        monkeypatch.setattr(arrow, size, 100)
    alive: WeakSet[Segment] = WeakSet()
    most = 0

    def many() -> Iterator[Segment]:
        nonlocal most
        for number in range(2000):
            segment = replace(EXAMPLE, id=number, coordinates=((8.0, 49.0), (8.0, 49.0 + number * 1e-5)))
            alive.add(segment)
            most = max(most, len(alive))
            yield segment

    assert write_segments(many(), tmp_path / f"slopes{SEGMENT_FORMATS[name].suffixes[0]}") == 2000
    assert most <= 300


@pytest.mark.parametrize("name", NAMES)
def test_the_same_segments_make_the_same_bytes(tmp_path: Path, name: str) -> None:
    output = SEGMENT_FORMATS[name]
    said = {"attribution": "somebody", "changed_at": "2026-11-20T09:13:02.004Z", "provenance": '{"a":[1]}'}
    files = [tmp_path / f"{number}{output.suffixes[0]}" for number in range(2)]
    for path in files:
        output.write_records(iter(SOME), path, said)
        time.sleep(0.005)  # times in files are of milliseconds
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.parametrize("name", NAMES)
def test_an_output_says_what_it_is(name: str) -> None:
    output = SEGMENT_FORMATS[name]
    assert output.name == name
    assert output.suffixes[0].startswith(".")
    assert output.suffixes[0] == output.suffixes[0].lower()
    assert output.description
    assert segment_format_for(Path(f"a.b/SLOPES{output.suffixes[0].upper()}")) is output
    assert len({other.suffixes[0] for other in SEGMENT_FORMATS.values()}) == len(SEGMENT_FORMATS)


@pytest.mark.parametrize("suffix", [output.suffixes[0] for output in SEGMENT_FORMATS.values()])
def test_a_missing_folder_is_named_and_no_file_that_nobody_asked_for(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(FileNotFoundError) as missing:
        write_segments(SOME, tmp_path / "none" / f"out{suffix}")
    assert missing.value.filename == str(tmp_path / "none")


@pytest.mark.parametrize("suffix", [output.suffixes[0] for output in SEGMENT_FORMATS.values()])
def test_a_place_that_is_taken_by_a_folder_is_named(tmp_path: Path, suffix: str) -> None:
    place = tmp_path / f"out{suffix}"
    place.mkdir()
    with pytest.raises(OSError, match="directory") as taken:
        write_segments(SOME, place)
    assert taken.value.filename == str(place)
    assert list(tmp_path.iterdir()) == [place]


def test_an_unknown_suffix_names_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match=r"\.shp.*\.geojson, \.parquet, \.gpkg, \.fgb, \.csv"):
        segment_format_for(Path("slopes.shp"))


def test_files_with_a_place_for_it_say_whose_data_they_hold(tmp_path: Path) -> None:
    source = attribution(["N49E008.hgt"])
    assert "ODbL" in source
    assert source.endswith("elevation from N49E008.hgt")
    write_segments(SOME, tmp_path / "a.geojson", source=source)
    assert json.loads((tmp_path / "a.geojson").read_text())["attribution"] == source
    write_segments(SOME, tmp_path / "a.parquet", source=source)
    assert pq.read_metadata(tmp_path / "a.parquet").metadata[b"attribution"].decode() == source
    write_segments(SOME, tmp_path / "a.gpkg", source=source)
    about = pyogrio.read_info(tmp_path / "a.gpkg", layer="segments")
    assert about["layer_metadata"]["DESCRIPTION"] == source
    write_segments(SOME, tmp_path / "a.fgb", source=source)
    about = pyogrio.read_info(tmp_path / "a.fgb")
    assert about["layer_metadata"]["DESCRIPTION"] == source
    assert about["capabilities"]["fast_spatial_filter"]
    write_segments(SOME, tmp_path / "a.csv", source=source)
    assert json.loads((tmp_path / "a.csv-metadata.json").read_text())["dc:rights"] == source


def test_files_with_a_place_for_it_say_what_heights_refer_to(tmp_path: Path) -> None:
    def said(**stated: str | None) -> list[str | None]:
        for output in SEGMENT_FORMATS.values():
            write_segments(SOME, tmp_path / f"a{output.suffixes[0]}", **stated)
        parquet = pq.read_metadata(tmp_path / "a.parquet").metadata.get(b"height_datum")
        layer = pyogrio.read_info(tmp_path / "a.gpkg", layer="segments")["layer_metadata"]
        header = pyogrio.read_info(tmp_path / "a.fgb")["layer_metadata"]
        beside = json.loads((tmp_path / "a.csv-metadata.json").read_text()).get("dc:description")
        return [
            json.loads((tmp_path / "a.geojson").read_text()).get("height_datum"),
            parquet and parquet.decode(),
            layer.get("height_datum"),
            header.get("height_datum"),
            beside and beside.removeprefix("Heights refer to: ").removesuffix("."),
        ]

    assert said() == [HEIGHT_DATUM] * 5
    assert said(height_datum="the WGS 84 ellipsoid") == ["the WGS 84 ellipsoid"] * 5
    assert said(height_datum=None) == [None] * 5


def test_attribution_of_many_rasters_stays_short_and_harmless() -> None:
    assert attribution_html(["<script>.tif"]).endswith("&lt;script&gt;.tif")
    assert attribution(f"N{n}E008.hgt" for n in range(10, 99)).endswith("and 85 more rasters")


def test_parquet_states_its_bounds(tmp_path: Path) -> None:
    write_segments(SOME, tmp_path / "a.parquet")
    geo = json.loads(pq.read_metadata(tmp_path / "a.parquet").metadata[b"geo"])
    assert geo["columns"]["geometry"]["bbox"] == [8.4812346, 48.99, 8.49, 49.0]
    assert geopandas.read_parquet(tmp_path / "a.parquet").crs.to_authority() == ("OGC", "CRS84")


@pytest.mark.parametrize("rows", [1, 2, 3, 7])
def test_tables_are_bounded_and_complete(rows: int) -> None:
    found = list(arrow_tables(iter(SOME), rows))
    assert all(len(table) <= rows for table in found)
    assert sum(map(len, found)) == len(SOME)


numbers = st.none() | st.floats()


@given(slope=numbers, sigma=numbers, dem=numbers, length=st.floats(0, 1e6))
def test_numbers_are_finite_or_null_and_rounded(
    slope: float | None, sigma: float | None, dem: float | None, length: float
) -> None:
    feature = replace(
        EXAMPLE, slope_percent=slope, slope_sigma_percent=sigma, dem_slope_percent=dem, length_m=length
    )
    document = feature.geojson()
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert tuple(document["properties"]) == PROPERTIES
    for name, value in (("slope_percent", slope), ("slope_sigma_percent", sigma), ("dem_slope_percent", dem)):
        shown = document["properties"][name]
        assert (shown is None) == (value is None or not math.isfinite(value))
        if shown is not None:
            assert shown == pytest.approx(value, abs=0.51e-4, rel=1e-12)
            assert math.copysign(1, shown) > 0 or shown < 0, "minus zero"


def test_times_are_utc() -> None:
    assert EXAMPLE.properties()["updated_at"] == "2026-11-20T09:13:02.004Z"
    assert utc_text(datetime(2026, 1, 1, tzinfo=UTC)) == "2026-01-01T00:00:00.000Z"
    with pytest.raises(ValueError, match="zone"):
        utc_text(datetime(2026, 1, 1))  # noqa: DTZ001 -- the point of the test


def test_a_feature_without_a_number_has_no_id_member() -> None:
    assert "id" not in UNKNOWN.geojson()
    assert EXAMPLE.geojson()["id"] == 1
