"""The queue on the lane's own connections: procrastinate's statements go through the engine that its work goes through.

Procrastinate's connector has a pool and a listening connection of its own. A lane has one connection for everything
that is short, so that fifty machines fit on one database, and hears of new jobs from its machine's listener
(``app.jobs.listening``); without one it asks once a second.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import Any

import psycopg
from procrastinate import exceptions
from procrastinate.connector import BaseAsyncConnector, Notify
from procrastinate.sync_psycopg_connector import wrap_exceptions
from psycopg.rows import DictRow, dict_row
from psycopg.types.json import Jsonb
from sqlalchemy import Engine
from sqlalchemy.exc import SQLAlchemyError

from app.jobs.listening import announcements

THREADS = 2
"""Statements at once: one that waits for a lock must not keep the sign of life."""

_Spare = Callable[[psycopg.Connection[Any]], object]


class EngineConnector(BaseAsyncConnector):
    """For the loop of one worker."""

    def __init__(self, engine: Engine, spare: _Spare = lambda _: None, wakes: int | None = None) -> None:
        """``spare`` is told of each connection before a statement of the queue is begun on it.

        ``wakes``: the end of a pipe to be read, of the machine's listener; None: there is none.
        """
        self._engine, self._spare, self._wakes = engine, spare, wakes
        self._threads = ThreadPoolExecutor(THREADS, thread_name_prefix="queue")

    def get_sync_connector(self) -> EngineConnector:
        """Itself; it is used by coroutines alone."""
        return self

    async def open_async(self, pool: Any = None) -> None:
        """Nothing is to be opened."""

    async def close_async(self) -> None:
        """End its threads, which end their statements first."""
        await asyncio.to_thread(self._threads.shutdown)

    async def execute_query_async(self, query: str, **arguments: Any) -> None:
        """Execute it."""
        await self._in_thread(query, arguments, lambda cursor: None)

    async def execute_query_one_async(self, query: str, **arguments: Any) -> dict[str, Any]:
        """Its first row; ``NoResult`` without one."""
        row = await self._in_thread(query, arguments, lambda cursor: cursor.fetchone())
        if row is None:
            raise exceptions.NoResult
        return dict(row)

    async def execute_query_all_async(self, query: str, **arguments: Any) -> list[dict[str, Any]]:
        """All its rows."""
        return list(await self._in_thread(query, arguments, lambda cursor: cursor.fetchall()))

    async def listen_notify(self, on_notification: Notify, channels: Iterable[str]) -> None:
        """Hand on what the machine's listener says, until cancelled."""
        if self._wakes is not None:
            async for channel, payload in announcements(self._wakes):
                await on_notification(channel=channel, payload=payload)
        await asyncio.Event().wait()

    async def _in_thread(
        self, query: str, arguments: dict[str, Any], fetch: Callable[[psycopg.Cursor[DictRow]], Any]
    ) -> Any:
        work = partial(self._execute, query, arguments, fetch)
        return await asyncio.get_running_loop().run_in_executor(self._threads, work)

    def _execute(
        self, query: str, arguments: dict[str, Any], fetch: Callable[[psycopg.Cursor[DictRow]], Any]
    ) -> Any:
        with self._cursor() as cursor:
            cursor.execute(query.encode(), {name: _adapted(value) for name, value in arguments.items()})
            return fetch(cursor)

    @contextmanager
    def _cursor(self) -> Iterator[psycopg.Cursor[DictRow]]:
        """In a transaction of its own; errors become procrastinate's."""
        try:
            with wrap_exceptions(), self._engine.begin() as connection:
                driver: Any = connection.connection.driver_connection
                self._spare(driver)
                with driver.cursor(row_factory=dict_row) as cursor:
                    yield cursor
        except SQLAlchemyError as error:
            raise exceptions.ConnectorException from error


def _adapted(value: Any) -> Any:
    """As procrastinate's own connector hands it over: objects as JSON."""
    if isinstance(value, dict):
        return Jsonb(value)
    if isinstance(value, list | tuple):
        return type(value)(_adapted(item) for item in value)
    return value
