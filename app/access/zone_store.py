"""An owner's zones in the database: what lies in them goes into no edition. Callers own the transaction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

_LIST = text(
    "SELECT name, lon_deg, lat_deg, radius_m FROM owner_zones WHERE owner_id = :owner_id ORDER BY id"
)
# Two who set them at once: the second waits, and its zones alone are there then.
_HOLD = text("SELECT id FROM owners WHERE id = :owner_id FOR NO KEY UPDATE")
_DROP = text("DELETE FROM owner_zones WHERE owner_id = :owner_id")
_ADD = text("""
    INSERT INTO owner_zones (owner_id, name, lon_deg, lat_deg, radius_m)
    VALUES (:owner_id, :name, :lon_deg, :lat_deg, :radius_m)
""")


class Zone(NamedTuple):
    """A place of an owner's, degrees and metres."""

    name: str
    lon_deg: float
    lat_deg: float
    radius_m: float


def zones_of(session: Session, owner_id: int) -> list[Zone]:
    """All of the owner's, as they were given."""
    return [Zone(*row) for row in session.execute(_LIST, {"owner_id": owner_id})]


def set_zones(session: Session, owner_id: int, zones: Sequence[Zone]) -> None:
    """Let the owner have these and no others."""
    session.execute(_HOLD, {"owner_id": owner_id})
    session.execute(_DROP, {"owner_id": owner_id})
    if zones:
        session.execute(_ADD, [{"owner_id": owner_id, **zone._asdict()} for zone in zones])
