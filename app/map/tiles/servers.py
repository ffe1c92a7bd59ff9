"""The vector tiles of one map by the server that they are made of: the primary, and a hot standby where there is one.

Each has versions and connections of its own, so a tile has the ETag of versions that its own server shows: never one of
newer data. They share what is kept in memory: equal ETags are equal data, on whatever server.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from typing import TypeVar

from app.core.admission import RequestClass
from app.core.db import Bounds
from app.core.settings import Settings
from app.core.standby.use import Standby, from_standby, standby_url
from app.map.tiles.tiles import Tiles

Answer = TypeVar("Answer")


class MapTiles:
    """The tiles of a map in one process; as a map that is watched, it is that of the server which it is read from."""

    def __init__(
        self,
        settings: Settings,
        request_classes: Mapping[str, RequestClass],
        standby: Standby | None = None,
        schema: str | None = None,
    ) -> None:
        """``schema``: as ``Tiles`` has it."""
        self._standby = standby
        self._primary = Tiles(str(settings.database_url), settings, request_classes, schema)
        self._all = [self._primary]
        url = standby_url(settings)
        if standby is not None and url is not None:
            self._all.append(Tiles(url, settings, request_classes, schema, primary=self._primary))
        self._watched = self._primary

    @property
    def now(self) -> Tiles:
        """Those of the server that what is being answered is read from."""
        return self._all[-1] if from_standby() else self._primary

    async def first(self, work: Callable[[], Awaitable[Answer]]) -> Answer:
        """As ``Standby.first``, where there is one."""
        return await (work() if self._standby is None else self._standby.first(work))

    async def version(self) -> str:
        """Of the map as of now; raises what the database says."""
        return await self.first(self._version)

    async def _version(self) -> str:
        self._watched = self.now
        return await self._watched.watch.version()

    def take_box(self) -> Bounds | None:
        """Where anything changed on that server since this was asked last, in degrees; None: it may be anywhere."""
        return self._watched.watch.take_box()

    async def run(self) -> None:
        """Beside the requests, until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            for one in self._all:
                tasks.create_task(one.run())

    async def close(self) -> None:
        """Stop what is under way."""
        for one in self._all:
            await one.close()
