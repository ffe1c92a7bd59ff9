"""What stands beside and inside exports for other programs: styles for QGIS, metadata of CSV on the Web."""

from __future__ import annotations

import csv
import json
import sqlite3
import warnings
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from xml.etree.ElementTree import Element

import defusedxml.ElementTree
import geopandas
import numpy as np
import pyogrio
import pytest
from matplotlib.colors import to_hex, to_rgb

from app.exports.formats import SEGMENT_FORMATS, write_segments
from app.exports.writing.qgis_style import MARK, WIDTH_MM, classes, qml
from app.map.picture.key import STEEPNESS
from app.map.segment import PROPERTIES, Segment
from app.map.style.scale import BREAKS_PERCENT, COLOURS, UNKNOWN_COLOUR

SEGMENT = Segment(
    id=None,
    osm_way_id=7,
    from_node=1,
    to_node=2,
    length_m=41.4,
    highway="residential",
    name=None,
    oneway=0,
    bridge=False,
    tunnel=False,
    slope_percent=-4.2,
    slope_sigma_percent=0.3,
    drives=1,
    observations=9,
    dem_slope_percent=None,
    updated_at=None,
    coordinates=((8.0, 49.0), (8.1, 49.1)),
)


def style(text: str) -> Element:
    found: Element = defusedxml.ElementTree.fromstring(text.encode())
    return found


def symbol(root: Element, number: str) -> dict[str, str]:
    """The properties of one symbol's line."""
    (layer,) = root.findall(f"./renderer-v2/symbols/symbol[@name='{number}'][@type='line']/layer")
    assert layer.get("class") == "SimpleLine"
    return {str(o.get("name")): str(o.get("value")) for o in layer.findall("./Option/Option")}


def test_the_style_is_what_qgis_writes_and_draws_as_the_map_does() -> None:
    text = qml()
    assert text.startswith("<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>")
    root = style(text)
    assert root.tag == "qgis"
    assert root.findtext("layerGeometryType") == "1"
    renderer = root.find("renderer-v2")
    assert renderer is not None
    assert renderer.get("type") == "graduatedSymbol"
    assert renderer.get("attr") == 'coalesce(abs("slope_percent"), -1)'
    ranges = renderer.findall("./ranges/range")
    assert [r.get("symbol") for r in ranges] == [str(k) for k in range(len(COLOURS) + 1)]
    assert len({r.get("uuid") for r in ranges}) == len(ranges)
    assert [to_hex(STEEPNESS(x)) for x in np.linspace(0, 1, len(COLOURS))] == list(COLOURS)
    for k, colour in enumerate(COLOURS):
        drawn = symbol(root, str(k))
        assert drawn["line_color"] == ",".join(str(round(255 * c)) for c in to_rgb(colour)) + ",255"
        assert drawn["use_custom_dash"] == "0"
    unknown = symbol(root, str(len(COLOURS)))
    assert UNKNOWN_COLOUR == "#a9a9a9"
    assert (unknown["line_color"], unknown["use_custom_dash"]) == ("169,169,169,255", "1")
    widths = [o.get("value") for o in root.iter("Option") if o.get("name") == "expression"]
    assert widths == [WIDTH_MM] * (len(COLOURS) + 1), "every class and the source symbol"


@pytest.mark.parametrize("steepness", [-1.0, 0.0, 0.3, 1.0, 5.9, 15.0, 40.0, 400.0])
def test_every_steepness_has_a_class_and_unknown_one_of_its_own(steepness: float) -> None:
    found = [label for low, high, label in classes() if low <= steepness <= high]
    assert found
    assert ("unknown" in found) == (steepness == -1)
    assert len(found) == 1 or steepness in BREAKS_PERCENT


def test_a_geopackage_brings_its_style_as_qgis_looks_for_it(tmp_path: Path) -> None:
    path = tmp_path / "slopes.gpkg"
    write_segments([SEGMENT], path)
    with closing(sqlite3.connect(path)) as file:
        file.row_factory = sqlite3.Row
        (row,) = file.execute("SELECT * FROM layer_styles").fetchall()
        (geometry,) = file.execute("SELECT table_name, column_name FROM gpkg_geometry_columns").fetchall()
        kinds = {r[0]: r[1] for r in file.execute("SELECT table_name, data_type FROM gpkg_contents")}
        faults = file.execute("PRAGMA foreign_key_check").fetchall()
        sound = file.execute("PRAGMA integrity_check").fetchone()[0]
    assert tuple(row.keys()) == (
        "id", "f_table_catalog", "f_table_schema", "f_table_name", "f_geometry_column", "styleName", "styleQML",
        "styleSLD", "useAsDefault", "description", "owner", "ui", "update_time",
    )  # fmt: skip
    assert (row["f_table_name"], row["f_geometry_column"]) == tuple(geometry)
    assert (row["f_table_catalog"], row["f_table_schema"], row["useAsDefault"]) == ("", "", 1)
    assert style(row["styleQML"]).tag == "qgis"
    assert kinds == {"segments": "features", "layer_styles": "attributes"}
    assert (faults, sound) == ([], "ok")


def test_readers_take_the_style_for_no_layer_of_features(tmp_path: Path) -> None:
    path = tmp_path / "slopes.gpkg"
    write_segments([SEGMENT], path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert pyogrio.list_layers(path).tolist() == [["segments", "LineString"], ["layer_styles", None]]
        named = geopandas.read_file(path, layer="segments")
    assert len(named) == 1
    assert set(PROPERTIES) <= set(named.columns)
    # Without a name the segments come first; that there are two tables is what pyogrio then says.
    with pytest.warns(UserWarning, match=r"'segments' \(default\), 'layer_styles'"):
        first = geopandas.read_file(path)
    assert first.geom_equals(named).all()


@pytest.mark.parametrize("suffix", [".geojson", ".parquet"])
def test_files_without_a_place_for_it_have_the_style_beside_them(tmp_path: Path, suffix: str) -> None:
    path, beside = tmp_path / f"slopes{suffix}", tmp_path / "slopes.qml"
    write_segments([SEGMENT], path)
    assert beside.read_text(encoding="utf-8") == qml()
    assert MARK in qml()
    beside.write_text(f"<!-- {MARK} --> an older one")
    write_segments([SEGMENT], path)
    assert beside.read_text(encoding="utf-8") == qml()
    beside.write_text("<qgis>one of my own</qgis>")
    write_segments([SEGMENT], path)
    assert beside.read_text() == "<qgis>one of my own</qgis>", "a person's work is never lost"


def test_what_fails_leaves_nothing_beside(tmp_path: Path) -> None:
    def broken() -> Iterator[Segment]:
        yield SEGMENT
        raise RuntimeError("the database went away")

    for output in SEGMENT_FORMATS.values():
        with pytest.raises(RuntimeError, match="went away"):
            write_segments(broken(), tmp_path / f"slopes{output.suffixes[0]}")
    assert not list(tmp_path.iterdir())


def test_a_csv_says_what_it_is_as_csv_on_the_web_does(tmp_path: Path) -> None:
    path = tmp_path / "slopes.csv"
    write_segments([SEGMENT], path, source="Roads © somebody")
    about = json.loads((tmp_path / "slopes.csv-metadata.json").read_text(encoding="utf-8"))
    assert about["@context"][0] == "http://www.w3.org/ns/csvw"
    assert about["url"] == "slopes.csv"
    assert about["dc:rights"] == "Roads © somebody"
    with path.open(encoding="utf-8", newline="") as file:
        (row,) = csv.DictReader(file)
    columns = about["tableSchema"]["columns"]
    assert [column["titles"] for column in columns] == list(row)
    assert {column["datatype"] for column in columns} <= {
        "integer",
        "number",
        "string",
        "boolean",
        "dateTime",
    }
    for column in columns:
        value = row[column["titles"]]
        if value and column["datatype"] in {"integer", "number"}:
            float(value)
        if column["datatype"] == "boolean":
            assert value in {"true", "false"}
