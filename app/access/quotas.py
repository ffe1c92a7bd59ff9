"""What an owner may upload in a day (UTC): counted where a drive is made, looked at before a body is read.

The count is a row of the owner and the day, changed in the transaction that makes the drive. Whoever changes it holds
it until that transaction ends, so that uploads of one owner pass one after the other and never together beyond a quota.
One that is refused or fails takes its own count back. A removed drive stays counted.

How many records a log has is known when a worker has read it, and is counted then. So nobody begins an upload once the
quota of records is used up, but one that was begun below it is taken whole.
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


class OwnQuotas(NamedTuple):
    """The quotas of one owner; None: those of all."""

    drives: int | None
    bytes: int | None
    records: int | None


KINDS = OwnQuotas._fields
"""What is counted: columns, settings and members of documents are called so, quotas with ``quota_`` before it."""
_UNITS = {"bytes": "content-bytes", "records": "records"}
"""As header fields call what is not requests; none that is registered means records."""

_ADD = text(f"""
    INSERT INTO owner_use AS u (owner_id, day, {", ".join(KINDS)})
    VALUES (:owner_id, :day, {", ".join(f":{kind}" for kind in KINDS)})
    ON CONFLICT (owner_id, day) DO UPDATE SET {", ".join(f"{kind} = u.{kind} + excluded.{kind}" for kind in KINDS)}
""")  # noqa: S608 - constants
_STANDING = text(f"""
    SELECT {", ".join(f"o.quota_{kind}, coalesce(u.{kind}, 0) AS {kind}" for kind in KINDS)}
    FROM owners AS o LEFT JOIN owner_use AS u ON u.owner_id = o.id AND u.day = :day WHERE o.id = :owner_id
""")  # noqa: S608 - constants
_FORGET = text("DELETE FROM owner_use WHERE day < CAST(now() - make_interval(secs => :age_s) AS date)")
_SET = text(f"""
    UPDATE owners SET {", ".join(f"quota_{kind} = :{kind}" for kind in KINDS)} WHERE id = :owner_id
""")  # noqa: S608 - constants


class Amount(NamedTuple):
    """Of one kind: how much was uploaded, and how much may be; None: any number."""

    name: str
    used: int
    most: int | None

    @property
    def left(self) -> int:
        """How much may still be uploaded, where there is a quota."""
        return max(0, (self.most or 0) - self.used)

    @property
    def policy(self) -> str:
        """The quota as a header field says it."""
        unit = f';qu="{_UNITS[self.name]}"' if self.name in _UNITS else ""
        return f'"{self.name}";q={self.most}{unit};w={DAY_S}'


@dataclass(frozen=True)
class Standing:
    """What an owner has uploaded on the day of ``at``, and what it may."""

    at: datetime
    amounts: tuple[Amount, ...]
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
        return [one for one in self.amounts if one.most is not None]

    @property
    def headers(self) -> dict[str, str]:
        """What a client is told (draft-ietf-httpapi-ratelimit-headers-11); nothing where there is no quota."""
        if not self.quotas:
            return {}
        wait_s = self._wait_s
        limits = (f'"{one.name}";r={one.left};t={wait_s}' for one in self.quotas)
        policies = (one.policy for one in self.quotas)
        return {"RateLimit-Policy": ", ".join(policies), "RateLimit": ", ".join(limits)}

    def without(self, counted: Mapping[str, int]) -> Standing:
        """As it was before so much was counted."""
        amounts = (one._replace(used=one.used - counted.get(one.name, 0)) for one in self.amounts)
        return replace(self, amounts=tuple(amounts))

    def require(self, wanted: Mapping[str, int]) -> None:
        """``QuotaError`` unless so much may still be uploaded; of a kind that is not named, anything at all."""
        for one in self.amounts:
            if one.most is not None and one.used + wanted.get(one.name, 1) > one.most:
                headers = {**self.headers, "Retry-After": str(self._wait_s)}
                refusal = self._refusal(one, one.most, wanted.get(one.name))
                raise QuotaError(refusal, quota=one.name, headers=headers)

    @property
    def _wait_s(self) -> int:
        return math.ceil((self.until - self.at).total_seconds())

    def _refusal(self, quota: Amount, most: int, more: int | None) -> str:
        figures = f"You may upload {most} {quota.name} a day: {quota.used} were uploaded today"
        figures += "." if more is None else f", this is {more} more."
        if (more or 1) > most:
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
        self._last.require(_drive_of(max(1, least_bytes)))

    def count(self, session: Session, size_bytes: int) -> None:
        """Count a drive that the transaction makes; ``QuotaError`` where that is too much: it is to be undone then.

        The transaction is the owner's, not of a key that may only upload.
        """
        now, drive = utc_now(), _drive_of(size_bytes)
        _add(session, self._owner_id, now.date(), drive)
        self._last = standing(session, self._settings, self._owner_id, now)
        self._last.without(drive).require(drive)


def utc_now() -> datetime:
    """The clock of quotas."""
    return datetime.now(UTC)


def count_records(session: Session, owner_id: int, day: date, records: int) -> None:
    """Count what a worker found in a log that the owner uploaded on that day, whatever is left of the quota.

    The owner's uploads wait until the transaction ends.
    """
    _add(session, owner_id, day, {"records": records})


def forget_use(session: Session, age_s: float) -> None:
    """Forget what owners uploaded on days of so long ago."""
    session.execute(_FORGET, {"age_s": age_s})


def standing(session: Session, settings: Settings, owner_id: int, now: datetime) -> Standing:
    """How the owner stands on the day of ``now``."""
    row = session.execute(_STANDING, {"owner_id": owner_id, "day": now.date()}).one()._mapping
    own = OwnQuotas._make(row[f"quota_{kind}"] for kind in KINDS)
    of_all = OwnQuotas._make(getattr(settings, f"quota_{kind}") for kind in KINDS)
    if _operates(owner_id):
        of_all = OwnQuotas(None, None, None)
    most = (a if a is not None else b for a, b in zip(own, of_all, strict=True))
    amounts = (Amount(kind, row[kind], one) for kind, one in zip(KINDS, most, strict=True))
    return Standing(now, tuple(amounts), own)


def _drive_of(size_bytes: int) -> dict[str, int]:
    """What an upload counts at once; its records are counted when they are known."""
    return {"drives": 1, "bytes": size_bytes}


def _add(session: Session, owner_id: int, day: date, counted: Mapping[str, int]) -> None:
    session.execute(_ADD, {"owner_id": owner_id, "day": day, **dict.fromkeys(KINDS, 0), **counted})


def _operates(owner_id: int) -> bool:
    """Whether it is the operator, or whom the caller uploads for as one: those have no quotas but their own."""
    caller = present_caller()
    return owner_id == OPERATOR_OWNER or (owner_id == caller.owner_id and caller.may("operate"))


def set_quotas(session: Session, owner_id: int, own: OwnQuotas) -> None:
    """Give the owner quotas of its own."""
    session.execute(_SET, {"owner_id": owner_id, **own._asdict()})
