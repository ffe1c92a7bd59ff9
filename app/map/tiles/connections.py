"""Connections to the database that the event loop itself waits on: a tile needs no thread.

Everything else of the service reads the database in threads. A warm tile is one indexed look of some thirty
microseconds; the way through a thread and a session costs ten times as much, most of it under Python's lock.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from typing import Any, TypeVar

import psycopg
from psycopg import AsyncConnection
from psycopg.pq import DiagnosticField, ExecStatus
from psycopg.pq.abc import PGresult

from app.core.db import Patience, server_options
from app.core.settings import libpq_url

Found = TypeVar("Found")
Connection = AsyncConnection[tuple[Any, ...]]


class Connections:
    """Connections that wait for work; as many as are asked for at once, and ``kept`` of them while nobody asks."""

    def __init__(self, url: str, patience: Patience, *, kept: int) -> None:
        self._url = libpq_url(url)
        self._patience = patience
        self._kept = kept
        self._idle: list[Connection] = []
        self._closed = False

    @asynccontextmanager
    async def one(self) -> AsyncIterator[Connection]:
        """A connection in autocommit mode for the block; after an error in it, it is not used again."""
        connection = self._idle.pop() if self._idle else await self._connect()
        try:
            yield connection
        except BaseException:
            await _end(connection)
            raise
        if self._closed or len(self._idle) >= self._kept:
            await _end(connection)
        else:
            self._idle.append(connection)

    async def run(self, work: Callable[[Connection], Awaitable[Found]]) -> Found:
        """Do the work on a connection; once more on a new one where the server has closed the one that waited here."""
        waited = bool(self._idle)
        try:
            async with self.one() as connection:
                return await work(connection)
        except psycopg.OperationalError as error:
            if not waited or not _is_broken(error, connection):
                raise
        await self.close_idle()
        async with self.one() as connection:
            return await work(connection)

    async def close_idle(self) -> None:
        """Close those that wait for work."""
        idle, self._idle = self._idle, []
        for connection in idle:
            await _end(connection)

    async def close(self) -> None:
        """Close all, those at work when they are through."""
        self._closed = True
        await self.close_idle()

    async def _connect(self) -> Connection:
        return await AsyncConnection.connect(
            self._url,
            autocommit=True,
            prepare_threshold=0,
            options=server_options(self._patience),
            application_name="versant",
            connect_timeout=max(2, math.ceil(self._patience.connection_s)),
        )


async def execute_prepared(connection: Connection, name: bytes, parameters: list[bytes | None]) -> PGresult:
    """The result, in text format, of a statement that was prepared on the connection under this name.

    Without cursors and conversions, which cost three times as much as the statement: for the one look that comes before
    every answer. Raises ``psycopg.OperationalError`` and what else the database says.
    """
    server, results = connection.pgconn, []
    loop = asyncio.get_running_loop()
    ended: asyncio.Future[None] = loop.create_future()

    def readable() -> None:
        try:
            server.consume_input()
            while not ended.done() and not server.is_busy():
                result = server.get_result()
                if result is None:
                    ended.set_result(None)
                else:
                    results.append(result)
        except psycopg.Error as error:
            if not ended.done():
                ended.set_exception(error)

    server.send_query_prepared(name, parameters)
    server.flush()
    loop.add_reader(server.socket, readable)
    try:
        await ended
    finally:
        loop.remove_reader(connection.pgconn.socket)
    (result,) = results
    if result.status != ExecStatus.TUPLES_OK:
        state = result.error_field(DiagnosticField.SQLSTATE) or b""
        raise psycopg.errors.lookup(state.decode())(result.error_message.decode(errors="replace"))
    return result


def _is_broken(error: psycopg.Error, connection: Connection) -> bool:
    """Whether the connection is gone, rather than a statement refused."""
    return error.sqlstate is None or error.sqlstate.startswith(("57P", "08")) or connection.broken


async def _end(connection: Connection) -> None:
    with suppress(psycopg.Error, OSError):
        await connection.close()
