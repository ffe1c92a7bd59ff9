"""A drive's progress as server-sent events. Looks at the row again and again; knows nothing of workers."""

from __future__ import annotations

import time
import uuid
from collections.abc import AsyncIterator

import anyio
from fastapi import APIRouter
from fastapi.responses import StreamingResponse
from starlette.concurrency import run_in_threadpool

from app.core.http import EXAMPLE_ID, BaseUrl, Service, ServiceDep, found, problems
from app.core.text import dumps
from app.drives import store as drives
from app.drives.documents import TERMINAL_STATUSES, Drive, linked

HEARTBEAT_S = 15.0
"""Pauses are filled with comments, because proxies end connections on which nothing moves."""
RECONNECT_MS = 2000
LONGEST_S = 600.0
"""Then the stream ends, and the browser comes again by itself: no connection is held for ever."""

router = APIRouter(prefix="/v1/drives", tags=["drives"])

_EXAMPLE = f'id: 3\nevent: drive\ndata: {{"id": "{EXAMPLE_ID}", "status": "running", "progress": 0.4}}\n\n'


@router.get(
    "/{drive_id}/events",
    summary="Follow a drive",
    response_class=StreamingResponse,
    responses={
        200: {
            "description": "`drive` events; the data are those of `GET /v1/drives/{drive_id}`.",
            "content": {"text/event-stream": {"schema": {"type": "string"}, "example": _EXAMPLE}},
        },
        **problems(404, 503),
    },
)
async def drive_events(drive_id: uuid.UUID, service: ServiceDep, base: BaseUrl) -> StreamingResponse:
    """The state at once, then each change. Ends after `done`, `failed` or `cancelled`; `deleted` if removed.

    A browser's EventSource connects again when the stream ends: close it at a terminal status.
    """
    first = found(await run_in_threadpool(_read, service, base, drive_id), "drive", drive_id)
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    stream = _events(service, base, drive_id, first)
    return StreamingResponse(stream, media_type="text/event-stream", headers=headers)


async def _events(service: Service, base: str, drive_id: uuid.UUID, first: Drive) -> AsyncIterator[str]:
    # When the client leaves, the server cancels this generator at its next await.
    yield f"retry: {RECONNECT_MS}\n\n"
    state: Drive | None = first
    number, sent, started = 0, "", time.monotonic()
    heard = started
    while state is not None:
        text = state.model_dump_json()
        if text != sent:
            number, sent, heard = number + 1, text, time.monotonic()
            yield f"id: {number}\nevent: drive\ndata: {text}\n\n"
        if state.status in TERMINAL_STATUSES or time.monotonic() - started > LONGEST_S:
            return
        if time.monotonic() - heard > HEARTBEAT_S:
            heard = time.monotonic()
            yield ": still here\n\n"
        await anyio.sleep(service.settings.events_poll_s)
        state = await run_in_threadpool(_read, service, base, drive_id)
    data = dumps({"id": str(drive_id), "status": "cancelled"})
    yield f"id: {number + 1}\nevent: deleted\ndata: {data}\n\n"


def _read(service: Service, base: str, drive_id: uuid.UUID) -> Drive | None:
    with service.reading() as session:
        drive = drives.get_drive(session, drive_id)
    return None if drive is None else linked(base, drive)
