"""The service seen from outside: the few requests behind ``versant upload``, ``drives`` and the demo.

Knows the API alone, nothing of what is behind it.
"""

from __future__ import annotations

import io
import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Self

import httpx

from fusion.errors import FusionError

if TYPE_CHECKING:
    from fusion.types import Progress

FINAL_STATUSES = frozenset({"done", "failed", "cancelled"})
TIMEOUT_S = httpx.Timeout(60.0, connect=5.0)
FIRST_POLL_S, LAST_POLL_S = 0.1, 2.0
"""Pause between two looks at a drive; it grows from the first to the last by halves."""

_TROUBLE: dict[type[Exception], str] = {
    httpx.ConnectError: "No Versant service answers at {server}. Start one with `versant up`, or name another with "
    "--server or VERSANT_SERVER.",
    httpx.TimeoutException: "The service at {server} did not answer in time. It may be overloaded; try again.",
    httpx.InvalidURL: "{server!r} is no address: {reason}. Write it as http://host:port.",
    httpx.TransportError: "The connection to {server} broke ({reason}). Try again: what was uploaded completely is not "
    "stored twice.",
}
"""What is said where no answer comes: of the first kind that an error is of."""

BytesSent = Callable[[int], None]
DriveSeen = Callable[["RemoteDrive"], None]


class ClientError(FusionError):
    """The service cannot be reached, or refused a request; the message is for a person."""

    kind = "client"


@dataclass(frozen=True)
class RemoteDrive:
    """A drive as the service describes it; ``document`` is all it said."""

    id: str
    status: str
    stage: str | None
    progress: float
    reason: str | None
    document: dict[str, Any]

    @classmethod
    def read(cls, document: dict[str, Any]) -> Self:
        """Build from the drive's JSON document."""
        failure = document.get("failure")
        reason = failure.get("reason") if isinstance(failure, dict) else document.get("failure_reason")
        progress = float(document.get("progress") or 0.0)
        return cls(
            str(document["id"]), str(document["status"]), document.get("stage"), progress, reason, document
        )

    @property
    def final(self) -> bool:
        """Whether nothing more will happen to it by itself."""
        return self.status in FINAL_STATUSES


def link_of(document: Mapping[str, Any], rel: str, kind: str | None = None) -> str | None:
    """The address of the document's link of that relation and, if given, media type; None without one."""
    links = (
        one for one in document.get("links", ()) if one["rel"] == rel and kind in (None, one.get("type"))
    )
    return next((str(one["href"]) for one in links), None)


def shown(progress: Progress) -> DriveSeen:
    """Drive a progress bar from what ``Client.wait`` sees."""
    return lambda drive: progress(drive.stage or drive.status, drive.progress)


class Client:
    """Requests to one service; use as a context manager."""

    def __init__(self, server: str, *, transport: httpx.BaseTransport | None = None) -> None:
        """``server`` is the base address, such as ``http://127.0.0.1:8000``; ``transport`` is for tests.

        Raises ``ClientError`` for an address that cannot be one of a service.
        """
        _check_address(server)
        self.server = server.rstrip("/")
        # An address on this machine must never go through a proxy that the environment names for the world.
        self._http = httpx.Client(
            base_url=self.server, timeout=TIMEOUT_S, transport=transport, trust_env=not _is_local(self.server)
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._http.close()

    def upload(
        self,
        *paths: Path,
        method: str | None = None,
        options: Mapping[str, Any] | None = None,
        gnss: str | None = None,
        sent: BytesSent | None = None,
    ) -> RemoteDrive:
        """Stream a log, or the files that belong to one drive, to the service; the same again give the same drive.

        Raises ``ClientError`` when the service refuses it or is not there, ``OSError`` when a file cannot
        be read.
        """
        query = {name: value for name, value in (("method", method), ("gnss", gnss)) if value}
        if options:
            query["options"] = json.dumps(dict(options))
        with ExitStack() as stack:
            parts = []
            for path in paths:
                file: BinaryIO = stack.enter_context(path.open("rb"))
                body = _Counted(file, sent) if sent else file
                parts.append(("file", (path.name, body, "application/octet-stream")))
            answer = self.request("POST", "/v1/drives", params=query, files=parts)
        return self.drive(str(answer.json()["id"]))

    def drive(self, drive_id: str) -> RemoteDrive:
        """The drive as it stands now."""
        return RemoteDrive.read(self.request("GET", f"/v1/drives/{drive_id}").json())

    def wait(
        self, drive_id: str, *, seen: DriveSeen | None = None, timeout_s: float | None = None
    ) -> RemoteDrive:
        """Follow a drive until it is done, failed or cancelled; ``seen`` gets each state on the way.

        Raises ``ClientError`` after ``timeout_s`` seconds (None: never).
        """
        started, pause = time.monotonic(), FIRST_POLL_S
        while True:
            drive = self.drive(drive_id)
            if seen:
                seen(drive)
            if drive.final:
                return drive
            if timeout_s is not None and time.monotonic() - started > timeout_s:
                raise ClientError(
                    f"Drive {drive_id} is still {drive.status} after {timeout_s:.0f} s. It goes on by "
                    "itself: look again later, and whether a worker runs."
                )
            time.sleep(pause)
            pause = min(LAST_POLL_S, pause * 1.5)

    def features(self, address: str, **params: Any) -> Iterator[dict[str, Any]]:
        """The features of a collection, such as a drive's own estimates, all pages."""
        for page in self.pages(address, params):
            yield from page["features"]

    def get(self, address: str, *, accept: str | None = None) -> httpx.Response:
        """GET an address of the service; an error answer raises ``ClientError`` with its sentence."""
        return self.request("GET", address, headers={"Accept": accept} if accept else None)

    def pages(self, address: str | None, params: Mapping[str, Any] | None = None) -> Iterator[dict[str, Any]]:
        """The documents of a list, following ``next`` links."""
        while address is not None:
            page = self.request("GET", address, params=params).json()
            yield page
            address, params = link_of(page, "next"), None

    def request(self, verb: str, address: str, **arguments: Any) -> httpx.Response:
        """Ask anything of the service; an error answer raises ``ClientError`` with its sentence."""
        try:
            answer = self._http.request(verb, address, **arguments)
        except (httpx.TransportError, httpx.InvalidURL) as error:
            sentence = next(text for kind, text in _TROUBLE.items() if isinstance(error, kind))
            reason = str(error) or type(error).__name__
            raise ClientError(sentence.format(server=self.server, reason=reason)) from error
        if answer.is_error:
            raise ClientError(_refusal(answer))
        return answer


class _Counted(io.RawIOBase):
    """A file that reports how many bytes were read from it."""

    def __init__(self, file: BinaryIO, sent: BytesSent) -> None:
        self._file, self._sent = file, sent

    def read(self, size: int = -1) -> bytes:
        data = self._file.read(size)
        self._sent(len(data))
        return data

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def fileno(self) -> int:
        return self._file.fileno()


def _check_address(server: str) -> None:
    try:
        url = httpx.URL(server)
    except httpx.InvalidURL as error:
        raise ClientError(
            f"{server!r} is no address: {error}. Write it as http://host:port or https://host."
        ) from error
    if url.scheme not in {"http", "https"} or not url.host:
        raise ClientError(
            f"{server!r} is no address of a service. Write it as http://host:port or https://host."
        )


def _is_local(server: str) -> bool:
    return httpx.URL(server).host in {"127.0.0.1", "localhost", "::1"}


def _refusal(answer: httpx.Response) -> str:
    """The sentence of a problem document, or the bare status of anything else."""
    try:
        problem = answer.json()
        return str(problem["detail"])
    except (ValueError, KeyError, TypeError):
        return f"The service answered {answer.status_code} {answer.reason_phrase} to {answer.request.url}."
