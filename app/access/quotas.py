"""What an owner may upload in a day (UTC): counted where a drive is made, looked at before a body is read.

The count is a row of the owner and the day, changed in the transaction that makes the drive. Whoever changes it holds
it until that transaction ends, so that uploads of one owner pass one after the other and never together beyond a quota.
One that is refused or fails takes its own count back. A removed drive stays counted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, time, timedelta
from typing import NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.caller import OPERATOR_OWNER, as_caller, present_caller
from app.core.db import Sessions
from app.core.errors import QuotaError
from app.core.settings import Settings

DAY_S = 86_400

_COUNT = text("""
    INSERT INTO owner_use AS u (owner_id, day, drives, bytes) VALUES (:owner_id, :day, 1, :bytes)
    ON CONFLICT (owner_id, day) DO UPDATE SET drives = u.drives + 1, bytes = u.bytes + excluded.bytes
""")
_STANDING = text("""
    SELECT o.quota_drives, o.quota_bytes, coalesce(u.drives, 0) AS drives, coalesce(u.bytes, 0) AS bytes
    FROM owners AS o LEFT JOIN owner_use AS u ON u.owner_id = o.id AND u.day = :day WHERE o.id = :owner_id
""")
_SET = text("UPDATE owners SET quota_drives = :drives, quota_bytes = :bytes WHERE id = :owner_id")


class Amount(NamedTuple):
    """Of one kind: how much was uploaded, and how much may be; None: any number."""

    name: str
    used: int
    most: int | None
    unit: str | None = None
    """As the header field calls it; None: requests."""

    @property
    def left(self) -> int:
        """How much may still be uploaded, where there is a quota."""
        return max(0, (self.most or 0) - self.used)


class OwnQuotas(NamedTuple):
    """The quotas of one owner; None: those of all."""

    drives: int | None
    bytes: int | None


@dataclass(frozen=True)
class Standing:
    """What an owner has uploaded on the day of ``at``, and what it may."""

    at: datetime
    drives: Amount
    bytes: Amount
    own: OwnQuotas

    @property
    def day(self) -> date:
        """The day, UTC."""
        return self.at.date()

    @property
    def until(self) -> datetime:
        """When the quotas begin anew."""
        return datetime.combine(self.day + timedelta(days=1), time(), UTC)

    @property
    def quotas(self) -> list[Amount]:
        """Those that there are."""
        return [one for one in (self.drives, self.bytes) if one.most is not None]

    @property
    def headers(self) -> dict[str, str]:
        """What a client is told (draft-ietf-httpapi-ratelimit-headers-11); nothing where there is no quota."""
        if not self.quotas:
            return {}
        wait_s = self._wait_s
        policies = (
            f'"{one.name}";q={one.most}' + (f';qu="{one.unit}"' if one.unit else "") + f";w={DAY_S}"
            for one in self.quotas
        )
        limits = (f'"{one.name}";r={one.left};t={wait_s}' for one in self.quotas)
        return {"RateLimit-Policy": ", ".join(policies), "RateLimit": ", ".join(limits)}

    def without(self, size_bytes: int) -> Standing:
        """As it was before a drive of that size was counted."""
        drives, of_bytes = self.drives, self.bytes
        return replace(
            self,
            drives=drives._replace(used=drives.used - 1),
            bytes=of_bytes._replace(used=of_bytes.used - size_bytes),
        )

    def require(self, size_bytes: int) -> None:
        """``QuotaError`` unless a drive of that size may still be uploaded."""
        for one, more in ((self.drives, 1), (self.bytes, size_bytes)):
            if one.most is not None and one.used + more > one.most:
                headers = {**self.headers, "Retry-After": str(self._wait_s)}
                raise QuotaError(self._refusal(one, one.most, more), quota=one.name, headers=headers)

    @property
    def _wait_s(self) -> int:
        return math.ceil((self.until - self.at).total_seconds())

    def _refusal(self, quota: Amount, most: int, more: int) -> str:
        figures = f"You may upload {most} {quota.name} a day: {quota.used} were uploaded today, this is {more} more."
        if more > most:
            return f"{figures} No day has room for it. Send less, or ask whoever runs the service for more."
        return f"{figures} The count begins anew at {self.until:%Y-%m-%d %H:%M} UTC. Send it again then."


class Quotas:
    """Those of the present caller's owner, for one upload: ``look`` before its body is read, ``count`` the drive."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._caller = present_caller().as_owner
        assert self._caller.owner_id is not None  # noqa: S101 - whoever may upload has an owner
        self._owner_id = self._caller.owner_id
        self._last: Standing | None = None

    @property
    def headers(self) -> Mapping[str, str]:
        """What the client is told, as the owner stood last."""
        return {} if self._last is None else self._last.headers

    def look(self, sessions: Sessions, least_bytes: int) -> None:
        """``QuotaError`` where an upload of at least so many bytes cannot be taken: nothing of it need be read then."""
        with as_caller(self._caller), sessions() as session:
            self._last = standing(session, self._settings, self._owner_id, utc_now())
        self._last.require(max(1, least_bytes))

    def count(self, session: Session, size_bytes: int) -> None:
        """Count a drive that the transaction makes; ``QuotaError`` where that is too much: it is to be undone then.

        The transaction is the owner's, not of a key that may only upload.
        """
        now = utc_now()
        session.execute(_COUNT, {"owner_id": self._owner_id, "day": now.date(), "bytes": size_bytes})
        self._last = standing(session, self._settings, self._owner_id, now)
        self._last.without(size_bytes).require(size_bytes)


def utc_now() -> datetime:
    """The clock of quotas."""
    return datetime.now(UTC)


def standing(session: Session, settings: Settings, owner_id: int, now: datetime) -> Standing:
    """How the owner stands on the day of ``now``."""
    row = session.execute(_STANDING, {"owner_id": owner_id, "day": now.date()}).one()
    own = OwnQuotas(row.quota_drives, row.quota_bytes)
    of_all = OwnQuotas(settings.quota_drives, settings.quota_bytes)
    if _operates(owner_id):
        of_all = OwnQuotas(None, None)
    drives, most_bytes = (a if a is not None else b for a, b in zip(own, of_all, strict=True))
    return Standing(
        now,
        Amount("drives", row.drives, drives),
        Amount("bytes", row.bytes, most_bytes, "content-bytes"),
        own,
    )


def _operates(owner_id: int) -> bool:
    """Whether it is the operator, or whom the caller uploads for as one: those have no quotas but their own."""
    caller = present_caller()
    return owner_id == OPERATOR_OWNER or (owner_id == caller.owner_id and caller.may("operate"))


def set_quotas(session: Session, owner_id: int, own: OwnQuotas) -> None:
    """Give the owner quotas of its own."""
    session.execute(_SET, {"owner_id": owner_id, **own._asdict()})
