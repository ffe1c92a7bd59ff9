"""What the database announces, received by one connection for all parts of a process. Knows no subject."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from typing import Protocol

import psycopg
from psycopg import sql

from app.core.settings.places import libpq_url

AGAIN_S = 1.0
"""After a connection that failed."""
CONNECT_TIMEOUT_S = 5

log = logging.getLogger(__name__)


class Hearer(Protocol):
    """A part of the process that is told. What is announced while nothing is received is lost."""

    channel: str

    def begin_hearing(self) -> None:
        """From here on it is told."""

    def hear(self, payload: str) -> None:
        """Something was announced."""

    def stop_hearing(self) -> None:
        """From here on it is told nothing, until it begins again."""


class Announcements:
    """The connection that listens. Lives in the event loop."""

    def __init__(self, url: str | None, hearers: Sequence[Hearer]) -> None:
        """``url``: where announcements are received; None: nowhere, and nobody is ever told."""
        self._url = url
        self._lost = False
        self._hearers = {one.channel: one for one in hearers}

    async def run(self) -> None:
        """Listen until cancelled."""
        while self._url is not None:
            try:
                await self._listen(libpq_url(self._url))
            except psycopg.Error as error:
                if not self._lost:  # once, however long it lasts
                    log.warning("the connection that listens for changes is lost for now: %s", error)
            self._lost = True
            for one in self._hearers.values():
                one.stop_hearing()
            await asyncio.sleep(AGAIN_S)

    async def _listen(self, url: str) -> None:
        async with await psycopg.AsyncConnection.connect(
            url, autocommit=True, connect_timeout=CONNECT_TIMEOUT_S, application_name="versant listens"
        ) as connection:
            for channel in self._hearers:
                await connection.execute(sql.SQL("LISTEN {}").format(sql.Identifier(channel)))
            self._lost = False
            for one in self._hearers.values():
                one.begin_hearing()
            async for note in connection.notifies():
                self._hearers[note.channel].hear(note.payload)
