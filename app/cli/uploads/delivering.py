"""Files on their way to a service: small ones by one request, a large one in parts that outlive the connection.

A request is asked again where the connection was lost or the service is busy for a moment. Never what is refused.
"""

from __future__ import annotations

import base64
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

from app.cli.client import Client, ClientError, Sent, query_of

MOST_TRIES = 8
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 30.0
"""It doubles from try to try: in all some two minutes."""
LONGEST_WISH_S = 120
"""A service that asks to be left alone for longer is asked no more: its quota of the day is used up."""
BUSY = frozenset({408, 425, 429, 500, 502, 503, 504})
FULL = 507

T = TypeVar("T")


def patiently(ask: Callable[[], T], pause: Callable[[float], None] = time.sleep) -> T:
    """Ask until there is an answer that would be the same again; raises the last ``ClientError``."""
    wait_s = FIRST_PAUSE_S
    for _ in range(MOST_TRIES - 1):
        try:
            return ask()
        except ClientError as error:
            if not (error.is_lost or error.status in BUSY) or (error.retry_after_s or 0) > LONGEST_WISH_S:
                raise
            pause(max(wait_s, error.retry_after_s or 0))
            wait_s = min(LONGEST_PAUSE_S, 2 * wait_s)
    return ask()


def ends_all(error: ClientError) -> bool:
    """Whether what follows would meet the same: nobody answers, nothing more may be sent, there is no room."""
    return error.is_lost or error.status in BUSY or error.status == FULL


IN_PARTS_BYTES = 16 << 20
"""A file of so many is sent in parts (tus 1.0.0): less is sent again sooner than it is asked where it stands."""
PART_BYTES = 8 << 20
TUS = {"Tus-Resumable": "1.0.0"}
WITHOUT_PARTS = frozenset({404, 405, 501})
"""Answers of a service that knows no uploads in parts."""
OTHER_OFFSET = 409


def deliver(
    client: Client,
    paths: tuple[Path, ...],
    computation: dict[str, Any],
    *,
    sent: Callable[[int], None] | None = None,
) -> Sent:
    """Send the files of an upload; raises as ``Client.send``."""
    if len(paths) == 1 and paths[0].stat().st_size >= IN_PARTS_BYTES:
        try:
            return client.sent(_in_parts(client, paths[0], computation, sent or (lambda more: None)))
        except ClientError as error:
            if error.status not in WITHOUT_PARTS:
                raise
    return client.send(*paths, **computation, sent=sent)


def _in_parts(
    client: Client, path: Path, computation: dict[str, Any], sent: Callable[[int], None]
) -> dict[str, Any]:
    """What the service answers when the last byte has come."""
    size = path.stat().st_size
    name = base64.b64encode(path.name.encode()).decode()
    begin = TUS | {"Upload-Length": str(size), "Upload-Metadata": f"filename {name}"}
    answer = patiently(
        lambda: client.request("POST", "/v1/uploads", params=query_of(**computation), headers=begin)
    )
    place = urlsplit(answer.headers["Location"]).path
    one = _Parts(client, place, path, size, sent)
    while not patiently(one.step):
        pass
    document: dict[str, Any] = client.get(place).json()
    return document


class _Parts:
    """One upload in parts, and where it stands as far as that is known."""

    def __init__(
        self, client: Client, place: str, path: Path, size: int, sent: Callable[[int], None]
    ) -> None:
        self._client, self._place, self._path, self._size, self._sent = client, place, path, size, sent
        self._offset: int | None = 0

    def step(self) -> bool:
        """Send the next part; whether it was the last, and something came of all of them."""
        if self._offset is None:
            standing = self._client.request("HEAD", self._place, headers=TUS)
            self._offset = int(standing.headers["Upload-Offset"])
        offset, self._offset = self._offset, None
        with self._path.open("rb") as file:
            file.seek(offset)
            data = file.read(min(PART_BYTES, self._size - offset))
        head = TUS | {"Content-Type": "application/offset+octet-stream", "Upload-Offset": str(offset)}
        try:
            answer = self._client.request("PATCH", self._place, content=data, headers=head)
        except ClientError as error:
            error.is_lost = error.is_lost or error.status == OTHER_OFFSET
            raise
        self._sent(len(data))
        self._offset = int(answer.headers["Upload-Offset"])
        return self._offset == self._size and "Content-Location" in answer.headers
