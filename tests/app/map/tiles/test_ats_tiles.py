"""OGC API Tiles, part 1 (OGC 20-057): the abstract tests of the declared classes, by their names, and bad input."""

from __future__ import annotations

import math
from typing import Any

import pytest

from app.map.items.landing import CONFORMANCE
from app.map.tiles.documents import VECTOR_REL as TILESETS_REL
from mvt_support import layers
from problem_support import check

BASES = ("/tiles", "/collections/segments/tiles", "/collections/ways/tiles")
QUAD_URI = "http://www.opengis.net/def/tilematrixset/OGC/1.0/WebMercatorQuad"
MVT = "application/vnd.mapbox-vector-tile"


def get(web: Any, path: str) -> Any:
    answer = web.client.get(path.removeprefix(web.base))
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/json"
    return answer.json()


def linked(document: Any, rel: str) -> str:
    """Where the only link of this relation leads."""
    (found,) = [one["href"] for one in document["links"] if one["rel"] == rel]
    return str(found)


def test_conformance_names_classes_of_the_standard() -> None:
    of_tiles = "http://www.opengis.net/spec/ogcapi-tiles-1/1.0/conf/"
    names = [uri.removeprefix(of_tiles) for uri in CONFORMANCE if uri.startswith(of_tiles)]
    assert names == ["core", "tileset", "tilesets-list", "dataset-tilesets", "geodata-tilesets", "mvt"]


# --- A.2 core -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("base", BASES[:2])
def test_ats_tiles_core_tc_op(reading: Any, base: str) -> None:
    """/conf/core/tc-op: a GET at the address that the template gives."""
    tileset = get(reading, f"{base}/WebMercatorQuad")
    (template,) = [one for one in tileset["links"] if one["rel"] == "item"]
    assert template["templated"] is True
    assert template["type"] == MVT
    address = template["href"].format(tileMatrix=13, tileRow=2813, tileCol=4287)
    answer = reading.client.get(address.removeprefix(reading.base))
    assert answer.status_code == 200
    assert answer.content == reading.client.get("/tiles/13/4287/2813.mvt").content


def test_ats_tiles_core_tc_success(reading: Any) -> None:
    """/conf/core/tc-success: 200 with the tile, 204 where it is empty."""
    full = reading.client.get("/tiles/WebMercatorQuad/13/2813/4287")
    assert (full.status_code, full.headers["content-type"]) == (200, MVT)
    empty = reading.client.get("/tiles/WebMercatorQuad/13/0/0")
    assert (empty.status_code, empty.content) == (204, b"")


@pytest.mark.parametrize(
    ("place", "field"),
    [
        ("31/0/0", "tileMatrix"),
        ("19/0/0", "tileMatrix"),
        ("-1/0/0", "tileMatrix"),
        ("x/0/0", "tileMatrix"),
        ("3/8/0", "tileRow"),
        ("3/0/8", "tileCol"),
        ("3/-1/0", "tileRow"),
        ("3/0/1.5", "tileCol"),
        ("3/0/99999999999999999999", "tileCol"),
    ],
)
@pytest.mark.parametrize("suffix", ["", ".mvt", ".pbf"])
@pytest.mark.parametrize("base", BASES)
def test_ats_tiles_core_tc_error(reading: Any, base: str, place: str, field: str, suffix: str) -> None:
    """/conf/core/tc-error: what is no tile of the set is a 404 that says why."""
    problem = check(reading.client.get(f"{base}/WebMercatorQuad/{place}{suffix}"), 404)
    assert problem["errors"][0]["field"] == field


@pytest.mark.parametrize("base", BASES)
def test_other_bad_input(reading: Any, base: str) -> None:
    for path in ("", "/WebMercatorQuad", "/WebMercatorQuad/13/2813/4287"):
        for query in ("f=png", "f=", "speed=3", "f=mvt&colour=red"):
            problem = check(reading.client.get(f"{base}{path}?{query}"), 400)
            assert problem["errors"][0]["field"]
    assert "mvt, pbf" in reading.client.get(f"{base}/WebMercatorQuad/13/2813/4287?f=png").json()["detail"]
    check(reading.client.get(f"{base}/WorldCRS84Quad"), 404)
    check(reading.client.get(f"{base}/WorldCRS84Quad/3/0/0"), 404)
    check(reading.client.get("/collections/roads/tiles"), 404)


# --- A.3 tileset ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("base", BASES)
def test_ats_tiles_tileset_desc_op_and_success(reading: Any, base: str) -> None:
    """/conf/tileset/desc-op, success: the metadata by the schema of OGC 17-083r4."""
    tileset = get(reading, f"{base}/WebMercatorQuad")
    assert tileset["dataType"] == "vector"
    assert tileset["crs"] == "http://www.opengis.net/def/crs/EPSG/0/3857"
    assert tileset["tileMatrixSetURI"] == QUAD_URI
    assert linked(tileset, "self") == f"{reading.base}{base}/WebMercatorQuad"
    assert (
        get(reading, linked(tileset, "http://www.opengis.net/def/rel/ogc/1.0/tiling-scheme"))["uri"]
        == QUAD_URI
    )
    limits = {one["tileMatrix"]: one for one in tileset["tileMatrixSetLimits"]}
    lowest = 10 if "ways" in base else 6
    assert list(limits) == [str(z) for z in range(lowest, 19)]
    for z in range(lowest, 19):
        one = limits[str(z)]
        assert 0 <= one["minTileRow"] <= one["maxTileRow"] < 2**z
        assert 0 <= one["minTileCol"] <= one["maxTileCol"] < 2**z
    at13 = limits["13"]
    assert at13["minTileCol"] <= 4287 <= at13["maxTileCol"]
    assert at13["minTileRow"] <= 2813 <= at13["maxTileRow"]
    (layer,) = tileset["layers"]
    assert layer["id"] == ("ways" if "ways" in base else "segments")
    assert layer["propertiesSchema"]["properties"]["slope_percent"]["type"] == "number"


def test_the_layer_says_what_is_in_the_tile(reading: Any) -> None:
    (layer,) = get(reading, "/tiles/WebMercatorQuad")["layers"]
    tile = layers(reading.client.get("/tiles/WebMercatorQuad/13/2813/4287").content)
    named = {name for one in tile[layer["id"]] for name in one["properties"]}
    assert named == {*layer["propertiesSchema"]["properties"]} - {"tunnel"}, "the grid has no tunnel"


# --- A.4 tilesets-list, A.5 dataset-tilesets, A.6 geodata-tilesets --------------------------------------------------


@pytest.mark.parametrize("base", BASES)
def test_ats_tiles_tilesets_list_tsl_op_and_success(reading: Any, base: str) -> None:
    """/conf/tilesets-list/tsl-op, tsl-success: also of dataset-tilesets and geodata-tilesets."""
    (one,) = get(reading, base)["tilesets"]
    assert (one["dataType"], one["tileMatrixSetURI"]) == ("vector", QUAD_URI)
    assert get(reading, linked(one, "self"))["tileMatrixSetURI"] == QUAD_URI


def test_ats_tiles_dataset_tilesets_landingpage(reading: Any) -> None:
    """/conf/dataset-tilesets/landingpage: the landing page leads to the tilesets of the whole."""
    landing = get(reading, "/?f=json")
    (one,) = get(reading, linked(landing, TILESETS_REL))["tilesets"]
    assert "/collections/" not in linked(one, "self")


@pytest.mark.parametrize("layer", ["segments", "ways"])
def test_ats_tiles_geodata_tilesets_desc_links(reading: Any, layer: str) -> None:
    """/conf/geodata-tilesets/desc-links: each collection leads to its own."""
    collection = get(reading, f"/collections/{layer}?f=json")
    (one,) = get(reading, linked(collection, TILESETS_REL))["tilesets"]
    assert f"/collections/{layer}/" in linked(one, "self")


# --- what tile matrix sets there are ------------------------------------------------------------------------------


def test_the_tile_matrix_set_is_that_of_the_web(reading: Any) -> None:
    (one,) = get(reading, "/tileMatrixSets")["tileMatrixSets"]
    assert (one["id"], one["uri"]) == ("WebMercatorQuad", QUAD_URI)
    whole = get(reading, linked(one, "self"))
    assert whole["id"] == "WebMercatorQuad"
    first = whole["tileMatrices"][0]
    assert first["scaleDenominator"] == pytest.approx(559082264.028717, rel=1e-12)
    assert first["pointOfOrigin"] == pytest.approx([-20037508.3427892, 20037508.3427892])
    for z, matrix in enumerate(whole["tileMatrices"]):
        assert matrix["id"] == str(z)
        assert matrix["matrixWidth"] == matrix["matrixHeight"] == 2**z
        assert matrix["cellSize"] * 256 * 2**z == pytest.approx(2 * math.pi * 6378137)


# --- A.9 mvt ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", ["", ".mvt", ".pbf", "?f=mvt", "?f=pbf"])
@pytest.mark.parametrize("base", BASES[:2])
def test_ats_tiles_mvt_tile(reading: Any, base: str, suffix: str) -> None:
    """/conf/mvt/content: every way to ask for the format gives the same tile."""
    answer = reading.client.get(f"{base}/WebMercatorQuad/13/2813/4287{suffix}")
    assert (answer.status_code, answer.headers["content-type"]) == (200, MVT)
    assert answer.content == reading.client.get("/tiles/13/4287/2813.pbf").content
    again = reading.client.get(
        f"{base}/WebMercatorQuad/13/2813/4287{suffix}", headers={"If-None-Match": answer.headers["etag"]}
    )
    assert again.status_code == 304


def test_tilejson_of_both_collections(reading: Any) -> None:
    for layer, lowest in (("segments", 6), ("ways", 10)):
        answer = get(reading, f"/collections/{layer}/tiles/WebMercatorQuad?f=tilejson")
        assert (answer["tilejson"], answer["minzoom"], answer["maxzoom"]) == ("3.0.0", lowest, 18)
        assert [one["id"] for one in answer["vector_layers"]] == [layer]
        address = answer["tiles"][0].format(z=13, x=4287, y=2813).removeprefix(reading.base)
        assert reading.client.get(address).status_code == (204 if layer == "ways" else 200)
        assert "openstreetmap.org/copyright" in answer["attribution"]
    assert get(reading, "/tiles/WebMercatorQuad?f=tilejson") == get(reading, "/tiles.json")
