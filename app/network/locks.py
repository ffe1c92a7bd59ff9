"""The locks of those who change the map. Nobody holds one during a computation.

Drives and solvers share the network, any number at once, each for a short transaction. Whoever changes roads or
elevation owns it: an import of roads step by step, a tenth of a second each, and one import at a time. Readers need no
lock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.core.telemetry.measures import LOCK_WAIT_S

# Arbitrary constants that no other user of this database takes.
_NETWORK = 0x5653_4E54  # "VSNT"
_HOURS = 0x5653_4852  # "VSHR"
_CELLS = 0x5653_434C  # "VSCL"
_HEIGHTS = 0x5653_4854  # "VSHT"
_IMPORT = 0x5653_494D  # "VSIM"
_DERIVE = 0x5653_4456  # "VSDV"
_RELEASE = 0x5653_5253  # "VSRS"

# What is told to the public is solved and derived beside the live map, by the same cells (``app.releases``).
_OF_SCHEMA = "CASE current_schema() WHEN 'edition' THEN 1 WHEN 'told' THEN 2 ELSE 0 END + :key"

_OWN = text("SELECT pg_advisory_xact_lock(:key)")
_SHARE = text("SELECT pg_advisory_xact_lock_shared(:key)")
_TRY_SHARE = text("SELECT pg_try_advisory_xact_lock_shared(:key)")
_HOUR = text(
    "SELECT pg_advisory_xact_lock(:key, h) FROM (SELECT unnest(CAST(:hours AS integer[])) AS h ORDER BY 1) AS o"
)
_TRY_CELL = text(f"SELECT pg_try_advisory_lock({_OF_SCHEMA}, :cell)")
_WAIT = text("SELECT pg_advisory_lock(:key)")
_TRY = text("SELECT pg_try_advisory_lock(:key)")
_TRY_OF_SCHEMA = text(f"SELECT pg_try_advisory_lock({_OF_SCHEMA})")
_FREE_ALL = text("SELECT pg_advisory_unlock_all()")


def own_network(session: Session) -> None:
    """Wait for all who share the network, and keep them out until this transaction ends."""
    with LOCK_WAIT_S.timed("own_network"):
        session.execute(_OWN, {"key": _NETWORK})


def share_network(session: Session) -> None:
    """Keep roads and elevation as they are until this transaction ends."""
    with LOCK_WAIT_S.timed("share_network"):
        session.execute(_SHARE, {"key": _NETWORK})


def try_share_network(session: Session) -> bool:
    """The same without waiting; False where somebody owns the network or waits for it."""
    return bool(session.execute(_TRY_SHARE, {"key": _NETWORK}).scalar_one())


def own_hours(session: Session, hours: Iterable[int]) -> None:
    """Keep out whoever adds or removes a drive that was in the same places in the same hours, until this transaction
    ends: such drives can be duplicates, and each has to see the other.

    ``hours`` are numbers of an hour in a place (``app.network.passes.hours_of``).
    """
    with LOCK_WAIT_S.timed("own_hours"):
        session.execute(_HOUR, {"key": _HOURS, "hours": sorted(hours)})


def import_alone(session: Session, waits: Callable[[], None]) -> None:
    """Keep other imports of roads out as long as the session's connection lasts, or until ``free_all``.

    ``waits`` is called before this waits for another import.
    """
    if not session.execute(_TRY, {"key": _IMPORT}).scalar_one():
        waits()
        session.execute(_WAIT, {"key": _IMPORT})


def roads_change(session: Session) -> bool:
    """Whether an import of roads is running."""
    return not session.execute(_TRY_SHARE, {"key": _IMPORT}).scalar_one()


def free_all(session: Session) -> None:
    """Release all locks that the session's connection holds beyond its transactions."""
    session.execute(_FREE_ALL)


class CellClaims:
    """Cells that one solver has claimed for as long as its connection lasts; nobody waits for them."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.cells: set[int] = set()

    def take(self, cell: int) -> bool:
        """Claim a cell; whether this solver has it now."""
        values = {"key": _CELLS, "cell": cell}
        if cell not in self.cells and self._session.execute(_TRY_CELL, values).scalar_one():
            self.cells.add(cell)
        return cell in self.cells


@contextmanager
def _beyond_transactions(sessions: Sessions) -> Iterator[Session]:
    """A session for locks that outlast transactions: all are released at the end, or with the process."""
    with sessions() as session:
        session.connection(execution_options={"isolation_level": "AUTOCOMMIT"})
        try:
            yield session
        finally:
            session.execute(_FREE_ALL)  # else they would go back into the pool with the connection


@contextmanager
def cell_claims(sessions: Sessions) -> Iterator[CellClaims]:
    """Claims that end with the block, or with the process."""
    with _beyond_transactions(sessions) as session:
        yield CellClaims(session)


@contextmanager
def own_heights(sessions: Sessions, *, wait: bool) -> Iterator[bool]:
    """Be the only one that renews heights of segments until the block ends, so that nothing is computed twice.

    Yields whether that is so: without ``wait`` somebody else may be at it. What is written does not depend on it.
    """
    with _beyond_transactions(sessions) as session:
        taken = session.execute(_WAIT if wait else _TRY, {"key": _HEIGHTS}).scalar()
        yield wait or bool(taken)


@contextmanager
def releasing_alone(sessions: Sessions) -> Iterator[bool]:
    """Whether nobody else makes an edition, until the block or the process ends."""
    with _beyond_transactions(sessions) as session:
        yield bool(session.execute(_TRY, {"key": _RELEASE}).scalar_one())


@contextmanager
def deriving_alone(sessions: Sessions) -> Iterator[bool]:
    """Whether nobody else derives, until the block or the process ends. What is written does not depend on it."""
    with _beyond_transactions(sessions) as session:
        yield bool(session.execute(_TRY_OF_SCHEMA, {"key": _DERIVE}).scalar_one())
