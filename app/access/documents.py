"""What the API says of owners, keys and sessions."""

from __future__ import annotations

import uuid
from datetime import date, datetime
from typing import Annotated, Any, Literal, Self

from pydantic import AwareDatetime, BaseModel, Field, StringConstraints

from app.access import store
from app.access.quotas import Standing
from app.core.settings.access import QUOTA_MOST, PublicMap
from app.core.settings.places import MOST_KEEP_DAYS

Name = Annotated[
    str,
    StringConstraints(strip_whitespace=True, min_length=1, max_length=100, pattern=r"^[^\x00-\x1f\x7f]+$"),
]
KeyScope = Literal["live", "upload", "own", "operate"]

_OWNER_EXAMPLE: dict[str, Any] = {"id": 2, "name": "bus fleet"}
_OWNER_DOCUMENT = {
    **_OWNER_EXAMPLE,
    "created_at": "2026-11-27T08:00:00Z",
    "removed_at": None,
    "keys": 12,
    "drives": 340,
    "bytes": 912_004_311,
}
_TODAY_EXAMPLE: dict[str, Any] = {
    "day": "2026-11-27",
    "drives": 14,
    "bytes": 30_120_554,
    "records": 410_220,
    "quota_drives": 100,
    "quota_bytes": None,
    "quota_records": None,
    "until": "2026-11-28T00:00:00Z",
}
_FIGURES_EXAMPLE = {
    **_OWNER_DOCUMENT,
    "quota_drives": 100,
    "quota_bytes": None,
    "quota_records": None,
    "keep_logs_days": None,
    "logs_kept_days": 30,
    "today": _TODAY_EXAMPLE,
}
_KEY_EXAMPLE: dict[str, Any] = {
    "id": "5b6a3f0e-2f0c-4b8e-9a51-0c1d2e3f4a5b",
    "label": "bus 7",
    "scope": "upload",
    "owner": _OWNER_EXAMPLE,
    "created_at": "2026-11-27T08:00:00Z",
    "expires_at": None,
    "last_used_on": "2026-11-27",
    "revoked_at": None,
}

_MADE_EXAMPLE = {"key": _KEY_EXAMPLE, "secret": "vsk_(43 further characters)"}
_NEW_KEY_EXAMPLE = {"label": "bus 7", "scope": "upload", "owner": "bus fleet"}
_SESSION_EXAMPLE: dict[str, Any] = {
    "access": "keys",
    "public_map": "off",
    "public_owners": None,
    "login_provider": False,
    "scope": "own",
    "owner": _OWNER_EXAMPLE,
    "key": {"id": _KEY_EXAMPLE["id"], "label": "my browser"},
    "expires_at": "2026-11-27T20:00:00Z",
}


class OwnerName(BaseModel, json_schema_extra={"examples": [_OWNER_EXAMPLE]}):
    """An owner as others name it."""

    id: int = Field(description="Number of the owner.")
    name: str = Field(description="Its name.")


class Owner(OwnerName, json_schema_extra={"examples": [_OWNER_DOCUMENT]}):
    """A person, a fleet or an office: has keys and drives."""

    created_at: datetime = Field(description="When it was made.")
    removed_at: datetime | None = Field(
        description="When its removal was asked for, which is under way; null: it was not."
    )
    keys: int = Field(description="Its keys that are not revoked.")
    drives: int = Field(description="Its drives.")
    bytes: int = Field(
        description="What their logs took as they were stored, those included that were deleted since."
    )

    @classmethod
    def of(cls, owner: store.Owner) -> Self:
        """The document of an owner."""
        return cls(**vars(owner))


class Today(BaseModel, json_schema_extra={"examples": [_TODAY_EXAMPLE]}):
    """What an owner uploaded today, and what it may."""

    day: date = Field(description="Today, UTC.")
    drives: int = Field(description="Drives uploaded today; those removed since count as well.")
    bytes: int = Field(description="Bytes of these drives, as stored.")
    records: int = Field(
        description="Records of those of these drives that a worker has read: the epochs of the sensor of which a log "
        "has most. However often a drive is computed, they count once."
    )
    quota_drives: int | None = Field(description="Drives that may be uploaded in a day; null: any number.")
    quota_bytes: int | None = Field(description="Bytes that may be uploaded in a day; null: any number.")
    quota_records: int | None = Field(
        description="Records that may be uploaded in a day; null: any number. A drive that is sent before they are "
        "used up is taken whole."
    )
    until: datetime = Field(description="When the count begins anew.")


_OwnQuota = Annotated[
    Annotated[int, Field(strict=True, ge=0, le=QUOTA_MOST)] | None,
    Field(description="Of this owner alone, a day; null: that of all."),
]


_OwnKeeping = Annotated[
    Annotated[int, Field(strict=True, ge=0, le=MOST_KEEP_DAYS)] | None,
    Field(
        description="Days for which logs of this owner are kept after their drives are done or failed; `0`: until the "
        "drive is done, where it failed a day. Results stay, but a drive without its log cannot be computed again. "
        "Null: as the service keeps those of all."
    ),
]


class OwnerFigures(Owner, json_schema_extra={"examples": [_FIGURES_EXAMPLE]}):
    """An owner, what it has, and what it may upload."""

    quota_drives: _OwnQuota
    quota_bytes: _OwnQuota
    quota_records: _OwnQuota
    keep_logs_days: _OwnKeeping
    logs_kept_days: int | None = Field(description="Days that hold for this owner; null: for good.")
    today: Today

    @classmethod
    def standing(cls, owner: store.Owner, now: Standing, keep_logs_days: int | None) -> Self:
        """The document of an owner as it stands now; ``keep_logs_days``: of owners that did not say it."""
        kept = keep_logs_days if owner.keep_logs_days is None else owner.keep_logs_days
        amounts: dict[str, Any] = {one.name: one.used for one in now.amounts}
        amounts |= {f"quota_{one.name}": one.most for one in now.amounts}
        today = Today(day=now.day, until=now.until, **amounts)
        own = {f"quota_{kind}": most for kind, most in now.own._asdict().items()}
        return cls(**vars(owner), **own, logs_kept_days=kept, today=today)


class KeepingChange(BaseModel, extra="forbid", json_schema_extra={"examples": [{"keep_logs_days": 0}]}):
    """What an owner changes of itself; what is not named stays."""

    keep_logs_days: _OwnKeeping = None


class OwnerChange(KeepingChange, json_schema_extra={"examples": [{"quota_drives": 100}]}):
    """What is to be another way; what is not named stays."""

    quota_drives: _OwnQuota = None
    quota_bytes: _OwnQuota = None
    quota_records: _OwnQuota = None


class Owners(BaseModel, json_schema_extra={"examples": [{"owners": [_OWNER_DOCUMENT]}]}):
    """All owners."""

    owners: list[Owner] = Field(description="By name.")


class NewOwner(BaseModel, extra="forbid", json_schema_extra={"examples": [{"name": "bus fleet"}]}):
    """An owner that is to be made."""

    name: Name = Field(description="Its name; no other owner has it.")


class Key(BaseModel, json_schema_extra={"examples": [_KEY_EXAMPLE]}):
    """A key; its secret is told once, to whoever makes it."""

    id: uuid.UUID = Field(description="Stays the same when the key is rotated.")
    label: str = Field(description="What it is for.")
    scope: KeyScope = Field(
        description="`live` sends points of a drive under way, and may stand in an address (`/v1/live`); `upload` "
        "sends drives and sees what became of them, `own` does everything with what is its owner's, `operate` "
        "everything."
    )
    owner: OwnerName = Field(description="Whose it is.")
    created_at: datetime = Field(description="When it was made.")
    expires_at: datetime | None = Field(description="When it stops being good; null: never.")
    last_used_on: date | None = Field(description="The last day on which it was used (UTC); null: on none.")
    revoked_at: datetime | None = Field(description="When it was revoked; null: it was not.")

    @classmethod
    def of(cls, key: store.Key) -> Self:
        """The document of a key."""
        values = {name: value for name, value in vars(key).items() if name not in {"owner_id", "owner"}}
        return cls(**values, owner=OwnerName(id=key.owner_id, name=key.owner))


class Keys(BaseModel, json_schema_extra={"examples": [{"keys": [_KEY_EXAMPLE]}]}):
    """Keys of the caller's owner, or of all."""

    keys: list[Key] = Field(description="By owner and time.")


class NewKey(BaseModel, extra="forbid", json_schema_extra={"examples": [_NEW_KEY_EXAMPLE]}):
    """A key that is to be made."""

    label: Name = Field(description="What it is for.")
    scope: KeyScope = Field(description="What it may do; not more than the caller.")
    owner: Name | None = Field(None, description="Whose it is to be; without it the caller's owner.")
    expires_at: AwareDatetime | None = Field(None, description="When it stops being good; without it never.")


class MadeKey(BaseModel, json_schema_extra={"examples": [_MADE_EXAMPLE]}):
    """A key with its secret."""

    key: Key
    secret: str = Field(description="Send it as `Authorization: Bearer`. It is not told again.")


class KeyOfSession(BaseModel):
    """The key by which the caller is known."""

    id: uuid.UUID
    label: str


class SessionDocument(BaseModel, json_schema_extra={"examples": [_SESSION_EXAMPLE]}):
    """Who the caller is, and what is to be had without a key."""

    access: Literal["keys", "open"] = Field(description="Whether keys are asked for.")
    public_map: PublicMap = Field(description="What of the map is answered without a key.")
    public_owners: int | None = Field(
        description="Owners who have to have driven a segment before it is shown without a key; null: it does not "
        "depend on that."
    )
    login_provider: bool = Field(description="Whether browsers can log in at a provider: `/v1/session/oidc`.")
    scope: KeyScope | None = Field(description="The caller's scope; null: it is nobody.")
    owner: OwnerName | None = Field(description="The caller's owner.")
    key: KeyOfSession | None = Field(description="The caller's key.")
    expires_at: datetime | None = Field(
        description="Until when the session or the key is good; null: no end is set."
    )


class Login(
    BaseModel, extra="forbid", json_schema_extra={"examples": [{"key": "vsk_(43 further characters)"}]}
):
    """What logs a browser in: a key, or the secret of a link."""

    key: str | None = Field(None, max_length=200, description="A key of scope `own` or `operate`.")
    link: str | None = Field(
        None, max_length=200, description="What follows `#link=` in a link that logs in once."
    )
