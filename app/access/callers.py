"""Who is behind a key or a session: asked of the database once, and kept until the database announces a change.

A process that hears announcements keeps callers for a minute; one whose listening connection is lost asks each time. So
what is revoked is void at once, in every process, and a warm tile costs no query.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Literal

import psycopg
from anyio import CapacityLimiter, to_thread
from sqlalchemy.orm import Session

from app.access import store
from app.access.store import Known
from app.core.caller import SERVICE, as_caller
from app.core.db import Sessions
from app.core.settings.places import libpq_url

CHANNEL = "versant_access"
KEEP_S = 60.0
MOST_KEPT = 10_000
AGAIN_S = 1.0
CONNECT_TIMEOUT_S = 5
THREADS = 2
"""That ask at once: a flood of wrong keys must not take all connections."""

Kind = Literal["key", "session", "proxy"]
_ASK: dict[Kind, Callable[[Session, str], Known | None]] = {
    "key": store.by_key,
    "session": store.by_session,
    "proxy": store.by_proxy,
}

log = logging.getLogger(__name__)


class Callers:
    """The callers that a process of the API knows."""

    def __init__(self, url: str | None, sessions: Sessions) -> None:
        """``url``: where announcements are received; None: nowhere, and whoever shows a key is looked up each time."""
        self._url, self._sessions = url, sessions
        self._kept: dict[tuple[Kind, bytes], tuple[Known, float]] = {}
        self._hears, self._changes = False, 0
        self._threads = CapacityLimiter(THREADS)

    async def find(self, kind: Kind, secret: str) -> Known | None:
        """Whom the secret stands for; None: nobody (any more)."""
        key = (kind, store.hashed(secret))
        if (kept := self._kept.get(key)) is not None and kept[1] > time.monotonic():
            return kept[0] if _is_good(kept[0]) else None
        before = self._changes
        known = await to_thread.run_sync(self._ask, kind, secret, limiter=self._threads)
        if known is not None and self._hears and self._changes == before:
            if len(self._kept) >= MOST_KEPT:
                self._kept.clear()
            self._kept[key] = (known, time.monotonic() + KEEP_S)
        return known

    def _ask(self, kind: Kind, secret: str) -> Known | None:
        with as_caller(SERVICE), self._sessions.begin() as session:
            return _ASK[kind](session, secret)

    async def run(self) -> None:
        """Listen for changes until cancelled."""
        while self._url is not None:
            try:
                await self._listen(libpq_url(self._url))
            except psycopg.Error as error:
                if self._hears:  # once, however long it lasts
                    log.warning("the connection that listens for changes of keys is lost for now: %s", error)
            self._hears = False
            self.forget()
            await asyncio.sleep(AGAIN_S)

    async def _listen(self, url: str) -> None:
        async with await psycopg.AsyncConnection.connect(
            url, autocommit=True, connect_timeout=CONNECT_TIMEOUT_S, application_name="versant access"
        ) as connection:
            await connection.execute(f"LISTEN {CHANNEL}")
            self._hears = True
            self.forget()
            async for _ in connection.notifies():
                self.forget()

    def forget(self) -> None:
        """Ask of all callers anew: something of them changed."""
        self._changes += 1
        self._kept.clear()


def _is_good(known: Known) -> bool:
    return known.expires_at is None or known.expires_at > datetime.now(UTC)
