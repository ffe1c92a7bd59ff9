"""The versions of all cells in memory, and one look before every answer at what changed since the look before.

A tile is as new as the cells that it shows (``app.network.cells``). ``Versions`` has the sum of their versions and the
sum of the times of their last changes: equal sums are equal data, in every process and after every start, since a
change raises a version. So it costs no query of a table whether a tile is new. Zooms further out than ``WIDE`` have
sums that are kept up to date, cell by cell; nearer ones add up the few cells below them on demand.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache, partial

import psycopg
from psycopg.pq.abc import PGresult

from app.core.db import Bounds
from app.map.tiles import store
from app.map.tiles.connections import Asker, Connection, Connections, end, is_broken
from app.map.tiles.store import CellVersion
from app.network import ZOOM
from app.network.cells import cell_bounds, span

WIDE = 12
"""Tiles of lower zooms meet a hundred cells and more."""

_SIDE = (1 << ZOOM) - 1
_NOTHING = (0, 0, 0)


@dataclass(frozen=True)
class Sums:
    """Of the cells that a tile shows."""

    version: int
    drawn: int
    changed_us: int

    @property
    def near(self) -> str:
        """What tells any change of segments."""
        return f"{self.version}.{self.changed_us:x}"

    @property
    def far(self) -> str:
        """What tells any change of what is drawn from afar."""
        return f"{self.drawn}d"


@dataclass
class Versions:
    """Of all cells, as one look at the database found them."""

    epoch: str = ""
    _cells: dict[int, tuple[int, int, int]] = field(default_factory=dict)
    _wide: list[dict[int, list[int]]] = field(default_factory=lambda: [{} for _ in range(WIDE)])
    """By zoom and tile (x << zoom | y): the three sums."""

    def put(self, cells: Iterable[CellVersion]) -> bool:
        """These are so now, the others as before; whether anything is otherwise."""
        changed = False
        for number, *now in cells:
            before = self._cells.get(number, _NOTHING)
            version, drawn, changed_us = now
            if before == (version, drawn, changed_us):
                continue
            changed = True
            self._cells[number] = (version, drawn, changed_us)
            more = (version - before[0], drawn - before[1], changed_us - before[2])
            columns, rows = _reach(number >> ZOOM), _reach(number & _SIDE)
            for z, sums_of in enumerate(self._wide):
                for column in columns[z]:
                    for row in rows[z]:
                        sums = sums_of.setdefault(column << z | row, [0, 0, 0])
                        sums[0] += more[0]
                        sums[1] += more[1]
                        sums[2] += more[2]
        return changed

    def of(self, z: int, x: int, y: int) -> Sums:
        """The sums of the cells that a tile shows, its margin included."""
        if z < WIDE:
            return Sums(*self._wide[z].get(x << z | y, _NOTHING))
        version = drawn = changed_us = 0
        x0, x1 = span(z, x)
        y0, y1 = span(z, y)
        for column in range(x0 << ZOOM, (x1 << ZOOM) + 1, 1 << ZOOM):
            for row in range(y0, y1 + 1):
                cell = self._cells.get(column | row)
                if cell is not None:
                    version += cell[0]
                    drawn += cell[1]
                    changed_us += cell[2]
        return Sums(version, drawn, changed_us)

    def __len__(self) -> int:
        return len(self._cells)


@lru_cache(maxsize=20_000)
def _reach(line: int) -> tuple[tuple[int, ...], ...]:
    """By zoom, the columns, or rows, of tiles that show a column, or row, of cells."""
    reach = []
    for z in range(WIDE):
        middle = line >> (ZOOM - z)
        near = range(max(0, middle - 1), min((1 << z) - 1, middle + 1) + 1)
        reach.append(tuple(tile for tile in near if span(z, tile)[0] <= line <= span(z, tile)[1]))
    return tuple(reach)


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
        self._changed: tuple[int, int, int, int] | None = None
        """First column and row, last column and row of cells that changed since ``take_box``."""
        self._anything = False
        """Any cell may have changed since."""
        self._connections = connections
        self._connection: Connection | None = None
        self._asker: Asker | None = None
        self._snapshot = ""
        self.replayed = ""
        """Of a standby, how far it was in the log at the last look."""
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

    async def version(self) -> str:
        """Of the map as of now; equal versions are equal tiles, in whatever process."""
        versions = await self.look()
        sums = versions.of(0, 0, 0)
        return f"{versions.epoch}.{sums.near}.{sums.far}"

    def take_box(self) -> Bounds | None:
        """Where anything changed since this was called last, degrees; None: it may be anywhere.

        For one caller: those who follow the map as it changes (``app.changes.routes``).
        """
        changed, anything = self._changed, self._anything
        self._changed, self._anything = None, False
        if anything or changed is None:
            return None
        left, top, right, bottom = changed
        west, _, _, north = cell_bounds(left << ZOOM | top)
        _, south, east, _ = cell_bounds(right << ZOOM | bottom)
        return west, south, east, north

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
                self._asker.ask(self._snapshot)
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
        look = store.look_answer(answer)
        if look.epoch != self.versions.epoch or _lowest(look.snapshot) < _lowest(self._snapshot):
            self._stop_asking()
            self._read_all()
            return
        self._snapshot, self.replayed = look.snapshot, look.replayed
        if look.cells and self.versions.put(look.cells):
            self.changes += 1
            self._extend_changed([cell[0] for cell in look.cells])
        self._end_look(None)

    def _extend_changed(self, cells: Sequence[int]) -> None:
        columns, rows = [cell >> ZOOM for cell in cells], [cell & _SIDE for cell in cells]
        if self._changed is not None:
            columns += self._changed[::2]
            rows += self._changed[1::2]
        self._changed = (min(columns), min(rows), max(columns), max(rows))

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
        """Read the versions of all cells, on a new connection where there is none."""
        try:
            if self._connection is None:
                self._connection = await self._connections.connect()
                if self._connections.begin is None:
                    await store.prepare_looks(self._connection)
            async with self._connections.transaction(self._connection):
                look = await store.look_at_all(self._connection)
            versions = Versions(look.epoch)
            await asyncio.to_thread(versions.put, look.cells)
        except Exception as error:  # whatever it is, somebody waits
            await self._disconnect()
            self._end_look(error)
            return
        self.versions, self._snapshot, self.replayed = versions, look.snapshot, look.replayed
        self.changes += 1
        self._anything = True
        begin = self._connections.begin
        send = store.send_look if begin is None else partial(store.send_whole_look, begin)
        self._asker = Asker(self._connection, send, self._answered)
        self._end_look(None)

    async def _disconnect(self) -> None:
        if self._connection is not None:
            await end(self._connection)
            self._connection = None


def _lowest(snapshot: str) -> int:
    """The number of the oldest transaction that may have been running."""
    return int(snapshot.partition(":")[0])
