"""What the API says of drives under way."""

from __future__ import annotations

import uuid
from datetime import UTC, datetime
from typing import Any, Self

from pydantic import BaseModel, Field

from app.access.documents import Key, Name
from app.drives.live.points import US
from app.drives.live.store import Seen

_POINT = {"time": "2026-11-27T08:15:04Z", "lat": 48.1013, "lon": 8.2127}
_KEY_ID = "5b6a3f0e-2f0c-4b8e-9a51-0c1d2e3f4a5b"
_STREAM: dict[str, Any] = {
    "key": _KEY_ID,
    "label": "my phone",
    "revoked": False,
    "sender": "owntracks",
    "device": "pixel",
    "seen_at": "2026-11-27T08:15:06Z",
    "seen_ago_s": 12.4,
    "under_way": True,
    "last": _POINT,
    "unusable": 0,
    "unusable_why": None,
    "drive": None,
}
_KEY: dict[str, Any] = {
    "id": _KEY_ID,
    "label": "my phone",
    "scope": "live",
    "owner": {"id": 2, "name": "bus fleet"},
    "created_at": "2026-11-27T08:00:00Z",
    "expires_at": None,
    "last_used_on": None,
    "revoked_at": None,
}
_SENDER = {"name": "owntracks", "title": "OwnTracks"}
_ADDRESS = "https://slopes.example/v1/live/owntracks/vsk_(43 further characters)"


class LastPoint(BaseModel, json_schema_extra={"examples": [_POINT]}):
    """A place and when a device was there."""

    time: datetime = Field(description="By the device's clock.")
    lat: float = Field(description="Degrees.")
    lon: float = Field(description="Degrees.")


class Stream(BaseModel, json_schema_extra={"examples": [_STREAM]}):
    """What one device sends by one key and program."""

    key: uuid.UUID | None = Field(description="The key that it sends with; null: the service asks for none.")
    label: str | None = Field(description="What the key is for.")
    revoked: bool = Field(description="Whether the key is void: it sends no more.")
    sender: str = Field(description="The program, by its name in addresses.")
    device: str = Field(description="As it calls itself; empty: it does not say.")
    seen_at: datetime = Field(description="When it sent something last.")
    seen_ago_s: float = Field(description="Seconds since then, by the service's clock.")
    under_way: bool = Field(description="Whether points of it are in no log yet.")
    last: LastPoint | None = Field(
        description="The last place, of points that are in no log yet; null: there are none."
    )
    unusable: int = Field(description="Points that could not be used.")
    unusable_why: str | None = Field(description="Why the last of them could not.")
    drive: uuid.UUID | None = Field(description="The last drive that was made of it.")

    @classmethod
    def of(cls, seen: Seen) -> Self:
        """The document of a stream."""
        last = None
        if seen.time_us is not None and seen.lat_deg is not None and seen.lon_deg is not None:
            time = datetime.fromtimestamp(seen.time_us / US, UTC)
            last = LastPoint(time=time, lat=seen.lat_deg, lon=seen.lon_deg)
        return cls(**{name: getattr(seen, name) for name in cls.model_fields if name != "last"}, last=last)


class Streams(BaseModel, json_schema_extra={"examples": [{"streams": [_STREAM]}]}):
    """Streams, the last seen in front."""

    streams: list[Stream] = Field(description="A thousand at most.")


class SenderDocument(BaseModel, json_schema_extra={"examples": [_SENDER]}):
    """A program that sends points."""

    name: str = Field(description="In addresses.")
    title: str = Field(description="What it calls itself.")


class Senders(BaseModel, json_schema_extra={"examples": [{"senders": [_SENDER]}]}):
    """The programs that are understood."""

    senders: list[SenderDocument]


class NewAddress(
    BaseModel, extra="forbid", json_schema_extra={"examples": [{"sender": "owntracks", "label": "my phone"}]}
):
    """An address that is to be made."""

    sender: str = Field(max_length=40, description="The program that it is for.")
    label: Name = Field(description="What the device is called, for its owner.")


class MadeAddress(
    BaseModel,
    json_schema_extra={
        "examples": [
            {
                "key": _KEY,
                "address": _ADDRESS,
                "typed": _ADDRESS,
                "link": "owntracks:///config?inline=(settings)",
            }
        ]
    },
):
    """An address that a program sends points to. It is told once: its end is the secret of a key."""

    key: Key = Field(description="Revoke it, and the address is void.")
    address: str = Field(description="The address itself.")
    typed: str = Field(description="What is typed into the program, where that is more than the address.")
    link: str | None = Field(
        description="Opened on the phone it sets the program up; null: the program has none."
    )
