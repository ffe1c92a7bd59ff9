"""Who is behind a key or a session: asked of the database once, and kept until the database announces a change.

A process that hears announcements keeps callers for a minute, and phones, which come once a minute, for longer; one
whose listening connection is lost asks each time. So what is revoked is void at once, in every process, and a warm tile
costs no query.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Literal

from anyio import CapacityLimiter, to_thread
from sqlalchemy.orm import Session

from app.access import store
from app.access.store import Known
from app.core.caller import SERVICE, as_caller
from app.core.db import Sessions

CHANNEL = "versant_access"
KEEP_S, KEEP_LIVE_S = 60.0, 900.0
"""The second: keys of scope ``live``. To ask for one each time doubles what a batch of points costs."""
MOST_KEPT = 20_000
THREADS = 2
"""That ask at once: a flood of wrong keys must not take all connections."""

Kind = Literal["key", "session", "proxy"]
_ASK: dict[Kind, Callable[[Session, str], Known | None]] = {
    "key": store.by_key,
    "session": store.by_session,
    "proxy": store.by_proxy,
}


class Callers:
    """The callers that a process of the API knows."""

    channel = CHANNEL

    def __init__(self, sessions: Sessions) -> None:
        """Until announcements are received, whoever shows a key is looked up each time."""
        self._sessions = sessions
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
            keep_s = KEEP_LIVE_S if known.caller.scope == "live" else KEEP_S
            self._kept[key] = (known, time.monotonic() + keep_s)
        return known

    def _ask(self, kind: Kind, secret: str) -> Known | None:
        with as_caller(SERVICE), self._sessions.begin() as session:
            return _ASK[kind](session, secret)

    def begin_hearing(self) -> None:
        """Keep callers: what changes is announced."""
        self._hears = True
        self.forget()

    def hear(self, payload: str) -> None:
        """Something of a caller changed."""
        self.forget()

    def stop_hearing(self) -> None:
        """Ask each time."""
        self._hears = False
        self.forget()

    def forget(self) -> None:
        """Ask of all callers anew: something of them changed."""
        self._changes += 1
        self._kept.clear()


def _is_good(known: Known) -> bool:
    return known.expires_at is None or known.expires_at > datetime.now(UTC)
