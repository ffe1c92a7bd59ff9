"""Looks after the versions of all squares: before every answer one look at what changed since the look before."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress

import psycopg
from psycopg.pq.abc import PGresult

from app.map.tiles import store
from app.map.tiles.connections import Asker, Connection, Connections, end, is_broken
from app.map.tiles.versions import Versions


class Watch:
    """The versions in memory, as new as the last look.

    Looks follow each other on one connection. All requests that came before a look began share it. What was deleted,
    and another database behind the same address, is noticed by the epoch, by a snapshot that lies before the last one,
    and by a new connection: then all is read anew.
    """

    def __init__(self, connections: Connections) -> None:
        self.versions = Versions()
        self.changes = 0
        """How many looks found anything new."""
        self.heard: Callable[[list[int] | None], None] = lambda _: None
        """Is told the numbers of squares that changed; None: it may be any."""
        self._connections = connections
        self._connection: Connection | None = None
        self._asker: Asker | None = None
        self._snapshot = ""
        self._ending: asyncio.Task[None] | None = None
        self._reading: asyncio.Task[None] | None = None
        self._looking: list[asyncio.Future[None]] = []
        """Who waits for the look that is under way."""
        self._waiting: list[asyncio.Future[None]] = []
        """Who waits for the next one."""

    async def look(self) -> Versions:
        """The versions as they are, by a look that began after this call; raises what the database says."""
        mine = asyncio.get_running_loop().create_future()
        self._waiting.append(mine)
        if not self._looking:
            self._begin()
        await mine
        return self.versions

    async def close(self) -> None:
        """Look no more."""
        if self._reading is not None:
            self._reading.cancel()
            with suppress(asyncio.CancelledError):
                await self._reading
        self._stop_asking()
        await self._disconnect()

    def _begin(self) -> None:
        self._looking, self._waiting = self._waiting, []
        try:
            if self._asker is None:
                self._read_all()
            else:
                self._asker.ask(store.look_question(self._snapshot))
        except psycopg.Error:
            self._lose()

    def _answered(self, answer: PGresult | psycopg.Error) -> None:
        if not isinstance(answer, psycopg.Error):
            self._look_at(answer)
        elif self._connection is None or is_broken(answer, self._connection):
            self._lose()
        else:
            self._end_look(answer)

    def _look_at(self, answer: PGresult) -> None:
        found = store.look_answer(answer)
        if found.epoch != self.versions.epoch or _lowest(found.snapshot) < _lowest(self._snapshot):
            self._stop_asking()
            self._read_all()
            return
        self._snapshot = found.snapshot
        if found.squares:
            changed = self.versions.put(found.squares)
            self.changes += changed
            if changed:
                self.heard([square[0] for square in found.squares])
        self._end_look(None)

    def _end_look(self, error: BaseException | None) -> None:
        looking, self._looking = self._looking, []
        for one in looking:
            if one.done():  # whoever waited has left
                continue
            if error is None:
                one.set_result(None)
            else:
                one.set_exception(error)
        if self._waiting:
            self._begin()

    def _lose(self) -> None:
        """The connection is gone: whoever waits is served by a new one."""
        self._stop_asking()
        self._connection, lost = None, self._connection
        if lost is not None:
            self._ending = asyncio.create_task(end(lost))
        if self._looking:
            self._read_all()

    def _stop_asking(self) -> None:
        if self._asker is not None:
            self._asker.stop()
            self._asker = None

    def _read_all(self) -> None:
        self._reading = asyncio.create_task(self._read())

    async def _read(self) -> None:
        """Read the versions of all squares, on a new connection where there is none."""
        try:
            if self._connection is None:
                self._connection = await self._connections.connect()
                await store.prepare_looks(self._connection)
            found = await store.look_at_all(self._connection)
            versions = Versions(found.epoch)
            await asyncio.to_thread(versions.put, found.squares)
        except Exception as error:  # whatever it is, somebody waits
            await self._disconnect()
            self._end_look(error)
            return
        self.versions, self._snapshot = versions, found.snapshot
        self.changes += 1
        self.heard(None)
        self._asker = Asker(self._connection, store.LOOK, self._answered)
        self._end_look(None)

    async def _disconnect(self) -> None:
        if self._connection is not None:
            await end(self._connection)
            self._connection = None


def _lowest(snapshot: str) -> int:
    """The number of the oldest transaction that may have been running."""
    return int(snapshot.partition(":")[0])
