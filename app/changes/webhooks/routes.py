"""Addresses that are told of events, over HTTP, and what is said to and of them."""

from __future__ import annotations

import uuid
from typing import Annotated, Any, Literal, Self

from fastapi import APIRouter, Body, Path, Request, Response
from pydantic import AfterValidator, BaseModel, Field

from app.changes.store import horizon, version_text
from app.changes.webhooks import store
from app.changes.webhooks.sending import RefusedError, check_url, new_secret
from app.changes.webhooks.store import EVENTS, SEGMENTS_CHANGED, TEST, WebhookRow
from app.core.caller import has_share
from app.core.errors import BadRequestError
from app.core.http import UNREADABLE_BODY, BaseUrl, Link, Service, ServiceDep, existing, link, problems
from app.core.messages import say
from app.core.query import refuse_unknown
from app.core.text import Moment
from fusion.messages import message_of

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
        "drives, that meet it. Null: everywhere."
    ),
]
Url = Annotated[
    str, Field(min_length=1, max_length=2000, description="Where messages are sent, by POST; https.")
]


class WebhookRequest(BaseModel, extra="forbid", json_schema_extra={"examples": [_REQUEST]}):
    """An address that wants to be told."""

    url: Url
    events: Events
    bbox: Box = None


class WebhookChange(BaseModel, extra="forbid", json_schema_extra={"examples": [{"active": True}]}):
    """What is to be another way; what is not named stays."""

    url: Url | None = None
    events: Events | None = None
    bbox: Box = None
    active: bool | None = Field(
        None, description="Messages are sent to it; true also after it was switched off."
    )


class Webhook(BaseModel, json_schema_extra={"examples": [_EXAMPLE]}):
    """An address that is told of events."""

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
    def of(cls, row: WebhookRow, base: str, **more: Any) -> Self:
        """Build from what the store returns, with its link."""
        return cls(**row._asdict(), links=[link(f"{base}/v1/webhooks/{row.id}", "self")], **more)


_WITH_SECRET = {**_EXAMPLE, "secret": "whsec_dGhpcyBpcyBubyBzZWNyZXQsIGJ1dCBhbiBleGFtcGxl"}


class WebhookCreated(Webhook, json_schema_extra={"examples": [_WITH_SECRET]}):
    """The same with its secret, which is not shown again."""

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


class WebhookWithDeliveries(
    Webhook, json_schema_extra={"examples": [{**_EXAMPLE, "deliveries": [_DELIVERY]}]}
):
    """The same with its newest messages."""

    deliveries: list[Delivery] = Field(default_factory=list, description="The newest first.")


class WebhookList(BaseModel, json_schema_extra={"examples": [{"webhooks": [_EXAMPLE], "links": []}]}):
    """Those of an owner, or of all."""

    webhooks: list[Webhook]
    links: list[Link]


class MessageAccepted(
    BaseModel, json_schema_extra={"examples": [{"delivery": _DELIVERY["id"], "links": []}]}
):
    """A test message waits."""

    delivery: str = Field(description="The message's id.")
    links: list[Link]


MOST = 100
"""Addresses of one service: each is looked after every second."""
SHOWN = 20

WebhookId = Annotated[uuid.UUID, Path(description="The webhook's id.", examples=[_EXAMPLE_ID])]

router = APIRouter(prefix="/v1/webhooks", tags=["changes"])


@router.post(
    "", status_code=201, summary="Be told of events", responses={**UNREADABLE_BODY, **problems(403, 422, 503)}
)
def add(
    request: Request, service: ServiceDep, base: BaseUrl, response: Response, wish: WebhookRequest
) -> WebhookCreated:
    """Let an address be told of events by signed messages (Standard Webhooks: `webhook-id`, `webhook-timestamp`,
    `webhook-signature`). The secret is in this answer only.

    A message is `{type, timestamp, data}`. `segments.changed` says how many segments changed and between which versions
    (`since`, `version`): read which ones at `/v1/changes?since=...`. `drive.done` and `drive.failed` are of the drives
    of its owner alone, whose key asks for it; segments change by those of all. An answer of 2xx takes a message; else
    it comes again, later and later, with the same `webhook-id`. After days of failures, or a 410, the address is
    switched off. Asking twice makes two.
    """
    refuse_unknown(request, (), BadRequestError)
    _check(service, wish.url)
    secret = new_secret()
    with service.sessions.begin() as session:
        held, mine = store.count_webhooks(session), len(store.list_webhooks(session))
        if held >= MOST:
            raise BadRequestError(say("webhook.many", most=MOST))
        if not has_share(mine, held, MOST):
            raise BadRequestError(say("webhook.yours", n=mine))
        version = version_text(session, horizon(session)) if SEGMENTS_CHANGED in wish.events else None
        row = store.add_webhook(session, wish.url, secret, wish.events, wish.bbox, version)
    response.headers["Location"] = f"{base}/v1/webhooks/{row.id}"
    response.headers["Cache-Control"] = "no-store"
    return WebhookCreated.of(row, base, secret=secret)


@router.get("", summary="Who is told of events", responses=problems(422, 503))
def list_all(request: Request, service: ServiceDep, base: BaseUrl) -> WebhookList:
    """The addresses of the key's owner that are told of events, the oldest first; with `operate` those of all."""
    refuse_unknown(request, (), BadRequestError)
    with service.reading() as session:
        rows = store.list_webhooks(session)
    links = [link(f"{base}/v1/webhooks", "self")]
    return WebhookList(webhooks=[Webhook.of(row, base) for row in rows], links=links)


@router.get("/{webhook_id}", summary="One of them, and its messages", responses=problems(404, 422, 503))
def get(webhook_id: WebhookId, service: ServiceDep, base: BaseUrl) -> WebhookWithDeliveries:
    """The address and what became of its newest messages; those that ended are shown for a week."""
    with service.reading() as session:
        row = existing(store.get_webhook(session, webhook_id), "webhook", webhook_id)
        deliveries = store.last_deliveries(session, webhook_id, SHOWN)
    return WebhookWithDeliveries.of(row, base, deliveries=deliveries)


@router.patch(
    "/{webhook_id}",
    summary="Change one, or switch it on or off",
    responses={**UNREADABLE_BODY, **problems(403, 404, 422, 503)},
)
def change(
    webhook_id: WebhookId,
    service: ServiceDep,
    base: BaseUrl,
    body: Annotated[WebhookChange | None, Body()] = None,
) -> Webhook:
    """Change what is named; the secret stays. Switched off it misses what happens to drives; of segments it is told all
    at once when it is switched on again.
    """
    wish = body or WebhookChange()
    changes = wish.model_dump(exclude_unset=True)
    for name in ("url", "events", "active"):
        if name in changes and changes[name] is None:
            raise BadRequestError.about(name, say("webhook.not_null"))
    if wish.url is not None:
        _check(service, wish.url)
    with service.sessions.begin() as session:
        row = existing(store.get_webhook(session, webhook_id), "webhook", webhook_id)
        changed = row._replace(**changes)
        follows = SEGMENTS_CHANGED in changed.events
        version = (row.reported_version or version_text(session, horizon(session))) if follows else None
        row = store.change_webhook(session, changed._replace(reported_version=version))
    return Webhook.of(row, base)


@router.delete(
    "/{webhook_id}", status_code=204, summary="Tell it no more", responses=problems(403, 404, 422, 503)
)
def delete(webhook_id: WebhookId, service: ServiceDep) -> None:
    """Forget the address, its secret and its messages; one that is on its way may still arrive."""
    with service.sessions.begin() as session:
        existing(store.delete_webhook(session, webhook_id) or None, "webhook", webhook_id)


@router.post(
    "/{webhook_id}/test",
    status_code=202,
    summary="Send a test message",
    responses=problems(403, 404, 422, 503),
)
def send_test(webhook_id: WebhookId, service: ServiceDep, base: BaseUrl) -> MessageAccepted:
    """Send a message of type `test`; a worker does it, and what came of it is shown with the address."""
    with service.sessions.begin() as session:
        row = existing(store.get_webhook(session, webhook_id), "webhook", webhook_id)
        if not row.active:
            raise BadRequestError(say("webhook.off"))
        message = store.add_message(session, webhook_id, TEST, {"webhook_id": str(webhook_id)})
    links = [link(f"{base}/v1/webhooks/{webhook_id}", "monitor", title="What came of it")]
    return MessageAccepted(delivery=f"msg_{message.hex}", links=links)


def _check(service: Service, url: str) -> None:
    try:
        check_url(url, private=service.settings.webhook_private)
    except RefusedError as error:
        raise BadRequestError.about("url", message_of(error)) from error
