"""Regions and rasters over HTTP: what the lists say of each, and of a map that is too large to be looked at."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import text

from app.map import figures
from app.operations import sources
from app.roads.documents import Source, Wishes
from app.roads.imports import bring_in
from app.terrain.imports import import_dem
from fusion.simulate.scene.town import Town
from fusion.simulate.write.dem_file import write_dem
from web_fixtures import Web, add_drive, grid_roads


def test_an_empty_service_has_neither(web: Web) -> None:
    assert web.client.get("/v1/regions").json()["regions"] == []
    rasters = web.client.get("/v1/rasters").json()
    assert (rasters["rasters"], rasters["datum"]) == ([], None)


def test_each_region_says_where_it_lies_and_how_much_of_it_was_driven(
    filled: Web, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    part = grid_roads().subset(np.arange(7))
    bring_in(filled.sessions, part, Source("part.osm", "1" * 64, "part"), tmp_path, Wishes())
    add_drive(filled.sessions, [5, 6, 7])
    document = filled.client.get("/v1/regions").json()
    assert document["measured_at"] is None
    found = {one["name"]: one for one in document["regions"]}
    assert list(found) == ["part", "roads"]
    assert [(one["segments"], one["measured"]) for one in found.values()] == [(7, 2), (115, 3)]
    assert found["part"]["bbox"] == pytest.approx(list(part.bounds_deg()))
    assert found["part"]["source_name"] == "part.osm"
    assert found["part"]["imported_at"].endswith("Z")
    monkeypatch.setattr(sources, "FEW_SEGMENTS", 10)
    while figures.renew_one(filled.sessions):
        pass
    document = filled.client.get("/v1/regions").json()
    assert [one["measured"] for one in document["regions"]] == [2, 3]
    assert document["measured_at"].endswith("Z")


def test_a_region_of_before_bounds_were_kept_has_none(filled: Web) -> None:
    with filled.sessions.begin() as session:
        session.execute(text("UPDATE regions SET bounds = NULL"))
    assert filled.client.get("/v1/regions").json()["regions"][0]["bbox"] is None


def test_each_raster_says_what_is_known_of_it(web: Web, town: Town, tmp_path: Path) -> None:
    write_dem(town, tmp_path / "town.tif")
    import_dem(web.sessions, [tmp_path / "town.tif"], web.settings.dem_dir, priority=3)
    first = raster_of(web)
    assert (first["name"], first["priority"], first["with_quality"]) == ("town.tif", 3, False)
    assert 1 < first["resolution_m"] < 100
    west, south, east, north = first["bbox"]
    assert west < east
    assert south < north
    with web.sessions.begin() as session:  # as versions before kept them
        session.execute(
            text("UPDATE dem_versions SET sources = jsonb_build_array(sources -> 0 #- '{posting_m}')")
        )
    assert raster_of(web) == first | {"resolution_m": None}


def raster_of(web: Web) -> dict[str, Any]:
    document = web.client.get("/v1/rasters").json()
    assert document["datum"]
    (one,) = document["rasters"]
    found: dict[str, Any] = one
    return found
