"""What a primary and a hot standby say of themselves: how far each is in the write-ahead log, and whose they are."""

from __future__ import annotations

from typing import NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

_SYSTEM = "(SELECT CAST(system_identifier AS text) FROM pg_control_system())"
_WRITTEN = text(f"SELECT CAST(pg_current_wal_lsn() - '0/0' AS bigint), {_SYSTEM}")
_REPLAYED = text(f"""
    SELECT CAST(coalesce(pg_last_wal_replay_lsn(), '0/0') - '0/0' AS bigint), {_SYSTEM}, pg_is_in_recovery()
""")


class Written(NamedTuple):
    """What a primary has written."""

    lsn: int
    """Bytes of log since the beginning: whatever has committed lies before."""
    system: str
    """Which cluster it is; its standbys say the same."""


class Replayed(NamedTuple):
    """What a standby has replayed; all of it is seen by statements that begin from now on."""

    lsn: int
    system: str
    in_recovery: bool
    """Whether it is a standby at all."""


def written(session: Session) -> Written:
    """How far the primary is."""
    return Written(*session.execute(_WRITTEN).one())


def replayed(session: Session) -> Replayed:
    """How far the standby is."""
    return Replayed(*session.execute(_REPLAYED).one())


def unfit(there: Replayed, here: Written) -> str | None:
    """Why nothing can be read there in place of the primary, however close it follows; None: it can."""
    if not there.in_recovery:
        return "It is no standby: it takes changes itself."
    if there.system != here.system:
        return "It is a standby of another database."
    return None
