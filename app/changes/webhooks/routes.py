"""Addresses that are told of events, over HTTP."""

from __future__ import annotations

import uuid
from typing import Annotated

from fastapi import APIRouter, Body, Path, Request, Response

from app.changes.store import horizon, version_text
from app.changes.webhooks import store
from app.changes.webhooks.documents import (
    Delivery,
    MessageAccepted,
    Webhook,
    WebhookChange,
    WebhookCreated,
    WebhookList,
    WebhookRequest,
    WebhookWithDeliveries,
)
from app.changes.webhooks.sending import RefusedError, check_url, new_secret
from app.changes.webhooks.store import SEGMENTS_CHANGED, TEST, WebhookRow
from app.core.errors import BadRequestError
from app.core.http import UNREADABLE_BODY, BaseUrl, Link, Service, ServiceDep, existing, link, problems
from app.core.query import refuse_unknown

MOST = 100
"""Addresses of one service: each is looked after every second."""
SHOWN = 20

WebhookId = Annotated[
    uuid.UUID, Path(description="The webhook's id.", examples=["8f0c8d5e-0d1c-4f43-9a3f-2f6f5c1b7a10"])
]

router = APIRouter(prefix="/v1/webhooks", tags=["changes"])


@router.post(
    "",
    status_code=201,
    summary="Be told of events",
    responses={**UNREADABLE_BODY, **problems(403, 422, 503)},
)
def add(
    request: Request, service: ServiceDep, base: BaseUrl, response: Response, wish: WebhookRequest
) -> WebhookCreated:
    """Let an address be told of events by signed messages (Standard Webhooks: `webhook-id`, `webhook-timestamp`,
    `webhook-signature`). The secret is in this answer only.

    A message is `{type, timestamp, data}`. `segments.changed` says how many segments changed and between which versions
    (`since`, `version`): read which ones at `/v1/changes?since=...`. An answer of 2xx takes a message; else it comes
    again, later and later, with the same `webhook-id`. After days of failures, or a 410, the address is switched off.
    Asking twice makes two.
    """
    refuse_unknown(request, (), BadRequestError)
    _check(service, wish.url)
    secret = new_secret()
    with service.sessions.begin() as session:
        if store.count_webhooks(session) >= MOST:
            raise BadRequestError(
                f"There are {MOST} webhooks already. Remove one that is not needed any more."
            )
        version = version_text(session, horizon(session)) if SEGMENTS_CHANGED in wish.events else None
        box = None if wish.bbox is None else (wish.bbox[0], wish.bbox[1], wish.bbox[2], wish.bbox[3])
        row = store.add_webhook(session, wish.url, secret, wish.events, box, version)
    response.headers["Location"] = f"{base}/v1/webhooks/{row.id}"
    response.headers["Cache-Control"] = "no-store"
    return WebhookCreated(**Webhook.of(row, _links(base, row.id)).model_dump(), secret=secret)


@router.get("", summary="Who is told of events", responses=problems(422, 503))
def list_all(request: Request, service: ServiceDep, base: BaseUrl) -> WebhookList:
    """All addresses that are told of events, the oldest first."""
    refuse_unknown(request, (), BadRequestError)
    with service.reading() as session:
        rows = store.list_webhooks(session)
    webhooks = [Webhook.of(row, _links(base, row.id)) for row in rows]
    return WebhookList(webhooks=webhooks, links=[link(f"{base}/v1/webhooks", "self")])


@router.get("/{webhook_id}", summary="One of them, and its messages", responses=problems(404, 422, 503))
def get(webhook_id: WebhookId, service: ServiceDep, base: BaseUrl) -> WebhookWithDeliveries:
    """The address and what became of its newest messages; those that ended are shown for a week."""
    with service.reading() as session:
        row: WebhookRow = existing(store.get_webhook(session, webhook_id), "webhook", webhook_id)
        deliveries = store.last_deliveries(session, webhook_id, SHOWN)
    document = Webhook.of(row, _links(base, row.id)).model_dump()
    return WebhookWithDeliveries(**document, deliveries=[Delivery.of(one) for one in deliveries])


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
            raise BadRequestError(f"{name}: it cannot be null. Leave it out to keep it.", field=name)
    if wish.url is not None:
        _check(service, wish.url)
    with service.sessions.begin() as session:
        row: WebhookRow = existing(store.get_webhook(session, webhook_id), "webhook", webhook_id)
        changed = row._replace(**changes)
        follows = SEGMENTS_CHANGED in changed.events
        version = (row.reported_version or version_text(session, horizon(session))) if follows else None
        row = store.change_webhook(session, changed._replace(reported_version=version))
    return Webhook.of(row, _links(base, row.id))


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
        row: WebhookRow = existing(store.get_webhook(session, webhook_id), "webhook", webhook_id)
        if not row.active:
            raise BadRequestError('It is switched off. Switch it on first: PATCH with {"active": true}.')
        message = store.add_message(session, webhook_id, TEST, {"webhook_id": str(webhook_id)})
    links = [link(f"{base}/v1/webhooks/{webhook_id}", "monitor", title="What came of it")]
    return MessageAccepted(delivery=f"msg_{message.hex}", links=links)


def _links(base: str, webhook_id: uuid.UUID) -> list[Link]:
    return [link(f"{base}/v1/webhooks/{webhook_id}", "self")]


def _check(service: Service, url: str) -> None:
    try:
        check_url(url, private=service.settings.webhook_private)
    except RefusedError as error:
        raise BadRequestError(f"url: {error}", field="url") from error
