"""The locks of those who change the map, which end with a transaction, and their claims, which outlast several.

Nobody holds a lock during a computation.

Drives and solvers share the network, any number at once, each for a short transaction. Whoever changes roads or
elevation owns it: an import of roads step by step, a tenth of a second each. Readers need no lock. Claims say who works
on what, so that nothing is computed twice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.claims import Claim, alone, taken
from app.core.db import Sessions
from app.core.telemetry.measures import LOCK_WAIT_S

# Arbitrary constants that no other user of this database takes.
_NETWORK = 0x5653_4E54  # "VSNT"
_HOURS = 0x5653_4852  # "VSHR"

_CELLS, _IMPORT = "cells", "import of roads"
"""Names of claims."""

# Of who waits for one of its rows. Locks that are taken by name are waited for before a row is held.
_ROW_WANTED = text("""
    SELECT EXISTS (
        SELECT FROM pg_locks WHERE NOT granted AND locktype IN ('transactionid', 'tuple')
            AND pg_backend_pid() = ANY(pg_blocking_pids(pid)))
""")
_OWN = text("SELECT pg_advisory_xact_lock(:key)")
_SHARE = text("SELECT pg_advisory_xact_lock_shared(:key)")
_TRY_SHARE = text("SELECT pg_try_advisory_xact_lock_shared(:key)")
_HOUR = text(
    "SELECT pg_advisory_xact_lock(:key, h) FROM (SELECT unnest(CAST(:hours AS integer[])) AS h ORDER BY 1) AS o"
)


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


class WantedError(Exception):
    """Somebody waits for a row that this transaction holds."""


def give_way(session: Session) -> None:
    """Raise ``WantedError``, which is to end the transaction, where somebody waits for a row that it holds."""
    if session.execute(_ROW_WANTED).scalar_one():
        raise WantedError


def roads_change(session: Session) -> bool:
    """Whether an import of roads is running."""
    return bool(taken(session, _IMPORT))


def import_claim(sessions: Sessions) -> Claim:
    """To be held by whoever imports roads: one does at a time, and requires the claim in each step that it writes."""
    return Claim(sessions, _IMPORT)


def cell_claim(sessions: Sessions) -> Claim:
    """Of cells by one solver; what it writes does not depend on it, for a swap compares the cells' versions."""
    return Claim(sessions, _CELLS)


def cells_taken(session: Session) -> set[int]:
    """Cells that some solver has claimed."""
    return taken(session, _CELLS)


@contextmanager
def own_heights(sessions: Sessions, *, wait: bool, look: Callable[[], object]) -> Iterator[bool]:
    """Be the only one that renews heights of segments until the block ends, so that nothing is computed twice.

    Yields whether that is so: without ``wait`` somebody else may be at it. ``look`` is called while it waits, and may
    raise. What is written does not depend on the claim.
    """
    with Claim(sessions, "heights") as claim:
        if wait:
            claim.wait(look)
        yield bool(claim.take())


def releasing_alone(sessions: Sessions) -> AbstractContextManager[Claim | None]:
    """For who makes an edition, which requires the claim where it writes; None: somebody else does."""
    return alone(sessions, "edition")


def deriving_claim(sessions: Sessions) -> Claim:
    """The whole: of who follows changes of segments; other keys: of tiles that are drawn (``app.map.derived.waiting``).

    What is written does not depend on it: who comes too late writes nothing.
    """
    return Claim(sessions, "deriving")
