"""When cycles of objects that nobody refers to any more are looked for: not while others wait, as far as that goes.

Python's collector goes by how much is made. In an API it so looks every few seconds through half a million objects that
stay for good, and through all that belongs to open event streams; nothing is answered meanwhile, for a quarter of a
second. Here it leaves alone what is there at the start, and looks through all of the rest only when requests have ended
that may have left something: a request leaves some ten objects, one that lasted, as an event stream does, a hundred
and more (30 kB).
"""

from __future__ import annotations

import gc
import time

from starlette.types import ASGIApp, Receive, Scope, Send

THRESHOLDS = (700, 10, 1_000_000)
"""What is young is looked through as ever, which takes a few milliseconds; all of it never by itself."""
COLLECT_AFTER = 20_000
"""Requests: some 20 MB."""
LASTING_S, LASTING_WEIGHT = 1.0, 20
"""From so long on a request has outlived the looks at what is young, and counts as so many."""


def stay_loaded() -> None:
    """Call it when everything is imported and made: that is left alone from here on."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(*THRESHOLDS)


class CollectAfterRequests:
    """Has the cycles collected that requests left, now and then."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self._ended = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and count it."""
        started = time.monotonic()
        try:
            await self.app(scope, receive, send)
        finally:
            self._ended += LASTING_WEIGHT if time.monotonic() - started > LASTING_S else 1
            if self._ended >= COLLECT_AFTER:
                self._ended = 0
                gc.collect()
