"""The tables of access: owners, their keys, browsers that logged in, links that log one in.

Secrets are kept as SHA-256 alone: whoever reads the database finds no key in it. Statements stand in
``app.access.store``.
"""

from __future__ import annotations

import uuid
from datetime import date, datetime
from typing import Any

import sqlalchemy as sa
from sqlalchemy.orm import Mapped, mapped_column

from app.core.tables import Base, Numbered, goes_with


class OwnerRow(Numbered, Base):
    """A person, a fleet or an office: has keys and drives. The first is the operator."""

    __tablename__ = "owners"

    name: Mapped[str] = mapped_column(unique=True)
    created_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    quota_drives: Mapped[int | None] = mapped_column(sa.BigInteger)
    """Drives that it may upload in a day; NULL: as many as others. ``quota_bytes`` and ``quota_records`` likewise."""
    quota_bytes: Mapped[int | None] = mapped_column(sa.BigInteger)
    quota_records: Mapped[int | None] = mapped_column(sa.BigInteger)
    keep_logs_days: Mapped[int | None]
    """Days for which a log is kept after its drive has ended; NULL: as others'."""
    removed_at: Mapped[datetime | None]
    """When its removal was asked for; the row goes when nothing of the owner is left."""


class OwnerUse(Base):
    """What an owner uploaded on a day (UTC); a drive that is removed counts as well (``app.access.quotas``)."""

    __tablename__ = "owner_use"

    owner_id: Mapped[int] = mapped_column(goes_with("owners"), primary_key=True, autoincrement=False)
    day: Mapped[date] = mapped_column(primary_key=True)
    drives: Mapped[int] = mapped_column(sa.BigInteger)
    bytes: Mapped[int] = mapped_column(sa.BigInteger)
    records: Mapped[int] = mapped_column(sa.BigInteger, server_default="0")
    """Of drives that a worker has read."""


class OwnerZoneRow(Numbered, Base):
    """A place that its owner drew: what he drives near it is told in no edition (``app.releases``)."""

    __tablename__ = "owner_zones"

    owner_id: Mapped[int] = mapped_column(goes_with("owners"), index=True)
    name: Mapped[str]
    lon_deg: Mapped[float]
    lat_deg: Mapped[float]
    radius_m: Mapped[float]
    created_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())

    __table_args__ = (sa.CheckConstraint("radius_m > 0", name="radius"),)


class KeyRow(Base):
    """A key of an owner; it stays when it is revoked, for the audit names it."""

    __tablename__ = "keys"

    id: Mapped[uuid.UUID] = mapped_column(primary_key=True)
    owner_id: Mapped[int] = mapped_column(goes_with("owners"), index=True)
    label: Mapped[str]
    scope: Mapped[str]
    secret_sha256: Mapped[bytes] = mapped_column(unique=True)
    created_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    expires_at: Mapped[datetime | None]
    last_used_on: Mapped[date | None]
    """A day and no more: when somebody sent a drive is not to be read here."""
    revoked_at: Mapped[datetime | None]

    __table_args__ = (sa.CheckConstraint("scope IN ('live', 'upload', 'own', 'operate')", name="scope"),)


class SessionRow(Base):
    """A browser that logged in; the row goes when it logs out."""

    __tablename__ = "sessions"

    secret_sha256: Mapped[bytes] = mapped_column(primary_key=True)
    owner_id: Mapped[int] = mapped_column(goes_with("owners"), index=True)
    scope: Mapped[str]
    key_id: Mapped[uuid.UUID | None] = mapped_column(goes_with("keys"), index=True)
    """The key that it began with, and ends with; NULL: a provider of logins said who it is."""
    created_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    expires_at: Mapped[datetime]

    __table_args__ = (sa.CheckConstraint("scope IN ('own', 'operate')", name="scope"),)


class LoginLinkRow(Base):
    """A link that logs a browser in; the row goes when it is used."""

    __tablename__ = "login_links"

    secret_sha256: Mapped[bytes] = mapped_column(primary_key=True)
    key_id: Mapped[uuid.UUID] = mapped_column(goes_with("keys"), index=True)
    created_at: Mapped[datetime] = mapped_column(server_default=sa.func.now())
    expires_at: Mapped[datetime]


class OwnerRemoval(Base):
    """The receipt of the removal of an owner, which outlasts it: counts and days, and nothing of a person."""

    __tablename__ = "owner_removals"

    id: Mapped[uuid.UUID] = mapped_column(primary_key=True)
    """Known to whoever asked for the removal alone."""
    owner_id: Mapped[int] = mapped_column(sa.BigInteger, unique=True)
    """Numbers of owners are given once."""
    asked_on: Mapped[date]
    ended_on: Mapped[date | None]
    """NULL: it is under way."""
    counts: Mapped[dict[str, Any]]
