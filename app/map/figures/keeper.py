"""What a worker does for figures that are kept: one of them at a time, when the map has changed since."""

from __future__ import annotations

import time

from app.core.db import Sessions
from app.map.figures import store

LOOK_EVERY_S = 60.0
"""How often a worker looks."""
KEPT_S = 600.0
"""How old figures become before they are made again: a look at a million segments takes a second or two."""


def renew_one(sessions: Sessions) -> bool:
    """Make those figures again that are out of date the longest; whether there were any.

    Two workers may make the same at once; both are right.
    """
    with sessions() as session:
        state_then = store.state(session)
        name = store.due(session, state_then, KEPT_S)
        if name is None:
            return False
        began = time.monotonic()
        rows = store.make(session, name)
        took_s = time.monotonic() - began
    with sessions.begin() as session:
        store.keep(session, name, rows, took_s, state_then)
    return True
