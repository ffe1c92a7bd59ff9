"""What is drawn from afar: its levels, the room that a tile has, and that it is not empty where there are roads."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from sqlalchemy import text

from app.core import databases
from app.core.db import Sessions, make_engine, session_factory
from app.embedded.cluster import EmbeddedPostgres
from app.map.tiles import store, tiles
from app.map.tiles.store import SEGMENTS, Address
from app.map.tiles.tiles import Tiles
from mvt_support import layers
from tiles_support import processes, run

# One piece a level with the level as its id, all in the tiles over 8.4 E, 49 N; and a crowd at level 10.
PIECES = text(
    """
    INSERT INTO drawn_pieces (level, cell, segment_id, rank, highway, oneway, drives, length_m, slope_percent,
        geom_3857)
    SELECT level, 0, level, 3, 'primary', 0, 0, 5000, NULL,
        ST_Transform(ST_SetSRID(ST_MakeLine(ST_Point(8.41, 49.01), ST_Point(8.47, 49.05)), 4326), 3857)
    FROM unnest(ARRAY[12, 10, 8, 6]) AS level
    UNION ALL
    SELECT 10, 1, 1000 + k, CASE WHEN k % 3 = 0 THEN 2 ELSE 5 END, 'r' || k, 0, k % 2, 100 + k, sin(k),
        ST_Transform(ST_SetSRID(ST_MakeLine(
            ST_Point(12.0 + 0.3 * sin(k), 49.0 + 0.2 * cos(k * 1.7)),
            ST_Point(12.0 + 0.3 * cos(k * 1.3), 49.0 + 0.2 * sin(k * 0.9))), 4326), 3857)
    FROM generate_series(1, 3000) AS k
    UNION ALL
    SELECT 6, 2, 5000 + k, k, 'primary', 0, 0, 20, NULL,
        ST_Transform(ST_SetSRID(ST_MakeLine(
            ST_Point(20.001, 49.0 + k * 0.01), ST_Point(20.0011, 49.0 + k * 0.01)), 4326), 3857)
    FROM generate_series(1, 3) AS k
    """
)


@pytest.fixture(scope="module")
def url(cluster: EmbeddedPostgres, template_db: str, new_database: Callable[[str], str]) -> Iterator[str]:
    name = new_database(template_db)
    engine = make_engine(cluster.url_of(name))
    with session_factory(engine).begin() as session:
        session.execute(PIECES)
    engine.dispose()
    yield cluster.url_of(name)
    databases.drop_database(cluster.url, name)


@pytest.fixture
def factory(url: str) -> Iterator[Sessions]:
    engine = make_engine(url)
    yield session_factory(engine)
    engine.dispose()


def over(lon: float, row: float, z: int) -> Address:
    return Address(SEGMENTS, z, int((lon + 180) / 360 * 2**z), int(row / 2**14 * 2**z))


HERE, CROWD, SPECKS = (8.42, 5625.5), (12.0, 5625.5), (20.001, 5625.5)


def fetched(url: str, at: Address, **settings: Any) -> bytes:
    found: list[bytes] = []

    async def scenario(one: Tiles) -> None:
        found.append((await one.get(at, "some")).body)

    run(processes(url, 1, **settings), scenario)
    return found[0]


@pytest.mark.parametrize(
    ("z", "level"), [(12, 12), (11, 12), (10, 10), (9, 10), (8, 8), (7, 8), (6, 6), (5, 6), (2, 6)]
)
def test_each_level_is_drawn_at_its_zoom_and_the_one_below(factory: Sessions, z: int, level: int) -> None:
    at = over(*HERE, z)
    with factory() as session:
        tile = layers(store.mvt(session, at.z, at.x, at.y))[SEGMENTS]
    assert [one["id"] for one in tile if one["id"] < 100] == [level]


def test_from_the_full_zoom_on_tiles_are_made_of_segments(factory: Sessions) -> None:
    for z, full in ((13, 13), (12, 12), (10, 10)):
        at = over(*HERE, z)
        with factory() as session:
            assert store.mvt(session, at.z, at.x, at.y, full_zoom=full) == b"", "there are no segments"


def test_what_is_least_important_is_left_out_until_the_tile_is_small_enough(
    url: str, factory: Sessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    at = over(*CROWD, 9)
    with factory() as session:
        whole = store.mvt(session, at.z, at.x, at.y)
    every = {one["id"]: one["properties"] for one in layers(whole)[SEGMENTS]}
    size = len(zlib.compress(whole, 1, wbits=31))
    for share in (0.99, 0.5, 0.1):
        monkeypatch.setattr(tiles, "MOST_BYTES", int(share * size))
        with factory.begin() as session:
            session.execute(text("DELETE FROM stored_tiles"))
        body = fetched(url, at)
        assert 0.75 * share * size < len(body) <= share * size
        shown = {one["id"] for one in layers(zlib.decompress(body, wbits=31))[SEGMENTS]}
        assert shown < set(every)

        def importance(k: int) -> tuple[bool, bool, int]:
            return k % 3 != 0, k % 2 == 0, -k

        numbers = sorted((k - 1000 for k in every if k > 1000), key=importance)
        assert [k for k in numbers if k + 1000 in shown] == numbers[: len(shown - {10})]


def test_a_tile_that_is_too_large_by_one_road_alone_has_that(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tiles, "MOST_BYTES", 10)
    body = fetched(url, over(*CROWD, 10))
    assert len(layers(zlib.decompress(body, wbits=31))[SEGMENTS]) == 1


def test_no_tile_over_roads_is_empty(url: str, factory: Sessions) -> None:
    """All roads here are shorter than a unit of the tile."""
    at = over(*SPECKS, 6)
    body = zlib.decompress(fetched(url, at), wbits=31)
    with factory() as session:
        assert store.mvt(session, at.z, at.x, at.y) == body
    (first, *_) = tile = layers(body)[SEGMENTS]
    assert {one["id"] for one in tile} == {5001, 5002, 5003}
    assert len(set(first["path"])) == 2
    assert fetched(url, Address(SEGMENTS, 6, 0, 0)) == b""


def test_further_out_than_the_lowest_zoom_a_tile_is_empty(url: str) -> None:
    assert fetched(url, over(*HERE, 8), tile_min_zoom=9) == b""
    assert fetched(url, over(*HERE, 9), tile_min_zoom=9)
