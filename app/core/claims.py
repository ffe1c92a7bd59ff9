"""Claims: what one holder at a time works on, as rows with an end of their time.

They outlast transactions, and need no connection of their own: a pooler may hand each transaction to another one. They
are taken without waiting, prolonged while the block lasts, and ended with it. The claims of a process that was killed
end after ``CLAIM_S``, or as soon as a worker of its machine finds it dead (``app.jobs.computations``). Whoever loses
one (it was paused, or cut off from the database for so long) is not stopped: what it writes must not depend on the
claim, or ``Claim.require`` has to stand at the beginning of the transaction that writes.
"""

from __future__ import annotations

import logging
import os
import secrets
import socket
import threading
import time
import uuid
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from typing import Self

import numpy as np
from sqlalchemy import text
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.core.messages import say
from fusion.errors import FusionError

logger = logging.getLogger(__name__)

CLAIM_S = 30.0
"""For so long from its last sign a claim is its holder's."""
PROLONG_EVERY_S = 8.0
_AGAIN_S = 1.0
"""After a sign that could not be given."""
_WAIT_S = 0.2
"""Between two looks of one who waits for a claim."""
WHOLE = 0
"""The key of what is claimed as a whole."""

# What is told to the public is solved and derived beside the live map, by the same cells (``app.releases``).
_NAME = "CAST(:name AS text) || ' of ' || current_schema()"
_END = "clock_timestamp() + make_interval(secs => :claim_s)"
_TAKE = text(f"""
    INSERT INTO claims (name, key, holder, process, until)
    SELECT {_NAME}, k, :holder, :process, {_END} FROM unnest(CAST(:keys AS bigint[])) AS k
    WHERE NOT EXISTS (SELECT FROM claims AS c WHERE c.name = {_NAME} AND c.key = k) ORDER BY k
    ON CONFLICT (name, key) DO NOTHING RETURNING key
""")  # noqa: S608 - constants
# Whoever is writing on account of a claim (``_REQUIRE``) keeps it, and is not waited for.
_OVERDUE = text(f"""
    DELETE FROM claims WHERE (name, key) IN (
        SELECT name, key FROM claims WHERE name = {_NAME} AND key = ANY(CAST(:keys AS bigint[]))
            AND until < clock_timestamp() ORDER BY key FOR UPDATE SKIP LOCKED)
    RETURNING key
""")  # noqa: S608 - constants
_PROLONG = text(f"UPDATE claims SET until = {_END} WHERE holder = :holder")  # noqa: S608 - constants
_REQUIRE = text("SELECT key FROM claims WHERE holder = :holder FOR KEY SHARE")
_FREE = text("DELETE FROM claims WHERE holder = :holder OR until < clock_timestamp() - interval '1 hour'")
_FREE_OF = text("DELETE FROM claims WHERE process = ANY(:processes)")
_TAKEN = text(f"SELECT key FROM claims WHERE name = {_NAME} AND until > clock_timestamp()")  # noqa: S608 - constants


def process_name() -> str:
    """Machine and number of this process, and a text that no other process ever has."""
    return _name_of(os.getpid())  # a fork is another process


@cache
def _name_of(number: int) -> str:
    return f"{socket.gethostname()}:{number}:{secrets.token_hex(8)}"


def _nothing() -> None:
    """The callback of whoever wants none."""


class ClaimLostError(FusionError):
    """Somebody else may have taken it over meanwhile: nothing is written on account of it any more."""

    kind = "claim-lost"


class Claim:
    """What one holder has claimed under a name; a context manager that ends all of it."""

    def __init__(self, sessions: Sessions, name: str) -> None:
        self._sessions, self._name, self._holder = sessions, name, uuid.uuid4()
        self.keys: set[int] = set()
        self._over = threading.Event()
        self._beat: threading.Thread | None = None

    def take(self, keys: Collection[int] = (WHOLE,), session: Session | None = None) -> set[int]:
        """Claim those of the keys that nobody has; those that are this holder's now.

        In the transaction of ``session`` where one is given: the claims begin when it is committed.
        """
        wanted = set(keys).difference(self.keys)
        if wanted and session is not None:
            self.keys |= self._take(session, wanted)
        elif wanted:
            with self._sessions.begin() as own:
                taken = self._take(own, wanted)
            self.keys |= taken
        if self.keys and self._beat is None:
            self._beat = threading.Thread(target=self._prolong, name=f"claim of {self._name}", daemon=True)
            self._beat.start()
        return self.keys.intersection(keys)

    def wait(self, look: Callable[[], object] = _nothing) -> None:
        """Claim the whole, however long others have it; ``look`` is called meanwhile, and may raise to end the wait."""
        while not self.take():
            look()
            time.sleep(_WAIT_S)

    def require(self, session: Session) -> None:
        """Keep all that was claimed until the session's transaction ends; ``ClaimLostError`` where it is lost."""
        if not self.keys.issubset(session.execute(_REQUIRE, {"holder": self._holder}).scalars()):
            raise ClaimLostError(say("cli.stood_still", seconds=CLAIM_S, name=self._name))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        if self._beat is None:
            return
        self._beat.join(_AGAIN_S)  # a sign that comes later finds nothing
        with suppress(SQLAlchemyError), self._sessions.begin() as session:  # they end by themselves
            session.execute(_FREE, {"holder": self._holder})

    def _take(self, session: Session, keys: Collection[int]) -> set[int]:
        values = {"name": self._name, "keys": np.array(sorted(keys), np.int64)}
        mine = values | {"holder": self._holder, "process": process_name(), "claim_s": CLAIM_S}
        taken = set(session.execute(_TAKE, mine).scalars())
        if len(taken) < len(keys) and session.execute(_OVERDUE, values).first() is not None:
            taken |= set(session.execute(_TAKE, mine).scalars())
        return taken

    def _prolong(self) -> None:
        pause_s = PROLONG_EVERY_S
        while not self._over.wait(pause_s):
            try:
                with self._sessions.begin() as session:
                    session.execute(_PROLONG, {"holder": self._holder, "claim_s": CLAIM_S})
                pause_s = PROLONG_EVERY_S
            except SQLAlchemyError:
                logger.debug("a claim of %s could not be prolonged", self._name, exc_info=True)
                pause_s = _AGAIN_S


@contextmanager
def alone(sessions: Sessions, name: str) -> Iterator[Claim | None]:
    """Claim the whole for the block; None where somebody else has it."""
    with Claim(sessions, name) as claim:
        yield claim if claim.take() else None


def taken(session: Session, name: str) -> set[int]:
    """Keys that somebody has just now."""
    return set(session.execute(_TAKEN, {"name": name}).scalars())


def free_of(session: Session, processes: Collection[str]) -> None:
    """End what dead processes had claimed."""
    if processes:
        session.execute(_FREE_OF, {"processes": list(processes)})
