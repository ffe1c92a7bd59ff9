"""Tiles of names: what an import brings, at which zooms, and that they follow imports."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import osmium
import pytest
from osmium.osm.mutable import Node, Way
from sqlalchemy import text

from app.map.tiles.store import column_of, row_of
from app.roads.documents import Wishes
from app.roads.imports import import_roads, remove_region
from mvt_support import layers
from problem_support import check
from web_fixtures import Web

LON, LAT = 8.69, 49.41
STEP = 0.001


def drawn(file: Path, kind: str = "village", *, river: bool = True) -> Path:
    """Two streets, one of them long and numbered, a place and a river; and a hamlet far away."""
    with osmium.SimpleWriter(str(file)) as writer:
        for n in range(8):
            writer.add_node(Node(id=1 + n, location=(LON + n * STEP, LAT), version=1))
        writer.add_node(Node(id=20, location=(LON, LAT + STEP), version=1))
        place = {"place": kind, "name": "Łódź", "population": "1500"}
        writer.add_node(Node(id=21, location=(LON + STEP, LAT), tags=place, version=1))
        far = {"place": "hamlet", "name": "Far"}
        writer.add_node(Node(id=22, location=(LON + 3, LAT), tags=far, version=1))
        primary = {"highway": "primary", "name": "Große Straße", "ref": "B 37"}
        writer.add_way(Way(id=30, nodes=[1, 2, 3, 4], tags=primary, version=1))
        writer.add_way(Way(id=31, nodes=[4, 5, 6, 7, 8], tags=primary, version=1))
        lane = {"highway": "residential", "name": "Gässchen"}
        writer.add_way(Way(id=32, nodes=[1, 20], tags=lane, version=1))
        if river:
            water = {"waterway": "river", "name": "Neckar"}
            writer.add_way(Way(id=33, nodes=[20, 4, 8], tags=water, version=1))
    return file


@pytest.fixture
def bring(web: Web, tmp_path: Path) -> Callable[..., None]:
    """Imports such a file as a region."""

    def bring_in(region: str = "here", **wanted: Any) -> None:
        file = tmp_path / "town.osm"
        file.unlink(missing_ok=True)
        wishes = Wishes(accept_losses=True)
        import_roads(web.sessions, drawn(file, **wanted), tmp_path / "dem", region=region, wishes=wishes)

    return bring_in


def tile(web: Web, z: int, lon: float = LON + STEP) -> dict[str, list[dict[str, Any]]]:
    answer = web.client.get(f"/names/{z}/{column_of(z, lon)}/{row_of(z, LAT)}.mvt")
    assert answer.status_code in (200, 204)
    return layers(answer.content) if answer.content else {}


def said(web: Web, z: int) -> dict[str, list[Any]]:
    """Layer -> the properties of its features."""
    return {layer: [one["properties"] for one in found] for layer, found in tile(web, z).items()}


def rows(web: Web) -> list[tuple[str, int, int]]:
    with web.sessions() as session:
        query = "SELECT layer, osm_id, cardinality(regions) FROM map_names ORDER BY layer, osm_id"
        return [tuple(row) for row in session.execute(text(query))]


def test_names_stand_at_their_zooms(web: Web, bring: Callable[..., None]) -> None:
    bring()
    place = {"name": "Łódź", "kind": "village", "population": 1500}
    river = {"name": "Neckar", "kind": "river"}
    number = {"ref": "B 37", "kind": "primary"}
    large, lane = {"name": "Große Straße", "rank": 0}, {"name": "Gässchen", "rank": 2}
    assert said(web, 8) == {}
    assert said(web, 9) == {"water": [river]}
    assert said(web, 10) == {"places": [place], "water": [river]}
    assert said(web, 12) == {"places": [place], "water": [river], "roads": [number]}
    assert said(web, 13) == {"places": [place], "water": [river], "roads": [number], "streets": [large]}
    assert said(web, 14)["streets"] == [large, lane]
    # Both ways are one line, and a place is where it is.
    found = tile(web, 14)
    (road,) = found["roads"]
    assert len(road["path"]) == 2, "what is straight has no points between"
    assert road["path"][1][0] - road["path"][0][0] == pytest.approx(7 * STEP / 360 * 2**14 * 4096, abs=2)
    (point,) = found["places"][0]["path"]
    x = (column_of(14, LON + STEP) + point[0] / 4096) / 2**14 * 360 - 180
    assert x == pytest.approx(LON + STEP, abs=1e-5)
    assert set(tile(web, 12, LON + 3)["places"][0]["properties"].values()) == {"Far", "hamlet"}


def test_a_tile_is_known_by_the_import_that_made_it(web: Web, bring: Callable[..., None]) -> None:
    bring()
    address = f"/names/14/{column_of(14, LON)}/{row_of(14, LAT)}.mvt"
    first = web.client.get(address)
    assert first.headers["content-encoding"] == "gzip"
    plain = web.client.get(address, headers={"Accept-Encoding": "identity"})
    assert "content-encoding" not in plain.headers
    assert plain.content == first.content
    etag = first.headers["etag"]
    assert web.client.get(address, headers={"If-None-Match": etag}).status_code == 304
    bring(kind="town")
    again = web.client.get(address, headers={"If-None-Match": etag})
    assert again.status_code == 200
    assert layers(again.content)["places"][0]["properties"]["kind"] == "town"
    assert said(web, 8) == {"places": [{"name": "Łódź", "kind": "town", "population": 1500}]}


def test_regions_share_names_and_take_their_own_with_them(
    web: Web, bring: Callable[..., None], tmp_path: Path
) -> None:
    bring()
    once = [("places", 21, 1), ("places", 22, 1), ("roads", 30, 1), ("roads", 31, 1), ("water", 33, 1)]
    assert rows(web) == once
    bring()
    assert rows(web) == once
    bring("there", river=False)
    twice = [(layer, osm_id, 1 + (layer != "water")) for layer, osm_id, _ in once]
    assert rows(web) == twice
    assert len(tile(web, 14)["places"]) == 1
    bring(river=False)
    assert rows(web) == [row for row in twice if row[0] != "water"]
    wishes = Wishes(accept_losses=True)
    remove_region(web.sessions, "here", tmp_path / "dem", wishes=wishes)
    assert rows(web) == [row for row in once if row[0] != "water"]
    remove_region(web.sessions, "there", tmp_path / "dem", wishes=wishes)
    assert rows(web) == []
    assert said(web, 14) == {}


def test_the_tilejson_names_every_layer(web: Web, bring: Callable[..., None]) -> None:
    assert "bounds" not in web.client.get("/names.json").json()
    bring()
    document = web.client.get("/names.json").json()
    assert document["tiles"] == [f"{web.base}/names/{{z}}/{{x}}/{{y}}.mvt"]
    west, south, east, north = document["bounds"]
    assert west <= LON <= east
    assert south <= LAT <= north
    of = {layer["id"]: layer for layer in document["vector_layers"]}
    for z in range(document["maxzoom"] + 1):
        for layer, features in tile(web, z).items():
            assert of[layer]["minzoom"] <= z
            assert {key for one in features for key in one["properties"]} <= set(of[layer]["fields"])


def test_tiles_that_cannot_be_are_refused(web: Web) -> None:
    assert check(web.client.get("/names/14/16384/1.mvt"), 404)["errors"][0]["field"] == "x"
    assert "enlarge" in check(web.client.get("/names/15/1/1.mvt"), 404)["detail"]
