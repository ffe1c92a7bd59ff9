"""Looks after the versions of all squares: before every answer one look at what changed since the look before."""

from __future__ import annotations

import asyncio
from contextlib import suppress

from app.map.tiles import store
from app.map.tiles.connections import Connection, Connections
from app.map.tiles.store import Look
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
        self._connections = connections
        self._connection: Connection | None = None
        self._snapshot = ""
        self._looking: asyncio.Task[None] | None = None
        self._next: asyncio.Future[None] | None = None

    async def look(self) -> Versions:
        """The versions as they are, by a look that began after this call; raises what the database says."""
        if self._next is None:
            self._next = asyncio.get_running_loop().create_future()
        mine = self._next
        if self._looking is None:
            self._looking = asyncio.create_task(self._look_while_asked())
        await asyncio.shield(mine)
        return self.versions

    async def close(self) -> None:
        """Look no more."""
        if self._looking is not None:
            self._looking.cancel()
            with suppress(asyncio.CancelledError):
                await self._looking
        await self._connections.close()

    async def _look_while_asked(self) -> None:
        try:
            while self._next is not None:
                mine, self._next = self._next, None
                try:
                    await self._connections.run(self._look)
                except asyncio.CancelledError:
                    mine.cancel()
                    raise
                except Exception as error:
                    mine.set_exception(error)
                    mine.exception()  # all who wait may have left
                else:
                    mine.set_result(None)
        finally:
            self._looking = None

    async def _look(self, connection: Connection) -> None:
        if connection is self._connection:
            found = await store.look(connection, self._snapshot)
            if found.epoch == self.versions.epoch and _moment(found) >= _lowest(self._snapshot):
                self._snapshot = found.snapshot
                if found.squares:
                    self.changes += self.versions.put(found.squares)
                return
        else:
            await store.prepare_looks(connection)
        found = await store.look_at_all(connection)
        versions = Versions(found.epoch)
        await asyncio.to_thread(versions.put, found.squares)
        self.versions, self._connection, self._snapshot = versions, connection, found.snapshot
        self.changes += 1


def _moment(found: Look) -> int:
    return _lowest(found.snapshot)


def _lowest(snapshot: str) -> int:
    """The number of the oldest transaction that may have been running."""
    return int(snapshot.partition(":")[0])
