"""The set of elevation rasters changes beside the service: priorities, removals, and what is cut off."""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine
from sqlalchemy import text

from app.core.db import Sessions
from app.drives.worker import HeightFiller
from app.map import store as map_store
from app.network.locks import own_network, share_network, try_share_network
from app.roads import imports as roads
from app.roads.documents import USUAL, Source
from app.terrain import coverage, files, heights, imports
from app.terrain.store import DemSource, current_dem, pending_heights
from fusion.errors import TerrainError
from fusion.roads.table import RoadTable
from road_support import replace_roads

POST_DEG = 1 / 1200


def plane(path: Path, west: float, east: float, rise_m: float, datum: int = 4326) -> Path:
    """A raster around 49 N that rises by ``rise_m`` a post towards the east."""
    columns = round((east - west) / POST_DEG)
    z = np.tile(100 + rise_m * np.arange(columns, dtype=np.float32), (24, 1))
    with rasterio.open(
        path, "w", driver="GTiff", width=columns, height=24, count=1, dtype="float32", crs=f"EPSG:{datum}",
        transform=Affine(POST_DEG, 0, west, 0, -POST_DEG, 49.01), nodata=-9999,
    ) as raster:  # fmt: skip
        raster.write(z, 1)
    return path


@pytest.fixture
def chain_in_db(sessions: Sessions, chain: Callable[..., RoadTable]) -> RoadTable:
    """Ten segments from 8.500 to 8.510 E at 49 N."""
    with sessions.begin() as session:
        replace_roads(session, chain(), "x", "0" * 64)
    return chain()


def grades(sessions: Sessions, table: RoadTable) -> list[float | None]:
    """Of each segment the rise of the elevation model over a post's width, m: ``plane``'s ``rise_m``."""
    over_post_m = 100 / (POST_DEG / 0.001 * float(table.length_m[0]))
    with sessions() as session:
        slopes = [row.dem_slope_percent for row in map_store.all_segments(session)]
    return [None if slope is None else round(slope / over_post_m, 2) for slope in slopes]


def stored_heights(sessions: Sessions) -> list[list[float] | None]:
    with sessions() as session:
        return list(session.execute(text("SELECT dem_heights_m FROM segments ORDER BY id")).scalars())


@pytest.fixture
def dem_dir(tmp_path: Path) -> Path:
    return tmp_path / "dem"


@pytest.fixture
def two(sessions: Sessions, chain_in_db: RoadTable, tmp_path: Path, dem_dir: Path) -> None:
    """A raster that rises by 1 m a post under all ten segments, and later one by 2 m under the last five."""
    imports.import_dem(sessions, [plane(tmp_path / "wide.tif", 8.49, 8.52, 1.0)], dem_dir)
    imports.import_dem(sessions, [plane(tmp_path / "east.tif", 8.5042, 8.52, 2.0)], dem_dir)


@pytest.mark.usefixtures("two")
def test_the_first_of_one_resolution_counts_and_the_highest_priority_everywhere(
    sessions: Sessions, chain_in_db: RoadTable, tmp_path: Path, dem_dir: Path
) -> None:
    assert grades(sessions, chain_in_db) == [1.0] * 10
    imports.rank_dem(sessions, "EAST.tif", 3, dem_dir)
    assert grades(sessions, chain_in_db) == [1.0] * 5 + [2.0] * 5
    imports.rank_dem(sessions, "wide.tif", 3, dem_dir)
    assert grades(sessions, chain_in_db) == [1.0] * 10
    with sessions() as session:
        active = current_dem(session, dem_dir)
    assert active is not None
    assert active.priorities == (3, 3)
    again = imports.import_dem(sessions, [tmp_path / "east.tif"], dem_dir)
    assert again.version_id == active.version_id, (
        "a raster that is there keeps its priority and changes nothing"
    )
    higher = imports.import_dem(sessions, [tmp_path / "east.tif"], dem_dir, priority=4)
    assert higher.version_id > active.version_id
    assert grades(sessions, chain_in_db) == [1.0] * 5 + [2.0] * 5
    plane(tmp_path / "east.tif", 8.5042, 8.52, 5.0)
    replaced = imports.import_dem(sessions, [tmp_path / "east.tif"], dem_dir)
    assert dict(zip(replaced.names, replaced.priorities, strict=True)) == {"wide.tif": 3, "east.tif": 4}
    assert grades(sessions, chain_in_db) == [1.0] * 5 + [5.0] * 5


@pytest.mark.usefixtures("two")
def test_what_is_left_renews_the_heights_of_a_removed_raster(
    sessions: Sessions, chain_in_db: RoadTable, dem_dir: Path
) -> None:
    imports.rank_dem(sessions, "east.tif", 1, dem_dir)
    found = imports.remove_dem(sessions, ["East.tif"], dem_dir)
    assert found is not None
    assert found.names == ("wide.tif",)
    assert grades(sessions, chain_in_db) == [1.0] * 10
    assert imports.remove_dem(sessions, ["wide.tif"], dem_dir) is None
    assert grades(sessions, chain_in_db) == [None] * 10
    assert stored_heights(sessions) == [None] * 10
    with sessions() as session:
        assert current_dem(session, dem_dir) is None
        assert pending_heights(session) is None
    with pytest.raises(TerrainError, match=r"no elevation raster wide\.tif"):
        imports.remove_dem(sessions, ["wide.tif"], dem_dir)


@pytest.mark.usefixtures("two")
def test_roads_come_in_after_the_last_raster_has_gone(
    sessions: Sessions, chain: Callable[..., RoadTable], dem_dir: Path
) -> None:
    imports.remove_dem(sessions, ["east.tif", "wide.tif"], dem_dir)
    source = Source("north", "1" * 64, "north")
    assert roads.bring_in(sessions, chain(lat=49.5, way=9), source, dem_dir, USUAL).added == 10


def test_a_change_that_is_cut_off_is_gone_on_with(
    sessions: Sessions, chain_in_db: RoadTable, tmp_path: Path, dem_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a worker, or with the next change; each piece is written by itself."""
    monkeypatch.setattr(heights, "SEGMENTS_PER_FILL", 3)
    seen: list[int] = []

    def killed(stage: str, _share: float) -> None:
        if stage == "heights":
            seen.append(grades(sessions, chain_in_db).count(1.0))
            if len(seen) == 2:
                raise KeyboardInterrupt

    wide = plane(tmp_path / "wide.tif", 8.49, 8.52, 1.0)
    with pytest.raises(KeyboardInterrupt):
        imports.import_dem(sessions, [wide], dem_dir, killed)
    assert seen == [3, 6]
    with sessions() as session:
        left = pending_heights(session)
    assert left is not None
    filler = HeightFiller(sessions, dem_dir)
    assert [filler.piece(), filler.piece(), filler.piece()] == [True, True, False]
    assert grades(sessions, chain_in_db) == [1.0] * 10
    with sessions() as session:
        assert pending_heights(session) is None

    seen.clear()
    with pytest.raises(KeyboardInterrupt):
        imports.remove_dem(sessions, ["wide.tif"], dem_dir, killed)
    imports.import_dem(sessions, [plane(tmp_path / "far.tif", 20.0, 20.02, 1.0)], dem_dir)
    assert grades(sessions, chain_in_db) == [None] * 10


def test_drives_wait_for_a_piece_at_most(
    sessions: Sessions, chain_in_db: RoadTable, tmp_path: Path, dem_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is computed while the network is owned, and between two pieces it is everybody's."""
    monkeypatch.setattr(heights, "SEGMENTS_PER_FILL", 4)
    computing, between = [], []
    terrain_under = heights.terrain_under

    def watched(*arguments: object) -> object:
        with sessions.begin() as session:
            computing.append(try_share_network(session))
        return terrain_under(*arguments)  # type: ignore[arg-type]

    def progress(stage: str, _share: float) -> None:
        with sessions.begin() as session:
            between.append(try_share_network(session))

    monkeypatch.setattr(heights, "terrain_under", watched)
    imports.import_dem(sessions, [plane(tmp_path / "a.tif", 8.49, 8.52, 1.0)], dem_dir, progress)
    assert computing == [True] * 3
    assert between
    assert all(between)


def test_two_changes_at_once_both_count(
    sessions: Sessions, chain_in_db: RoadTable, tmp_path: Path, dem_dir: Path
) -> None:
    west, east = plane(tmp_path / "w.tif", 8.49, 8.506, 1.0), plane(tmp_path / "e.tif", 8.5042, 8.52, 2.0)
    with sessions.begin() as session:
        share_network(session)  # both have read the set of before when the first may switch
        threads = [
            threading.Thread(target=imports.import_dem, args=(sessions, [path], dem_dir))
            for path in (west, east)
        ]
        for thread in threads:
            thread.start()
        time.sleep(0.3)
    for thread in threads:
        thread.join()
    with sessions() as session:
        active = current_dem(session, dem_dir)
        assert pending_heights(session) is None
    assert active is not None
    assert sorted(active.names) == ["e.tif", "w.tif"]
    assert None not in grades(sessions, chain_in_db)


def test_roads_that_come_meanwhile_have_the_heights_of_the_new_set(
    sessions: Sessions, chain: Callable[..., RoadTable], tmp_path: Path, dem_dir: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    with sessions.begin() as session:
        replace_roads(session, chain(), "x", "0" * 64)
    terrain_under = heights.terrain_under
    others = chain(4, lon=8.512, way=9)

    def roads_change(*arguments: object) -> object:
        monkeypatch.setattr(heights, "terrain_under", terrain_under)
        with sessions.begin() as session:
            own_network(session)
            replace_roads(session, others, "y", "1" * 64)
        return terrain_under(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(heights, "terrain_under", roads_change)
    imports.import_dem(sessions, [plane(tmp_path / "a.tif", 8.49, 8.53, 1.0)], dem_dir)
    assert grades(sessions, others) == [1.0] * 4


@pytest.mark.usefixtures("two")
def test_rasters_of_before_bounds_were_kept_get_them(sessions: Sessions, dem_dir: Path) -> None:
    with sessions() as session:
        active = current_dem(session, dem_dir)
    assert active is not None
    known = [source.bounds_deg for source in active.sources]
    assert known[0] == pytest.approx((8.49, 48.99, 8.52, 49.01), abs=1e-3)
    with sessions.begin() as session:
        for version, sources in session.execute(text("SELECT id, sources FROM dem_versions")).all():
            old = [{name: s[name] for name in ("name", "uri", "sha256")} for s in sources]
            session.execute(
                text("UPDATE dem_versions SET sources = CAST(:s AS jsonb) WHERE id = :v"),
                {"s": json.dumps(old), "v": version},
            )
    with sessions() as session:
        former = current_dem(session, dem_dir)
        assert former == active
        assert former is not None
        assert [source.bounds_deg for source in former.sources] == [None, None]
        assert coverage.rasters_over(session, former, bbox=(8.5, 48.9, 8.501, 49.1)) == active.names
    assert files.add_bounds(sessions, dem_dir) == 2
    assert files.add_bounds(sessions, dem_dir) == 0
    with sessions() as session:
        filled = current_dem(session, dem_dir)
    assert filled is not None
    assert [source.bounds_deg for source in filled.sources] == known
    (dem_dir / filled.sources[0].uri).unlink()
    assert (
        files.with_bounds([DemSource("wide.tif", filled.sources[0].uri, "")], dem_dir)[0].bounds_deg is None
    )


@pytest.mark.usefixtures("two")
def test_rasters_are_credited_where_they_lie_under_something(
    sessions: Sessions, tmp_path: Path, dem_dir: Path
) -> None:
    active = imports.import_dem(sessions, [plane(tmp_path / "far.tif", 20.0, 20.02, 1.0)], dem_dir)
    assert active.names == ("wide.tif", "east.tif", "far.tif")
    with sessions() as session:
        assert coverage.rasters_over(session, active) == ("wide.tif", "east.tif")
        assert coverage.rasters_over(session, active, bbox=(8.5, 48.9, 8.503, 49.1)) == ("wide.tif",)
        assert coverage.rasters_over(session, active, bbox=(30, 48.9, 31, 49.1)) == ()
        assert coverage.rasters_over(session, active, driven=True) == ()
        assert coverage.rasters_over(session, None) == ()
        assert coverage.segments_under(session, active.sources) == [10, 6, 0]
        effect = coverage.effect_of_removal(session, active.sources[:2], active.sources[2:])
    assert (effect.segments, effect.measured, effect.bare, effect.drives) == (10, 0, 0, 0)
    assert coverage.names_over(active, [(8.5, 49.0, 8.501, 49.0)]) == ("wide.tif",)
    assert coverage.names_over(active, []) == ()


@pytest.mark.usefixtures("two")
def test_files_go_when_no_set_has_named_them_for_long(sessions: Sessions, dem_dir: Path) -> None:
    with sessions() as session:
        active = current_dem(session, dem_dir)
    assert active is not None
    imports.remove_dem(sessions, ["east.tif"], dem_dir)
    week, none = timedelta(days=7), timedelta(0)
    assert files.sweep_rasters(sessions, dem_dir, week) == []
    assert all(path.is_file() for path in active.paths)
    with sessions.begin() as session:
        session.execute(text("UPDATE dem_versions SET imported_at = imported_at - interval '8 days'"))
    assert files.sweep_rasters(sessions, dem_dir, week) == [], "the file itself came later than that"
    for path in active.paths:
        os.utime(path, (0, 0))
    assert files.sweep_rasters(sessions, dem_dir, week) == [active.sources[1].uri]
    assert [path.is_file() for path in active.paths] == [True, False]
    assert not active.paths[1].parent.exists()
    assert files.sweep_rasters(sessions, dem_dir, none) == []


@pytest.mark.usefixtures("two")
def test_what_is_said_of_a_raster_s_source_credits_it(
    sessions: Sessions, tmp_path: Path, dem_dir: Path
) -> None:
    def stored(name: str) -> list[DemSource]:
        return files.store_files([tmp_path / name], dem_dir)

    said = {"source": "Survey of Nowhere", "licence": "CC BY 4.0"}
    first = imports.add_dem(sessions, stored("wide.tif"), dem_dir, **said)
    named = {source.name: source.credit for source in first.sources}
    assert named == {"wide.tif": "Survey of Nowhere (CC BY 4.0)", "east.tif": "east.tif"}
    with sessions() as session:
        assert pending_heights(session) is None
        assert current_dem(session, dem_dir) == first
        assert set(coverage.rasters_over(session, first)) == {"wide.tif", "east.tif"}
    assert coverage.names_over(first, [(8.5, 49.0, 8.501, 49.0)]) == ("Survey of Nowhere (CC BY 4.0)",)
    # The same once more, and one of other heights in its place, keep what was said.
    again = imports.add_dem(sessions, stored("wide.tif"), dem_dir)
    assert again.version_id == first.version_id
    plane(tmp_path / "wide.tif", 8.49, 8.52, 2.0)
    other = imports.add_dem(sessions, stored("wide.tif"), dem_dir, licence="ODbL")
    assert {source.credit for source in other.sources} == {"Survey of Nowhere (ODbL)", "east.tif"}
