"""When a request is asked again: the connection was lost, the service is busy for a moment. Never what is refused."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

from app.cli.client import ClientError

MOST_TRIES = 8
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 30.0
"""It doubles from try to try: in all some two minutes."""
LONGEST_WISH_S = 120
"""A service that asks to be left alone for longer is asked no more: its quota of the day is used up."""
BUSY = frozenset({408, 425, 429, 500, 502, 503, 504})
FULL = 507

T = TypeVar("T")


def patiently(ask: Callable[[], T], pause: Callable[[float], None] = time.sleep) -> T:
    """Ask until there is an answer that would be the same again; raises the last ``ClientError``."""
    wait_s = FIRST_PAUSE_S
    for _ in range(MOST_TRIES - 1):
        try:
            return ask()
        except ClientError as error:
            if not (error.is_lost or error.status in BUSY) or (error.retry_after_s or 0) > LONGEST_WISH_S:
                raise
            pause(max(wait_s, error.retry_after_s or 0))
            wait_s = min(LONGEST_PAUSE_S, 2 * wait_s)
    return ask()


def ends_all(error: ClientError) -> bool:
    """Whether what follows would meet the same: nobody answers, nothing more may be sent, there is no room."""
    return error.is_lost or error.status in BUSY or error.status == FULL
