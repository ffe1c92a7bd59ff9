"""Tiles: what is in them, what caches are told, which addresses exist."""

from __future__ import annotations

import json
import math
import tracemalloc
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from app.core.settings import Settings
from app.core.text import geojson_text
from mvt_support import EXTENT, layers
from processing_support import carry_out_removals
from web_fixtures import fill_roads


def tile_of(lon: float, lat: float, z: int) -> tuple[int, int]:
    """The slippy-map formula, independent of PostGIS."""
    x = (lon + 180) / 360 * 2**z
    y = (1 - math.asinh(math.tan(math.radians(lat))) / math.pi) / 2 * 2**z
    return int(x), int(y)


# --- contents -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def items(reading: Any) -> dict[int, dict[str, Any]]:
    found: dict[int, dict[str, Any]] = {}
    address = "/collections/segments/items?limit=50"
    while address:
        page = reading.client.get(address).json()
        found |= {f["id"]: f for f in page["features"]}
        address = next((link["href"] for link in page["links"] if link["rel"] == "next"), "")
    return found


@pytest.mark.parametrize("z", [13, 15, 17])
def test_vector_tiles_hold_the_items_in_place(reading: Any, items: dict[int, dict[str, Any]], z: int) -> None:
    corner = tile_of(8.407, 49.007, z)
    answer = reading.client.get(f"/tiles/{z}/{corner[0]}/{corner[1]}.mvt")
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "application/vnd.mapbox-vector-tile"
    features = layers(answer.content)["segments"]
    assert features
    for feature in features:
        item = items[feature["id"]]["properties"]
        known = {"slope_percent", "slope_sigma_percent"} if item["drives"] else set()
        rare = {name for name in ("bridge", "tunnel") if item[name]}
        modelled = {"dem_slope_percent"} if item["dem_slope_percent"] is not None else set()
        assert set(feature["properties"]) == {"drives", "highway", "oneway"} | known | rare | modelled
        for name, value in feature["properties"].items():
            digits = {"dem_slope_percent": 0.05}.get(name, 1e-4)
            assert value == (
                pytest.approx(item[name], abs=digits) if name in known | modelled else item[name]
            )
        if all(0 < x < EXTENT and 0 < y < EXTENT for x, y in feature["path"]):
            lon, lat = items[feature["id"]]["geometry"]["coordinates"][0]
            x, y = (EXTENT * (u - v) for u, v in zip(fractional_tile(lon, lat, z), corner, strict=True))
            assert feature["path"][0] == (pytest.approx(x, abs=1), pytest.approx(y, abs=1))


def fractional_tile(lon: float, lat: float, z: int) -> tuple[float, float]:
    y = (1 - math.asinh(math.tan(math.radians(lat))) / math.pi) / 2
    return (lon + 180) / 360 * 2**z, y * 2**z


def test_both_kinds_of_tiles_hold_the_same_segments(reading: Any) -> None:
    x, y = tile_of(8.407, 49.007, 13)
    vector = layers(reading.client.get(f"/tiles/13/{x}/{y}.mvt").content)["segments"]
    plain = reading.client.get(f"/tiles/13/{x}/{y}.geojson")
    assert plain.headers["content-type"] == "application/geo+json"
    inside = {f["id"] for f in vector if any(0 <= px <= EXTENT and 0 <= py <= EXTENT for px, py in f["path"])}
    assert {f["id"] for f in plain.json()["features"]} == inside


def test_geojson_features_of_tiles_are_the_items(reading: Any, items: dict[int, dict[str, Any]]) -> None:
    x, y = tile_of(8.407, 49.007, 13)
    for feature in reading.client.get(f"/tiles/13/{x}/{y}.geojson").json()["features"]:
        assert feature == items[feature["id"]]


def test_pages_of_a_geojson_tile_reach_each_segment_once(
    settings: Settings, server_maker: Callable[..., Any]
) -> None:
    x, y = tile_of(8.407, 49.007, 12)
    path = f"/tiles/12/{x}/{y}.geojson"
    with server_maker(settings) as web:
        fill_roads(web.sessions)
        whole = web.client.get(path).json()
        assert [link["rel"] for link in whole["links"]] == ["self"]
    found, address, pages = [], path, 0
    with server_maker(settings.model_copy(update={"tile_features_max": 7})) as web:
        while address:
            answer = web.client.get(address)
            page = answer.json()
            assert page["numberReturned"] == len(page["features"]) <= 7
            (self_link,) = [link["href"] for link in page["links"] if link["rel"] == "self"]
            assert web.client.get(self_link).content == answer.content
            following = [link for link in page["links"] if link["rel"] == "next"]
            assert all("more than these 7 segments" in link["title"] for link in following)
            found, pages = found + page["features"], pages + 1
            address = following[0]["href"] if following else ""
    assert found == whole["features"]
    assert len(found) > 14
    assert pages == math.ceil(len(found) / 7)


def test_a_large_answer_is_not_held_a_second_time_as_objects() -> None:
    features = [{"type": "Feature", "properties": {"name": "x" * 100, "k": k}} for k in range(10)]

    def many() -> Iterator[dict[str, Any]]:
        for k in range(20_000):
            yield {**features[k % 10], "id": k}

    def peak(make: Callable[[], bytes]) -> tuple[int, int]:
        tracemalloc.start()
        size = len(make())
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return size, most

    size, most = peak(lambda: geojson_text({"type": "FeatureCollection", "features": many()}))
    assert most < 3 * size
    held = {"type": "FeatureCollection", "features": list(many())}
    assert json.loads(geojson_text(held)) == held


def test_a_tile_of_nothing(reading: Any) -> None:
    empty = reading.client.get("/tiles/14/0/0.mvt")
    assert empty.status_code == 204
    assert not empty.content
    assert empty.headers["etag"]
    assert reading.client.get("/tiles/14/0/0.geojson").json()["features"] == []
    assert reading.client.get("/tiles/2/2/1.mvt").status_code == 204, "further out than tile_min_zoom"


@pytest.mark.parametrize(
    ("path", "field"),
    [
        ("/tiles/3/8/0.mvt", "x"),
        ("/tiles/3/0/8.mvt", "y"),
        ("/tiles/19/0/0.mvt", "z"),
        ("/tiles/31/0/0.geojson", "z"),
        ("/tiles/-1/0/0.mvt", "z"),
        ("/tiles/3/0/-1.mvt", "y"),
        ("/tiles/a/0/0.mvt", "z"),
        ("/tiles/3/0.5/0.geojson", "x"),
        ("/tiles/3/99999999999999999999999/0.mvt", "x"),
    ],
)
def test_tiles_that_do_not_exist(reading: Any, path: str, field: str) -> None:
    answer = reading.client.get(path)
    assert answer.status_code == 404
    assert answer.json()["errors"][0]["field"] == field


# --- caching ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", ["mvt", "geojson"])
def test_a_tile_is_304_until_the_data_change(
    filled: Any, drive_maker: Callable[..., Any], suffix: str
) -> None:
    x, y = tile_of(8.407, 49.007, 13)
    path = f"/tiles/13/{x}/{y}.{suffix}"
    first = filled.client.get(path)
    seen = {"If-None-Match": f'"other", {first.headers["etag"]}'}
    unchanged = filled.client.get(path, headers=seen)
    assert (unchanged.status_code, unchanged.content) == (304, b"")
    assert unchanged.headers["etag"] == first.headers["etag"]
    assert "no-cache" in unchanged.headers["cache-control"]

    drive = drive_maker(filled.sessions, [0, 1])
    changed = filled.client.get(path, headers=seen)
    assert changed.status_code == 200
    assert changed.headers["etag"] != first.headers["etag"]
    assert changed.content != first.content

    assert filled.client.delete(f"/v1/drives/{drive}").status_code == 202
    carry_out_removals(filled.sessions, filled.blobs)
    after = filled.client.get(path, headers={"If-None-Match": changed.headers["etag"]})
    assert after.status_code == 200
    assert after.content == first.content, "the drive's influence has left the tile"


def test_tilejson(reading: Any) -> None:
    answer = reading.client.get("/tiles.json")
    document = answer.json()
    assert document["tilejson"] == "3.0.0"
    assert document["tiles"] == [f"{reading.base}/tiles/{{z}}/{{x}}/{{y}}.mvt"]
    assert document["minzoom"] <= document["maxzoom"]
    west, south, east, north = document["bounds"]
    lon, lat, zoom = document["center"]
    assert west <= lon <= east
    assert south <= lat <= north
    assert document["minzoom"] <= zoom <= document["maxzoom"]
    assert "openstreetmap.org/copyright" in document["attribution"]
    (layer,) = document["vector_layers"]
    x, y = tile_of(8.407, 49.007, 13)
    found = layers(reading.client.get(f"/tiles/13/{x}/{y}.mvt").content)
    assert list(found) == [layer["id"]]
    named = {name for f in found[layer["id"]] for name in f["properties"]}
    assert named == {*layer["fields"]} - {"tunnel"}, "the grid has no tunnel"


def test_large_answers_are_compressed_and_say_so(reading: Any) -> None:
    x, y = tile_of(8.407, 49.007, 13)
    answer = reading.client.get(f"/tiles/13/{x}/{y}.geojson", headers={"Accept-Encoding": "gzip"})
    assert answer.headers["content-encoding"] == "gzip"
    assert "accept-encoding" in answer.headers["vary"].lower()
    plain = reading.client.get(f"/tiles/13/{x}/{y}.geojson", headers={"Accept-Encoding": "identity"})
    assert plain.json() == answer.json()
