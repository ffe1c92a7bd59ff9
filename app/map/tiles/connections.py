"""Connections to the database that the event loop itself waits on: a tile needs no thread.

Everything else of the service reads the database in threads. A warm tile is one indexed look of some thirty
microseconds; the way through a thread and a session costs ten times as much, most of it under Python's lock.
"""

from __future__ import annotations

import asyncio
import math
import select
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from typing import Any, TypeVar

import psycopg
from psycopg import AsyncConnection
from psycopg.pq import DiagnosticField, ExecStatus
from psycopg.pq.abc import PGcancel, PGconn, PGresult

from app.core.db import Patience, lost_connection, server_options, transaction_options
from app.core.disconnects import AGAIN_S
from app.core.settings.places import libpq_url

Found = TypeVar("Found")
Connection = AsyncConnection[tuple[Any, ...]]


class Connections:
    """Connections that wait for work; as many as are asked for at once, and ``kept`` of them while nobody asks."""

    def __init__(
        self, url: str, patience: Patience, *, kept: int, schema: str | None = None, pooled: bool = False
    ) -> None:
        """``schema`` and ``pooled``: as ``app.core.db.make_engine`` has them."""
        self._url = libpq_url(url)
        self._schema = schema
        self._patience = patience
        self.begin = transaction_options(patience, schema) if pooled else None
        """The statement with which each transaction has to begin."""
        self._kept = kept
        self._idle: list[Connection] = []
        self._at_work: dict[asyncio.Task[Any] | None, PGcancel] = {}
        self._endings: set[asyncio.Task[None]] = set()
        self._closed = False

    @asynccontextmanager
    async def one(self) -> AsyncIterator[Connection]:
        """A connection in autocommit mode for the block; after an error in it, it is not used again."""
        connection = self._idle.pop() if self._idle else await self.connect()
        task = asyncio.current_task()
        self._at_work[task] = connection.pgconn.get_cancel()
        try:
            yield connection
        except BaseException as error:
            await end(connection)
            if (lost := lost_connection(error)) is not None:
                raise lost from error
            raise
        finally:
            del self._at_work[task]
        if self._closed or len(self._idle) >= self._kept:
            await end(connection)
        else:
            self._idle.append(connection)

    async def run(self, work: Callable[[Connection], Awaitable[Found]]) -> Found:
        """Do the work on a connection; once more on a new one where the server has closed the one that waited here."""
        waited = bool(self._idle)
        try:
            async with self.one() as connection:
                return await work(connection)
        except psycopg.OperationalError as error:
            if not waited or not is_broken(error, connection):
                raise
        await self.close_idle()
        async with self.one() as connection:
            return await work(connection)

    @asynccontextmanager
    async def transaction(self, connection: Connection) -> AsyncIterator[None]:
        """One transaction, for the block."""
        async with connection.transaction():
            if self.begin is not None:
                await connection.execute(self.begin)
            yield

    def give_up(self, task: asyncio.Task[Any]) -> None:
        """Cancel a task that may work on a connection of these, and its statement on the server, until it has ended.

        The driver asks the server once, which has no effect before the statement has begun; the statement would then go
        on, and hold its locks, long after its connection is closed here.
        """
        task.cancel()
        if not task.done():
            ending = asyncio.create_task(self._insist(task))
            self._endings.add(ending)
            ending.add_done_callback(self._endings.discard)

    async def _insist(self, task: asyncio.Task[Any]) -> None:
        while (await asyncio.wait({task}, timeout=AGAIN_S))[1]:
            if (canceller := self._at_work.get(task)) is not None:
                with suppress(psycopg.Error):  # a server that is away runs no statement either
                    await asyncio.to_thread(canceller.cancel)

    async def close_idle(self) -> None:
        """Close those that wait for work."""
        idle, self._idle = self._idle, []
        for connection in idle:
            await end(connection)

    async def close(self) -> None:
        """Close all, those at work when they are through."""
        self._closed = True
        await self.close_idle()

    async def connect(self) -> Connection:
        """A new connection, which is nobody else's."""
        kept: dict[str, Any] = {
            "prepare_threshold": 0,
            "options": server_options(self._patience, self._schema),
        }
        return await AsyncConnection.connect(
            self._url,
            autocommit=True,
            **(kept if self.begin is None else {"prepare_threshold": None}),
            application_name="versant",
            connect_timeout=max(2, math.ceil(self._patience.connection_s)),
        )


class Asker:
    """One question, asked again and again on a connection that is for nothing else meanwhile.

    Without the driver's cursors, conversions and tasks, which cost several times what the statement does: for the one
    look that comes before every answer. One question at a time.
    """

    def __init__(
        self,
        connection: Connection,
        send: Callable[[PGconn, str], None],
        answered: Callable[[PGresult | psycopg.Error], None],
    ) -> None:
        """``send`` sends the question; ``answered`` is called with the last result of each (in text format), and when
        the connection breaks."""
        self._server, self._send, self._answered = connection.pgconn, send, answered
        self._results: list[PGresult] = []
        self._socket = self._server.socket
        self._more = select.poll()
        self._more.register(self._socket, select.POLLIN)
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._socket, self._readable)

    def ask(self, about: str) -> None:
        """Send the question; raises ``psycopg.OperationalError`` where the connection is gone."""
        self._send(self._server, about)
        self._server.flush()

    def stop(self) -> None:
        """Leave the connection to others."""
        self._loop.remove_reader(self._socket)

    def _readable(self) -> None:
        try:
            answered = self._is_answered()
            # uvloop tells once of a socket in error, though its last word and its end are both to be read.
            while self._more.poll(0):
                answered = self._is_answered()
        except psycopg.Error as error:
            self.stop()
            self._answered(error)
            return
        if not answered:
            return
        results, self._results = self._results, []
        if results:
            self._answered(_checked(results[-1]))

    def _is_answered(self) -> bool:
        """Take what has come; whether that is all."""
        self._server.consume_input()
        while not self._server.is_busy():
            result = self._server.get_result()
            if result is None:
                return True
            self._results.append(result)
        return False


def _checked(result: PGresult) -> PGresult | psycopg.Error:
    if result.status == ExecStatus.TUPLES_OK:
        return result
    state = result.error_field(DiagnosticField.SQLSTATE) or b"XX000"
    return psycopg.errors.lookup(state.decode())(result.error_message.decode(errors="replace"))


def is_broken(error: psycopg.Error, connection: Connection) -> bool:
    """Whether the connection is gone, rather than a statement refused."""
    return error.sqlstate is None or error.sqlstate.startswith(("57P", "08")) or connection.broken


async def end(connection: Connection) -> None:
    """Close it, whatever state it is in."""
    with suppress(psycopg.Error, OSError):
        await connection.close()
