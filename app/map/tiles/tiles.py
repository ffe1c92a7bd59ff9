"""Vector tiles to be answered: from memory, from where they are kept, or built, each state of each tile once."""

from __future__ import annotations

import asyncio
import logging
import zlib
from collections import Counter
from collections.abc import Mapping
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from hashlib import md5
from itertools import count
from time import monotonic

import psycopg

from app.core.admission import RequestClass, class_of_tile
from app.core.db import Patience
from app.core.errors import ServiceError
from app.core.settings import Settings
from app.core.standby.use import StandbyBehindError
from app.core.telemetry.logs import tell
from app.map.tiles import store
from app.map.tiles.connections import Connection, Connections
from app.map.tiles.memory import Memory
from app.map.tiles.road_store import KnownRoads
from app.map.tiles.store import SEGMENTS, WAYS, Address
from app.map.tiles.watch import Versions, Watch

TILE_SCHEMA = 7
"""Raise it whenever tiles change without their data changing, so that caches notice."""
MOST_BYTES = 250_000
"""Of a compressed tile of a low zoom; what is least important is left out of it."""
WAYS_FROM_ZOOM = 10
"""Further out a tile would hold every way of a region."""
GZIP_LEVEL = 1  # higher levels cost more than they save (spec 8)
LARGE_BYTES = 64 * 1024
"""What is larger is compressed in a thread: it takes a millisecond and more."""
ENOUGH = 0.95
"""Roads are not all as large: so much of what would fit on average is tried."""

REFRESH_S = 1.0
"""Between two looks at whether what is asked for often is old."""
OFTEN, MOST_OFTEN = 4, 500
"""Tiles that are asked for so often between two notes are built anew when they get old; so many of them at most."""
NOTE_S = 60.0
"""Between two notes of what was asked for; then half of the counts is forgotten, and what has no room goes."""
RESTING = 3
"""After a tile that nobody waits for, so many times as long as it took."""
CLIENTS_MOST = 20_000
"""Tiles whose asking is counted between two notes."""

NOTHING = 'W/"nothing"'
"""The ETag of an empty tile of ways."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Tile:
    """A tile as it is answered."""

    etag: str
    body: bytes
    """Compressed (gzip); empty: the tile holds nothing."""

    @property
    def size_bytes(self) -> int:
        """In memory, about."""
        return len(self.body)


class _Flight:
    """A tile that is being fetched or built, and how many wait for it."""

    def __init__(self, task: asyncio.Task[Tile]) -> None:
        self.task = task
        self.waiting = 0


class Tiles:
    """The vector tiles of one process. Lives as long as its event loop."""

    def __init__(
        self,
        url: str,
        settings: Settings,
        request_classes: Mapping[str, RequestClass],
        schema: str | None = None,
        primary: Tiles | None = None,
    ) -> None:
        """``schema``: of the map, as ``app.core.db.server_options`` has it; None: the live one. ``primary``: those of
        the database of which there is a standby at ``url``: then nothing is kept there, and memory is shared."""
        patience = Patience(settings.statement_timeout_s, settings.lock_timeout_s, settings.pool_timeout_s)
        self.settings = settings
        pooled = settings.database_pooled
        self.watch = Watch(Connections(url, patience, kept=1, schema=schema, pooled=pooled))
        self.built = 0
        """How many tiles this process has built."""
        self._classes = request_classes
        self._builders = Connections(url, patience, kept=settings.db_pool_size, schema=schema, pooled=pooled)
        self._at_standby = primary is not None
        self._memory: Memory[Address, Tile] = (
            Memory(settings.tile_memory_bytes) if primary is None else primary._memory
        )
        self._roads: KnownRoads = Memory(settings.tile_memory_bytes) if primary is None else primary._roads
        self._serial = count()
        self._flights: dict[tuple[Address, str], _Flight] = {}
        self._asked: Counter[Address] = Counter()
        self._untold: Counter[Address] = Counter()

    async def etag(self, at: Address) -> str | None:
        """The tile's ETag as of now; None where only the tile itself tells. ``psycopg.OperationalError`` while the
        database does not answer."""
        return None if at.layer == WAYS else self._etag(await self.watch.look(), at)

    def at_hand(self, at: Address, etag: str) -> Tile | None:
        """The tile of this ETag, where it is in memory."""
        return self._memory.get(at, etag)

    async def made(self, at: Address, *, is_admitted: bool = False) -> Tile:
        """The tile as it is now, with an ETag of its content; not kept. Raises as ``get`` does.

        Ways follow their segments a moment later, each for its whole length: no cell tells when they have.
        """
        return await self.get(at, f"{next(self._serial)}", is_admitted=is_admitted)

    async def get(self, at: Address, etag: str, *, is_admitted: bool = False) -> Tile:
        """The tile of this ETag, kept or built. Everybody who wants it meanwhile waits for the same one; the last one
        who leaves ends what was begun for them. ``is_admitted``: who asks has a place in its class already.

        Raises ``psycopg.OperationalError``, or ``BusyError`` where too many are being built.
        """
        flight = self._flights.get((at, etag))
        if flight is None:
            flight = self._flights[at, etag] = _Flight(asyncio.create_task(self._fly(at, etag, is_admitted)))
            flight.task.add_done_callback(lambda _: self._land(at, etag, flight))
        flight.waiting += 1
        try:
            return await asyncio.shield(flight.task)
        finally:
            flight.waiting -= 1
            if not flight.waiting:
                self._land(at, etag, flight)
                self._builders.give_up(flight.task)

    def count(self, at: Address) -> None:
        """Somebody asked for the tile, or whether it is new."""
        if at.layer != WAYS and (at in self._asked or len(self._asked) < CLIENTS_MOST):
            self._asked[at] += 1
            self._untold[at] += 1

    async def run(self) -> None:
        """Beside the requests: build anew what is asked for often, note what was asked for, make room."""
        known, noted = -1, monotonic()
        while True:
            await asyncio.sleep(REFRESH_S)
            try:
                if self._asked and (known != self.watch.changes or await self._is_changed(known)):
                    known = self.watch.changes
                    await self._refresh()
                if monotonic() - noted > NOTE_S:
                    noted = monotonic()
                    await self.note()
            except (psycopg.Error, ServiceError) as error:
                tell(logger, "tiles not refreshed", level=logging.DEBUG, reason=type(error).__name__)

    async def note(self) -> None:
        """Tell the database what was asked for, and have it take away what is too much."""
        counts, self._untold = self._untold, Counter()
        self._asked = Counter({at: n // 2 for at, n in self._asked.items() if n > 1})
        if self._at_standby:
            return

        async def work(connection: Connection) -> int:
            if counts:
                async with self._builders.transaction(connection):
                    await store.note_asked(connection, counts)
            async with self._builders.transaction(connection):
                return await store.clean(connection, self.settings.tiles_stored_bytes)

        gone = await self._builders.run(work)
        if gone:
            tell(logger, "tiles taken away", tiles=gone)

    async def close(self) -> None:
        """Stop what is under way."""
        for flight in list(self._flights.values()):
            flight.task.cancel()
            with suppress(asyncio.CancelledError, psycopg.Error, ServiceError):
                await flight.task
        await self.watch.close()
        await self._builders.close()

    def _etag(self, versions: Versions, at: Address) -> str:
        least, full = self.settings.tile_min_zoom, self.settings.tile_full_zoom
        return tag_of(versions, at.z, at.x, at.y, min_zoom=least, full_zoom=full)

    async def _is_changed(self, known: int) -> bool:
        await self.watch.look()
        return self.watch.changes != known

    async def _refresh(self) -> None:
        """Build anew what is asked for often and old; whoever is answered goes first."""
        for at, asked in self._asked.most_common(MOST_OFTEN):
            if asked < OFTEN:
                return
            etag = self._etag(self.watch.versions, at)
            if self.at_hand(at, etag) is not None:
                continue
            while self._flights:
                await asyncio.sleep(REFRESH_S / 10)
            started = monotonic()
            await self.get(at, etag)
            await asyncio.sleep(RESTING * (monotonic() - started))

    def _land(self, at: Address, etag: str, flight: _Flight) -> None:
        """Whoever comes now begins a new one."""
        if self._flights.get((at, etag)) is flight:
            del self._flights[at, etag]
        if flight.task.done() and not flight.task.cancelled():
            flight.task.exception()  # all who waited may have left

    async def _fly(self, at: Address, etag: str, is_admitted: bool) -> Tile:
        if self._is_further_out(at):
            return Tile(NOTHING if at.layer == WAYS else etag, b"")
        async with nullcontext() if is_admitted else self._classes[class_of_tile(at.z)].place():
            fetch = self._fetch_anew if self._at_standby else self._fetch
            body = await self._builders.run(lambda connection: fetch(connection, at, etag))
        if at.layer == WAYS:
            return Tile(f'W/"{md5(body, usedforsecurity=False).hexdigest()}"' if body else NOTHING, body)
        tile = Tile(etag, body)
        self._memory.put(at, etag, tile)
        return tile

    def _is_further_out(self, at: Address) -> bool:
        return at.z < self.settings.tile_min_zoom or (at.layer == WAYS and at.z < WAYS_FROM_ZOOM)

    async def _fetch(self, connection: Connection, at: Address, etag: str) -> bytes:
        """The kept tile, or one that is built and kept. Its data are as new as the ETag or newer, never older."""
        body = None
        try:
            async with self._builders.transaction(connection):
                await store.lock_tile(connection, at)
                full_zoom = self.settings.tile_full_zoom
                stored, data = await store.kept_or_made(connection, at, etag, full_zoom, self._roads)
                if stored is not None:
                    return stored
                body = await self._built(connection, at, data)
                if body and at.layer != WAYS:
                    await store.keep(connection, at, etag, body)
        except psycopg.Error as error:
            if body is None:
                raise
            tell(logger, "tile not kept", level=logging.WARNING, reason=type(error).__name__)
        return body

    async def _fetch_anew(self, connection: Connection, at: Address, _etag: str) -> bytes:
        """The tile as a standby makes it, where nothing can be kept. ``StandbyBehindError`` where its data may be older
        than those that the ETag was made of, as of another standby behind the same address."""
        async with self._builders.transaction(connection):
            if at.layer != WAYS and not await store.has_replayed(connection, self.watch.replayed):
                raise StandbyBehindError("this standby is behind the one that was asked for the versions")
            data = await store.made(connection, at, self.settings.tile_full_zoom, self._roads)
            return await self._built(connection, at, data)

    async def _built(self, connection: Connection, at: Address, data: bytes) -> bytes:
        """The tile compressed; of a low zoom not larger than it may be, and not empty where there is anything."""
        low = at.z < self.settings.tile_full_zoom
        if not data and low and at.layer == SEGMENTS:
            data = await store.specks(connection, at)
        if not data:
            return b""
        self.built += 1
        body = await compressed(data)
        return (
            await self._most_important(connection, at, len(body)) if low and len(body) > MOST_BYTES else body
        )

    async def _most_important(self, connection: Connection, at: Address, size: int) -> bytes:
        """The tile of as many roads as have room in it."""
        _, most = await store.most_important(connection, at, None)
        while True:
            most = max(1, int(most * ENOUGH * MOST_BYTES / size))
            data, _ = await store.most_important(connection, at, most)
            body = await compressed(data)
            size = len(body)
            if size <= MOST_BYTES or most == 1:
                return body


def tag_of(versions: Versions, z: int, x: int, y: int, *, min_zoom: int, full_zoom: int) -> str:
    """The ETag of a tile of segments as of these versions, where a service draws by these zooms."""
    sums = versions.of(z, x, y)
    tag = sums.near if z >= full_zoom else sums.far
    return f'W/"{versions.epoch}.{tag}-{TILE_SCHEMA}.{min_zoom}.{full_zoom}"'


async def compressed(data: bytes) -> bytes:
    """The tile as gzip, the same bytes for the same data."""
    if len(data) < LARGE_BYTES:
        return _gzip(data)
    return await asyncio.to_thread(_gzip, data)


async def plain(body: bytes) -> bytes:
    """The tile for a client that takes no gzip."""
    if len(body) < LARGE_BYTES // 4:
        return zlib.decompress(body, wbits=31)
    return await asyncio.to_thread(zlib.decompress, body, wbits=31)


def _gzip(data: bytes) -> bytes:
    return zlib.compress(data, GZIP_LEVEL, wbits=31)
