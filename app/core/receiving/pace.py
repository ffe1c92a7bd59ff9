"""Bodies at the pace of their clients: small ones are read before the request begins, large ones must not stall."""

from __future__ import annotations

import asyncio
import time

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.core.disconnects import answer_nobody, has_body
from app.core.errors import BodyTooLargeError, SlowClientError
from app.core.messages import say
from app.core.middleware import CHANGING, LIVE_PATH, is_upload
from app.core.problems import refuse

SMALL_BODY_BYTES = 64 * 1024
"""Far above any JSON that a route takes."""
POINTS_BODY_BYTES = 2 * 2**20
"""Of points of a drive under way: a phone that was offline sends a thousand of them at once, 600 bytes each."""
LEAST_PACE_BYTES_PER_S = 1000
"""Of uploads and imports, over the time that is waited for them: a tenth of what the slowest mobile networks carry."""


class Bodies:
    """Reads the body of a change before its request begins; uploads read their own body and must not stall.

    So no request class, thread or connection of the database is held while a body arrives.
    """

    def __init__(self, app: ASGIApp, body_timeout_s: float, upload_stall_s: float) -> None:
        self.app = app
        self._body_timeout_s = body_timeout_s
        self._upload_stall_s = upload_stall_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on with its body, or answer 408 or 413."""
        if scope["type"] != "http" or scope["method"] not in CHANGING or not has_body(scope):
            await self.app(scope, receive, send)
        elif is_upload(scope["path"]):
            await self.app(scope, _paced(receive, self._upload_stall_s), send)
        else:
            await self._read_first(scope, receive, send)

    async def _read_first(self, scope: Scope, receive: Receive, send: Send) -> None:
        most_bytes = POINTS_BODY_BYTES if scope["path"].startswith(LIVE_PATH) else SMALL_BODY_BYTES
        try:
            async with asyncio.timeout(self._body_timeout_s):
                body = await _read_body(receive, most_bytes)
        except TimeoutError:
            message = f"The body was not whole within {self._body_timeout_s:g} s. Send it again."
            await refuse(SlowClientError(message), scope, receive, send)
            return
        if body is None:
            await answer_nobody(send)
        elif len(body) > most_bytes:
            message = f"The body is larger than {most_bytes} bytes. Send less."
            await refuse(BodyTooLargeError(message), scope, receive, send)
        else:
            await self.app(scope, _replayed(body, receive), send)


async def _read_body(receive: Receive, most_bytes: int) -> bytes | None:
    """The body, or its beginning where it is too large; None: the client disconnected."""
    body = bytearray()
    while len(body) <= most_bytes:
        message = await receive()
        if message["type"] != "http.request":
            return None
        body += message.get("body", b"")
        if not message.get("more_body"):
            break
    return bytes(body)


def _replayed(body: bytes, receive: Receive) -> Receive:
    is_replayed = False

    async def again() -> Message:
        nonlocal is_replayed
        if is_replayed:
            return await receive()
        is_replayed = True
        return {"type": "http.request", "body": body, "more_body": False}

    return again


def _paced(receive: Receive, stall_s: float) -> Receive:
    """``receive`` that raises ``SlowClientError`` where too little arrives; only time spent waiting counts."""
    needed, came, waited_s = LEAST_PACE_BYTES_PER_S * stall_s, 0, 0.0

    async def watched() -> Message:
        nonlocal came, waited_s
        began = time.monotonic()
        try:
            async with asyncio.timeout(max(0.0, stall_s - waited_s)):
                message = await receive()
        except TimeoutError:
            raise SlowClientError(say("upload.stalled", seconds=stall_s, bytes=needed)) from None
        waited_s += time.monotonic() - began
        came += len(message.get("body", b""))
        if came >= needed:
            came, waited_s = 0, 0.0
        return message

    return watched
