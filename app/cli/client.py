"""The service seen from outside: the few requests behind ``versant upload``, ``drives`` and the demo.

Knows the API alone, nothing of what is behind it.
"""

from __future__ import annotations

import hashlib
import io
import json
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Self

import httpx

from app.access.folder import KEY_FORM
from app.core.messages import say
from app.core.settings.access import is_loopback
from fusion.errors import FusionError
from fusion.messages import with_key

if TYPE_CHECKING:
    from fusion.types import Progress

FINAL_STATUSES = frozenset({"done", "failed", "cancelled"})
TIMEOUT_S = httpx.Timeout(60.0, connect=5.0)
FIRST_POLL_S, LAST_POLL_S = 0.1, 2.0
"""Pause between two looks at a drive; it grows from the first to the last by halves."""

_TROUBLE: dict[type[Exception], str] = {
    httpx.ConnectError: "client.nobody",
    httpx.TimeoutException: "client.late",
    httpx.InvalidURL: "client.no_url",
    httpx.TransportError: "client.broke",
}
"""Keys of what is said where no answer comes: of the first kind that an error is of."""

BytesSent = Callable[[int], None]
DriveSeen = Callable[["RemoteDrive"], None]


class ClientError(FusionError):
    """The service cannot be reached, or refused a request; the message is for a person."""

    kind = "client"

    def __init__(self, message: str, *, status: int | None = None, retry_after_s: int | None = None) -> None:
        """``status`` of the answer, None where there was none; ``retry_after_s``: when it asks to be asked again."""
        super().__init__(message)
        self.status, self.retry_after_s = status, retry_after_s
        self.is_lost = False
        """Whether no answer came."""


class BadKeyError(ClientError):
    """A text that cannot be a key."""


class RefusedKeyError(ClientError):
    """The service wants a key, or another one."""


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
        reason = document.get("failure_reason")
        if isinstance(failure, dict) and failure.get("reason"):
            reason = with_key(failure["reason"], failure.get("said"))
        progress = float(document.get("progress") or 0.0)
        return cls(
            str(document["id"]), str(document["status"]), document.get("stage"), progress, reason, document
        )

    @property
    def final(self) -> bool:
        """Whether nothing more will happen to it by itself."""
        return self.status in FINAL_STATUSES


@dataclass(frozen=True)
class Sent:
    """What a service made of an upload: drives, what its answer says of each, and of the files that came to nothing."""

    drives: list[RemoteDrive]
    documents: list[dict[str, Any]]
    left_out: list[dict[str, Any]]


def query_of(
    *,
    method: str | None = None,
    options: Mapping[str, Any] | None = None,
    gnss: str | None = None,
    grouping: str | None = None,
) -> dict[str, str]:
    """How an upload is to be computed, as its address says it."""
    asked = {"method": method, "gnss": gnss, "grouping": grouping}
    query = {name: value for name, value in asked.items() if value}
    return query | ({"options": json.dumps(dict(options))} if options else {})


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

    def __init__(
        self, server: str, *, key: str | None = None, transport: httpx.BaseTransport | None = None
    ) -> None:
        """``server`` is the base address, such as ``http://127.0.0.1:8000``; ``transport`` is for tests.

        ``key`` is shown to that server and to no other. Raises ``ClientError`` for an address that cannot be one of a
        service, ``BadKeyError`` for what cannot be a key.
        """
        check_address(server)
        if key is not None and not KEY_FORM.fullmatch(
            key
        ):  # which is not repeated: it may be one with a slip
            raise BadKeyError(say("client.key_form"))
        self.server = server.rstrip("/")
        self._key = _Key(key, self.server) if key else None
        # An address on this machine must never go through a proxy that the environment names for the world.
        self._http = httpx.Client(
            base_url=self.server,
            timeout=TIMEOUT_S,
            transport=transport,
            trust_env=not is_local(self.server),
            auth=self._key,
        )

    @property
    def key_mark(self) -> str:
        """Tells keys apart without showing one; empty without a key."""
        return self._key.mark if self._key else ""

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
        """Stream a log, or the files of one drive, to the service; the first drive of them. Raises as ``send``."""
        return self.send(*paths, method=method, options=options, gnss=gnss, sent=sent).drives[0]

    def send(
        self,
        *paths: Path,
        method: str | None = None,
        options: Mapping[str, Any] | None = None,
        gnss: str | None = None,
        grouping: str | None = None,
        sent: BytesSent | None = None,
    ) -> Sent:
        """Stream files to the service, which makes as many drives of them as they are (``grouping`` as its API has
        it); the same again give the same drives.

        Raises ``ClientError`` when the service refuses it or is not there, ``OSError`` when a file cannot
        be read.
        """
        query = query_of(method=method, options=options, gnss=gnss, grouping=grouping)
        with ExitStack() as stack:
            parts = []
            for path in paths:
                file: BinaryIO = stack.enter_context(path.open("rb"))
                body = _Counted(file, sent) if sent else file
                parts.append(("file", (path.name, body, "application/octet-stream")))
            answer = self.request("POST", "/v1/drives", params=query, files=parts)
        return self.sent(answer.json())

    def sent(self, document: dict[str, Any]) -> Sent:
        """What the answer to an upload says, with its drives as they stand now."""
        parts_of = document.get("drives") or [{"id": document["id"]}]  # of older services
        return Sent(
            [self.drive(str(one["id"])) for one in parts_of], parts_of, document.get("left_out") or []
        )

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
                raise ClientError(say("client.still", id=drive_id, status=drive.status, seconds=timeout_s))
            time.sleep(pause)
            pause = min(LAST_POLL_S, pause * 1.5)

    def features(self, address: str, **params: Any) -> Iterator[dict[str, Any]]:
        """The features of a collection, such as a drive's own estimates, all pages."""
        for page in self.pages(address, params):
            yield from page["features"]

    def get(self, address: str, *, accept: str | None = None) -> httpx.Response:
        """GET an address of the service; an error answer raises ``ClientError`` with its sentence."""
        return self.request("GET", address, headers={"Accept": accept} if accept else None)

    def pages(self, address: str, params: Mapping[str, Any] | None = None) -> Iterator[dict[str, Any]]:
        """The documents of a list, following ``next`` links.

        Each is asked for at the address of the first one: links may name the host under which others reach the service
        (VERSANT_PUBLIC_URL), and the key is for this one.
        """
        following: str | None = address
        while following is not None:
            page = self.request("GET", address, params=params).json()
            yield page
            following = link_of(page, "next")
            params = httpx.URL(following or "").params

    def request(self, verb: str, address: str, **arguments: Any) -> httpx.Response:
        """Ask anything of the service; an error answer raises ``ClientError`` with its sentence."""
        try:
            answer = self._http.request(verb, address, **arguments)
        except (httpx.TransportError, httpx.InvalidURL) as error:
            key = next(key for kind, key in _TROUBLE.items() if isinstance(error, kind))
            reason = str(error) or type(error).__name__
            lost = ClientError(say(key, server=self.server, reason=reason))
            lost.is_lost = isinstance(error, httpx.TransportError)
            raise lost from error
        if (
            answer.next_request is not None
        ):  # not followed: who asked named this server, and the key is for it
            raise ClientError(say("client.sends_on", server=self.server, address=answer.next_request.url))
        if answer.is_error:
            raise self._refusal(answer)
        return answer

    def _refusal(self, answer: httpx.Response) -> ClientError:
        """The sentence of a problem document, or the bare status of anything else; of keys what to do."""
        wish = answer.headers.get("Retry-After", "")
        told: dict[str, int | None] = {
            "status": answer.status_code, "retry_after_s": int(wish) if wish.isdigit() else None,
        }  # fmt: skip
        try:
            problem = answer.json()
            detail = with_key(str(problem["detail"]), problem.get("said"))
            kind = str(problem.get("type", "")).rpartition("/")[2]
        except (ValueError, KeyError, TypeError):
            reason = f"{answer.status_code} {answer.reason_phrase}"
            return ClientError(say("client.answered", reason=reason, address=answer.request.url), **told)
        if kind == "unauthorized":
            key = "client.wrong_key" if self._key else "client.no_key"
            return RefusedKeyError(say(key, server=self.server))
        if kind == "forbidden":
            return RefusedKeyError(say("client.small_key", detail=detail))
        return ClientError(detail, **told)


class _Key(httpx.Auth):
    """Shows the key to one server: no link and no redirect carries it elsewhere."""

    def __init__(self, key: str, server: str) -> None:
        self.mark = hashlib.sha256(key.encode()).hexdigest()[:8]
        self._shown, self._origin = f"Bearer {key}", _origin(httpx.URL(server))

    def auth_flow(self, request: httpx.Request) -> Generator[httpx.Request, httpx.Response]:
        if _origin(request.url) == self._origin:
            request.headers["Authorization"] = self._shown
        yield request


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


def check_address(server: str) -> None:
    """Raise ``ClientError`` for what cannot be the address of a service."""
    try:
        url = httpx.URL(server)
    except httpx.InvalidURL as error:
        raise ClientError(say("client.no_address", server=server, reason=error)) from error
    if url.scheme not in {"http", "https"} or not url.host:
        raise ClientError(say("client.no_service", server=server))


def is_local(server: str) -> bool:
    """Whether an address is one of this machine."""
    return is_loopback(httpx.URL(server).host)


def _origin(url: httpx.URL) -> tuple[str, str, int | None]:
    return url.scheme, url.host, url.port
