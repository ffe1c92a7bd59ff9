"""Versions in memory are those of the database, whatever changes in whatever order."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import text

from app.core import databases
from app.core.db import Patience, Sessions, make_engine, session_factory
from app.embedded.cluster import EmbeddedPostgres
from app.map.tiles.connections import Connections
from app.map.tiles.watch import Sums, Versions, Watch
from app.network.cells import span

PATIENCE = Patience(20, 2, 3)
RAISE = text(
    """
    INSERT INTO cells AS c (id, version) VALUES (:id, 1)
    ON CONFLICT (id) DO UPDATE SET version = c.version + 1, changed_at = clock_timestamp()
    """
)
DRAWN = text("UPDATE cells SET drawn_version = drawn_version + 1 WHERE id = :id")
SUMS = text(
    """
    SELECT coalesce(sum(version), 0), coalesce(sum(drawn_version), 0),
           coalesce(sum(CAST(extract(epoch FROM changed_at) * 1000000 AS bigint)), 0)
    FROM cells WHERE id >> 14 BETWEEN :x0 AND :x1 AND id & 16383 BETWEEN :y0 AND :y1
    """
)


@pytest.fixture(scope="module")
def url(cluster: EmbeddedPostgres, template_db: str, new_database: Callable[[str], str]) -> Iterator[str]:
    name = new_database(template_db)
    yield cluster.url_of(name)
    databases.drop_database(cluster.url, name)


@pytest.fixture(scope="module")
def factory(url: str) -> Iterator[Sessions]:
    engine = make_engine(url)
    yield session_factory(engine)
    engine.dispose()


def watched(
    url: str, scenario: Callable[[Watch], Coroutine[Any, Any, None]], *, pooled: bool = False
) -> None:
    async def run() -> None:
        watch = Watch(Connections(url, PATIENCE, kept=1, pooled=pooled))
        try:
            await scenario(watch)
        finally:
            await watch.close()

    asyncio.run(run())


def change(factory: Sessions, *cells: int, statement: Any = RAISE) -> None:
    with factory.begin() as session:
        for cell in cells:
            session.execute(statement, {"id": cell})


def sums(factory: Sessions, z: int, x: int, y: int) -> Sums:
    (x0, x1), (y0, y1) = span(z, x), span(z, y)
    with factory() as session:
        row = session.execute(SUMS, {"x0": x0, "x1": x1, "y0": y0, "y1": y1}).one()
    return Sums(*(int(value) for value in row))


def around(cell: int, z: int, dx: int, dy: int) -> tuple[int, int, int]:
    """A tile over a cell, or beside it."""
    x, y = cell >> 14, cell & 16383
    x, y = (n >> 14 - z if z <= 14 else n << z - 14 for n in (x, y))
    return z, min(max(x + dx, 0), (1 << z) - 1), min(max(y + dy, 0), (1 << z) - 1)


corners = st.sampled_from([0, 1, 8190, 8191, 8192, 16382, 16383])
near = st.integers(8000, 8400)
cells = st.builds(lambda x, y: x << 14 | y, corners | near, corners | near)
shifts = st.integers(-1, 1)
steps = st.lists(
    st.tuples(st.sampled_from([RAISE, DRAWN]), st.lists(cells, min_size=1, max_size=4)), max_size=4
)


@given(steps=steps, data=st.data())
@settings(max_examples=25)
def test_sums_are_those_of_the_table(url: str, factory: Sessions, steps: Any, data: st.DataObject) -> None:
    known = sorted({cell for _, some in steps for cell in some} | {8191 << 14 | 8192})

    async def scenario(watch: Watch) -> None:
        for statement, some in [(RAISE, known), *steps]:
            await watch.look()
            change(factory, *some, statement=statement)
            z, x, y = around(
                data.draw(st.sampled_from(known)),
                data.draw(st.integers(0, 18)),
                *data.draw(st.tuples(shifts, shifts)),
            )
            versions = await watch.look()
            assert versions.of(z, x, y) == sums(factory, z, x, y)

    with factory.begin() as session:
        session.execute(text("DELETE FROM cells"))
    watched(url, scenario, pooled=data.draw(st.booleans()))


def test_every_tile_of_a_cell_and_no_other_is_new() -> None:
    """Of all zooms, by the definition: the tiles whose span has the cell in it."""
    cell = 8191 << 14 | 8192
    versions = Versions()
    versions.put([(cell, 1, 1, 7)])
    for z in range(19):
        for dx in range(-3, 4):
            for dy in range(-3, 4):
                tile = around(cell, z, dx, dy)
                (x0, x1), (y0, y1) = span(z, tile[1]), span(z, tile[2])
                shows = x0 <= 8191 <= x1 and y0 <= 8192 <= y1
                assert versions.of(*tile) == (Sums(1, 1, 7) if shows else Sums(0, 0, 0)), tile


def test_what_is_committed_late_is_seen_late_and_not_missed(url: str, factory: Sessions) -> None:
    early, late = 5 << 14 | 5, 6 << 14 | 9
    change(factory, early, late)

    async def scenario(watch: Watch) -> None:
        before = (await watch.look()).of(14, 6, 9)
        with factory() as slow:
            slow.execute(RAISE, {"id": late})  # has its number before the others
            change(factory, early)
            await watch.look()
            change(factory, early)
            assert (await watch.look()).of(14, 6, 9) == before
            assert watch.versions.of(14, 5, 5) == sums(factory, 14, 5, 5)
            slow.commit()
        assert (await watch.look()).of(14, 6, 9) == sums(factory, 14, 6, 9) != before

    watched(url, scenario)


def test_a_look_that_finds_nothing_new_changes_nothing(url: str, factory: Sessions) -> None:
    async def scenario(watch: Watch) -> None:
        versions = await watch.look()
        changes = watch.changes
        with factory.begin() as session:
            session.execute(text("UPDATE cells SET unsettled_since = now()"))  # nothing that is shown
        assert await watch.look() is versions
        assert watch.changes == changes

    watched(url, scenario)


def test_cells_that_are_deleted_begin_a_new_epoch(url: str, factory: Sessions) -> None:
    cell = 7 << 14 | 7
    change(factory, cell, cell + 500)

    async def scenario(watch: Watch) -> None:
        epoch = (await watch.look()).epoch
        with factory.begin() as session:
            session.execute(text("DELETE FROM cells WHERE id = :id"), {"id": cell})
        versions = await watch.look()
        assert versions.of(14, 7, 7) == sums(factory, 14, 7, 7) == Sums(0, 0, 0)
        assert versions.epoch != epoch
        with factory.begin() as session:
            session.execute(text("TRUNCATE cells"))
        assert len(await watch.look()) == 0

    watched(url, scenario)


def test_a_lost_connection_costs_nobody_anything(url: str, factory: Sessions) -> None:
    cell = 8 << 14 | 8

    async def scenario(watch: Watch) -> None:
        await watch.look()
        with factory.begin() as session:
            ended = text(
                "SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity "
                "WHERE datname = current_database() AND pid <> pg_backend_pid()"
            )
            session.execute(ended)
        change(factory, cell)
        assert (await watch.look()).of(14, 8, 8) == sums(factory, 14, 8, 8)

    watched(url, scenario)


def test_who_comes_while_a_look_runs_waits_for_the_next_one(url: str, factory: Sessions) -> None:
    cell = 9 << 14 | 9

    async def scenario(watch: Watch) -> None:
        await watch.look()
        for _ in range(20):
            first = asyncio.ensure_future(watch.look())
            await asyncio.sleep(0)
            await asyncio.sleep(0)  # it is on its way
            change(factory, cell)
            assert (await watch.look()).of(14, 9, 9) == sums(factory, 14, 9, 9)
            await first

    watched(url, scenario)


def test_numbers_of_another_server_are_read_once(url: str, factory: Sessions) -> None:
    """A dump brings back numbers that this server has not come to."""
    cell = 10 << 14 | 10
    change(factory, cell)

    async def scenario(watch: Watch) -> None:
        with factory.begin() as session:
            session.execute(
                text("UPDATE cells SET changed_xid = changed_xid + 1000000000 WHERE id = :id"), {"id": cell}
            )
        await watch.look()
        changes = watch.changes
        await watch.look()
        assert watch.changes == changes
        change(factory, cell)
        assert (await watch.look()).of(14, 10, 10) == sums(factory, 14, 10, 10)

    watched(url, scenario)
