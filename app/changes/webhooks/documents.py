"""What is said to, and of, addresses that are told of events."""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from app.changes.webhooks.store import EVENTS, DeliveryRow, WebhookRow
from app.core.http import Link
from app.core.text import Moment

Event = Literal["segments.changed", "drive.done", "drive.failed"]
_EXAMPLE_ID = "8f0c8d5e-0d1c-4f43-9a3f-2f6f5c1b7a10"
_EXAMPLE_URL = "https://example.org/versant"
_REQUEST: dict[str, Any] = {
    "url": _EXAMPLE_URL,
    "events": ["segments.changed", "drive.failed"],
    "bbox": [8.46, 48.95, 8.50, 48.99],
}
_EXAMPLE: dict[str, Any] = {
    "id": _EXAMPLE_ID,
    **_REQUEST,
    "active": True,
    "off_reason": None,
    "failures": 0,
    "failing_since": None,
    "last_success_at": "2026-11-20T09:13:02.004Z",
    "created_at": "2026-11-20T08:00:00.000Z",
    "links": [],
}
_DELIVERY: dict[str, Any] = {
    "id": "msg_2f6f5c1b7a104f439a3f8f0c8d5e0d1c",
    "event": "segments.changed",
    "state": "taken",
    "attempts": 1,
    "status": 204,
    "problem": None,
    "created_at": "2026-11-20T09:13:02.004Z",
    "next_at": None,
    "ended_at": "2026-11-20T09:13:02.104Z",
}


def _events(names: list[Event]) -> list[Event]:
    return sorted(set(names), key=list(EVENTS).index)


def _box(corners: list[float]) -> list[float]:
    west, south, east, north = corners
    if not (-180 <= west <= 180 and -180 <= east <= 180 and -90 <= south < north <= 90 and west != east):
        raise ValueError("write west, south, east, north in degrees; west may exceed east, south not north")
    return corners


Events = Annotated[
    list[Event],
    AfterValidator(_events),
    Field(min_length=1, max_length=len(EVENTS), description="What it is told of."),
]
_Corners = Annotated[
    list[Annotated[float, Field(allow_inf_nan=False)]],
    Field(min_length=4, max_length=4),
    AfterValidator(_box),
]
Box = Annotated[
    _Corners | None,
    Field(
        description="West, south, east, north in degrees (west > east: across the antimeridian): only segments, and "
        "drives, that meet it. Null: everywhere.",
    ),
]
Url = Annotated[
    str, Field(min_length=1, max_length=2000, description="Where messages are sent, by POST; https.")
]


class WebhookRequest(BaseModel):
    """An address that wants to be told."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [_REQUEST]})

    url: Url
    events: Events
    bbox: Box = None


class WebhookChange(BaseModel):
    """What is to be another way; what is not named stays."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"active": True}]})

    url: Url | None = None
    events: Events | None = None
    bbox: Box = None
    active: bool | None = Field(
        None, description="Messages are sent to it; true also after it was switched off."
    )


class Webhook(BaseModel):
    """An address that is told of events."""

    model_config = ConfigDict(json_schema_extra={"examples": [_EXAMPLE]})

    id: uuid.UUID
    url: str
    events: list[str]
    bbox: list[float] | None
    active: bool
    off_reason: str | None = Field(description="Why the service switched it off.")
    failures: int = Field(description="In a row.")
    failing_since: Moment | None
    last_success_at: Moment | None
    created_at: Moment
    links: list[Link] = Field(default_factory=list)

    @classmethod
    def of(cls, row: WebhookRow, links: Sequence[Link] = ()) -> Webhook:
        """Build from what the store returns."""
        values = row._asdict()
        del values["reported_version"]
        return cls(**values, links=list(links))


class WebhookCreated(Webhook):
    """The same with its secret, which is not shown again."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{**_EXAMPLE, "secret": "whsec_dGhpcyBpcyBubyBzZWNyZXQsIGJ1dCBhbiBleGFtcGxl"}]
        }
    )

    secret: str = Field(description="Messages are signed by it (Standard Webhooks). It is shown this once.")


class Delivery(BaseModel):
    """A message, and what became of it."""

    id: str = Field(description="The header webhook-id: the same at each attempt.")
    event: str
    state: Literal["waiting", "taken", "given up"]
    attempts: int
    status: int | None = Field(description="HTTP's, of the last attempt; null where there was no answer.")
    problem: str | None = Field(description="What was wrong at the last attempt.")
    created_at: Moment
    next_at: Moment | None = Field(description="It is not sent before; null where it has ended.")
    ended_at: Moment | None

    @classmethod
    def of(cls, row: DeliveryRow) -> Delivery:
        """Build from what the store returns."""
        values = row._asdict()
        due = values.pop("due_at")
        return cls(**values | {"id": f"msg_{row.id.hex}"}, next_at=due if row.state == "waiting" else None)


class WebhookWithDeliveries(Webhook):
    """The same with its newest messages."""

    model_config = ConfigDict(json_schema_extra={"examples": [{**_EXAMPLE, "deliveries": [_DELIVERY]}]})

    deliveries: list[Delivery] = Field(default_factory=list, description="The newest first.")


class WebhookList(BaseModel):
    """All of them."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"webhooks": [_EXAMPLE], "links": []}]})

    webhooks: list[Webhook]
    links: list[Link]


class MessageAccepted(BaseModel):
    """A test message waits."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"delivery": _DELIVERY["id"], "links": []}]})

    delivery: str = Field(description="The message's id.")
    links: list[Link]
