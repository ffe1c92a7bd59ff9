"""Tiles are built once, kept, and served by every process until something in them changes."""

from __future__ import annotations

import asyncio
import uuid
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from sqlalchemy import text

from app.core.db import Sessions
from app.core.errors import BusyError
from app.map.tiles import store, tiles
from app.map.tiles.store import SEGMENTS, WAYS, Address
from app.map.tiles.tiles import Tile, Tiles
from drawn_support import draw
from fusion.types import Ints
from mvt_support import features
from server_support import sleep_in_loop

HERE = Address(SEGMENTS, 14, 8579, 5626)
FAR = Address(SEGMENTS, 10, 536, 351)
AddDrive = Callable[..., uuid.UUID]


async def answered(process: Tiles, at: Address) -> Tile:
    etag = await process.etag(at)
    assert etag is not None
    return process.at_hand(at, etag) or await process.get(at, etag)


def now(sessions: Sessions, at: Address, full_zoom: int = 13) -> bytes:
    """The tile as the database makes it."""
    with sessions() as session:
        return store.mvt(session, at.z, at.x, at.y, full_zoom=full_zoom, layer=at.layer)


def contents(tile: Tile) -> dict[int, str]:
    return features(zlib.decompress(tile.body, wbits=31) if tile.body else b"")


def kept(sessions: Sessions) -> list[Any]:
    with sessions() as session:
        rows = session.execute(text("SELECT * FROM stored_tiles ORDER BY z, x, y"))
        return list(rows)


def test_a_tile_is_built_once_for_all_processes(
    in_processes: Any, sessions: Sessions, segment_ids: Ints, add_drive: AddDrive
) -> None:
    async def scenario(one: Tiles, other: Tiles) -> None:
        found = await asyncio.gather(*(answered(process, HERE) for process in (one, other) * 10))
        assert len({tile.etag for tile in found}) == 1
        assert len({tile.body for tile in found}) == 1
        assert contents(found[0]) == features(now(sessions, HERE)) != {}
        assert one.built + other.built == 1
        (row,) = kept(sessions)
        assert (row.body, row.size_bytes, row.tag) == (found[0].body, len(found[0].body), found[0].etag)

        add_drive(segment_ids, {8: (2.0, 0.5)})
        after = await answered(other, HERE)
        assert after.etag != found[0].etag
        assert contents(after) == features(now(sessions, HERE))
        assert await answered(one, HERE) == after
        assert one.built + other.built == 2
        assert len(kept(sessions)) == 1

    in_processes(scenario)


def test_a_process_that_starts_builds_nothing_again(
    in_processes: Any, sessions: Sessions, segment_ids: Ints
) -> None:
    found: list[Tile] = []
    built: list[int] = []

    async def scenario(one: Tiles, _: Tiles) -> None:
        found.append(await answered(one, HERE))
        built.append(one.built)

    in_processes(scenario)
    in_processes(scenario)
    in_processes(scenario, tile_full_zoom=14)
    assert built == [1, 0, 1]
    assert found[0] == found[1]
    assert found[2].etag != found[0].etag, "a setting that changes tiles changes their names"


def test_exactly_the_tiles_that_show_a_change_are_new(
    in_processes: Any, sessions: Sessions, segment_ids: Ints, add_drive: AddDrive
) -> None:
    """Of random places and zooms: who has another content has another ETag, and who has the same is not built again."""
    draw(sessions)
    rng = np.random.default_rng(5)
    places = {HERE, FAR}
    for _ in range(40):
        z = int(rng.integers(6, 18))
        x, y = (n * 2.0 ** (z - 14) for n in (8579 + rng.uniform(-1, 2), 5626 + rng.uniform(-1, 2)))
        places.add(Address(SEGMENTS, z, int(x), int(y)))

    async def scenario(one: Tiles, other: Tiles) -> None:
        before = {at: await answered(one, at) for at in places}
        for step in range(2):
            add_drive(segment_ids, {step: (1.0 + step, 0.5)})
            draw(sessions)
            for at in places:
                tile = await answered(other, at)
                assert contents(tile) == features(now(sessions, at)), at
                if contents(tile) != contents(before[at]):
                    assert tile.etag != before[at].etag, at
                x0, x1 = (edge * 2.0 ** (14 - at.z) for edge in (at.x - 1 / 32, at.x + 1 + 1 / 32))
                y0, y1 = (edge * 2.0 ** (14 - at.z) for edge in (at.y - 1 / 32, at.y + 1 + 1 / 32))
                meets = x0 < 8579 and x1 >= 8578 and y0 < 5627 and y1 >= 5626
                assert (tile.etag != before[at].etag) == meets, at
                before[at] = tile

    in_processes(scenario)


def test_what_is_asked_for_often_is_built_before_it_is_asked_for(
    in_processes: Any,
    sessions: Sessions,
    segment_ids: Ints,
    add_drive: AddDrive,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(tiles, "REFRESH_S", 0.02)

    async def scenario(one: Tiles, _: Tiles) -> None:
        for _ in range(tiles.OFTEN):  # type: ignore[assignment]
            one.count(HERE)
        one.count(FAR)
        before = await answered(one, HERE)
        beside = asyncio.create_task(one.run())
        add_drive(segment_ids, {8: (2.0, 0.5)})
        async with asyncio.timeout(10):
            while one.built < 2:
                await asyncio.sleep(0.01)
            while (tile := one.at_hand(HERE, str(await one.etag(HERE)))) is None:
                await asyncio.sleep(0.01)
        assert tile.body != before.body
        assert one.built == 2
        beside.cancel()
        await asyncio.gather(beside, return_exceptions=True)

    in_processes(scenario)


def test_what_nobody_asks_for_goes_when_room_is_short(
    in_processes: Any, sessions: Sessions, segment_ids: Ints
) -> None:
    async def scenario(one: Tiles, _: Tiles) -> None:
        at = [Address(SEGMENTS, 13, HERE.x >> 1, HERE.y >> 1), HERE]
        for one_at in at:
            await answered(one, one_at)
        size = kept(sessions)[1].size_bytes
        one.settings = one.settings.model_copy(update={"tiles_stored_bytes": 10 * size})
        for _ in range(3):  # type: ignore[assignment]
            one.count(at[0])
        await one.note()
        assert [(row.z, row.asked) for row in kept(sessions)] == [(13, 4), (14, 1)]
        one.settings = one.settings.model_copy(update={"tiles_stored_bytes": int(1.5 * size)})
        await one.note()
        assert [row.z for row in kept(sessions)] == [13]

    in_processes(scenario)


def test_memory_is_bounded(in_processes: Any, segment_ids: Ints) -> None:
    async def scenario(one: Tiles, _: Tiles) -> None:
        for k in range(30):
            at = Address(SEGMENTS, 14, k, 0)
            await answered(one, at)
        assert one._memory.bytes <= 5000
        assert one._roads.bytes <= 5000
        assert 0 < len(one._memory.kept) < 30
        await answered(one, HERE)
        assert one.at_hand(HERE, str(await one.etag(HERE))) is not None

    in_processes(scenario, tile_memory_bytes=5000)


def test_who_stays_gets_the_tile_that_who_left_had_begun(
    in_processes: Any, sessions: Sessions, segment_ids: Ints
) -> None:
    async def scenario(one: Tiles, _: Tiles) -> None:
        etag = str(await one.etag(HERE))
        leaves, stays = (asyncio.create_task(one.get(HERE, etag)) for _ in range(2))
        await asyncio.sleep(0)
        leaves.cancel()
        assert (await stays).body
        with pytest.raises(asyncio.CancelledError):
            await leaves
        assert one.built == 1

    in_processes(scenario)


def test_when_all_have_left_the_server_is_told_and_the_next_one_is_answered(
    in_processes: Any, sessions: Sessions, segment_ids: Ints, monkeypatch: pytest.MonkeyPatch
) -> None:
    asleep = text(
        "SELECT count(*) FROM pg_stat_activity WHERE query LIKE '%pg_sleep(120)%' AND pid <> pg_backend_pid() "
        "AND state = 'active'"
    )

    def sleeping() -> int:
        with sessions() as session:
            return int(session.execute(asleep).scalar_one())

    async def scenario(one: Tiles, _: Tiles) -> None:
        etag = str(await one.etag(HERE))
        with monkeypatch.context() as patch:
            patch.setattr(store, "kept_or_made", sleep_in_loop)
            asked = [asyncio.create_task(one.get(HERE, etag)) for _ in range(2)]
            async with asyncio.timeout(20):
                while sleeping() != 1:
                    await asyncio.sleep(0.01)
                for task in asked:
                    task.cancel()
                while sleeping():
                    await asyncio.sleep(0.01)
        assert (await one.get(HERE, etag)).body

    in_processes(scenario)


def test_a_tile_that_cannot_be_kept_is_answered(
    in_processes: Any, sessions: Sessions, segment_ids: Ints
) -> None:
    with sessions.begin() as session:
        session.execute(text("ALTER TABLE stored_tiles ADD CHECK (z > 14)"))

    async def scenario(one: Tiles, _: Tiles) -> None:
        tile = await answered(one, HERE)
        assert contents(tile) == features(now(sessions, HERE))
        assert await answered(one, HERE) is tile
        assert kept(sessions) == []

    in_processes(scenario)


def test_too_many_at_once_are_sent_away(
    in_processes: Any, segment_ids: Ints, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "kept_or_made", sleep_in_loop)

    async def scenario(one: Tiles, _: Tiles) -> None:
        wide = [Address(SEGMENTS, 10, x, 0) for x in range(203)]
        asked = [asyncio.create_task(one.get(at, "x")) for at in wide]
        with pytest.raises(BusyError, match="wait already"):
            await asked[-1]
        for task in asked:
            task.cancel()
        await asyncio.gather(*asked, return_exceptions=True)

    in_processes(scenario)


def test_ways_are_as_new_as_they_are(in_processes: Any, sessions: Sessions, segment_ids: Ints) -> None:
    """No cell tells that a way has followed its segments: its tile is made each time."""
    at = Address(WAYS, 14, HERE.x, HERE.y)
    with sessions.begin() as session:
        session.execute(
            text(
                """
                INSERT INTO ways (id, osm_way_id, from_node, to_node, segments, length_m, highway, oneway, bridge,
                    tunnel, drives, observations, measured_share, geom, geom_3857)
                SELECT id, osm_way_id, from_node, to_node, 1, length_m, highway, oneway, bridge, tunnel, 0, 0, 0, geom,
                    geom_3857 FROM segments
                """
            )
        )

    async def scenario(one: Tiles, other: Tiles) -> None:
        first, second = await one.made(at), await other.made(at)
        assert first == second
        assert contents(first) == features(now(sessions, at))
        with sessions.begin() as session:
            session.execute(text("UPDATE ways SET steepest_percent = -7.5"))
        after = await one.made(at)
        assert after.etag != first.etag
        assert contents(after) == features(now(sessions, at))
        assert (await one.made(Address(WAYS, 9, 268, 175))).body == b""
        assert kept(sessions) == []

    in_processes(scenario)
