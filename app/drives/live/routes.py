"""Drives under way over HTTP: the room that programs send points to, and what their owner sees of it."""

from __future__ import annotations

import time
from typing import Annotated, Any

from fastapi import APIRouter, Path, Request, Response
from starlette.concurrency import run_in_threadpool

from app.access.documents import Key
from app.access.quotas import Quotas
from app.access.routes import MOST_KEYS
from app.access.store import create_key, list_keys, own_id
from app.core.caller import present_caller
from app.core.errors import BadRequestError, CrossOriginWriteError, QuotaError, TooManyError
from app.core.http import (
    UNREADABLE_BODY,
    BaseUrl,
    Service,
    ServiceDep,
    existing,
    problems,
    quota_used_up,
)
from app.core.messages import say
from app.core.telemetry import audit
from app.core.telemetry.audit import Origin
from app.drives.live import store
from app.drives.live.documents import MadeAddress, NewAddress, SenderDocument, Senders, Stream, Streams
from app.drives.live.points import Batch
from app.drives.live.senders import SENDERS
from app.drives.live.senders.base import Message, Sender

router = APIRouter(prefix="/v1/live", tags=["live"])

MOST_LISTED = 1000
LOOK_AT_QUOTA_EVERY_S = 10.0
MOST_OWNERS = 100_000

SenderName = Annotated[
    str, Path(description="The program that sends: see `/v1/live/senders`.", examples=["owntracks"])
]
Capability = Annotated[
    str,
    Path(
        description="A key of scope `live`: an address that holds one lets whoever has it add points, and no more.",
        examples=["vsk_(43 further characters)"],
    ),
]
_WHAT = """Add points, one or thousands, in the form of the program.

Points that are there already are passed over: programs may send them again, in any order, and hours late. What cannot
be used of a message (a time of another century, a place off the Earth) is counted and left out; only where nothing is
left, and the program does not insist, the answer is 422 with the first point at fault. After 15 minutes of silence
(VERSANT_LIVE_SILENCE_S), or before a gap, the points become a drive like any that is uploaded."""
_ANSWERS: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "What the program waits for.",
        "content": {
            "application/json": {"schema": {"type": "object"}, "example": {"result": "ok"}},
            "text/plain": {"schema": {"type": "string"}, "example": "OK"},
        },
    },
    **problems(401, 403, 404, 413, 422, 503),
    **quota_used_up(
        "You may upload 100 drives a day: 100 were uploaded today. The count begins anew at 2026-11-28 00:00 UTC. "
        "Send it again then.",
        {},
    ),
}
_BODY = {
    "requestBody": {
        "required": False,
        "description": "What the program sends: JSON, or a form.",
        "content": {
            "application/json": {
                "schema": {"type": "object"},
                "example": {"_type": "location", "tst": 1764231304, "lat": 48.1, "lon": 8.2},
            }
        },
    }
}


class QuotaLooks:
    """Looks whether owners may still send, each once in a while: a point need not wait for that."""

    def __init__(self) -> None:
        self._until: dict[int | None, float] = {}

    def look(self, service: Service) -> None:
        """``QuotaError`` where the caller's owner has used its quota up."""
        owner_id = present_caller().owner_id
        if self._until.get(owner_id, 0.0) > time.monotonic():
            return
        Quotas(service.settings).look(service.sessions, 1)
        if len(self._until) >= MOST_OWNERS:
            self._until.clear()
        self._until[owner_id] = time.monotonic() + LOOK_AT_QUOTA_EVERY_S


@router.get("", summary="Devices that send points", responses=problems(401, 403))
def list_streams(service: ServiceDep) -> Streams:
    """Each device of the caller's owner with the last point of it that is in no log yet."""
    with service.reading() as session:
        return Streams(streams=[Stream.of(one) for one in store.streams(session, MOST_LISTED)])


@router.get("/senders", summary="Programs that send points")
def list_senders() -> Senders:
    """The programs whose messages are understood."""
    return Senders(senders=[SenderDocument(name=one.name, title=one.title) for one in SENDERS.values()])


@router.post(
    "/addresses",
    status_code=201,
    summary="Make an address for a program",
    responses={**UNREADABLE_BODY, **problems(401, 403, 404, 409, 422)},
)
def make_address(
    request: NewAddress, response: Response, service: ServiceDep, base: BaseUrl, origin: Origin
) -> MadeAddress:
    """Make a key of scope `live` and the address that holds it, told this once. Revoke the key to make it void."""
    sender = existing(SENDERS.get(request.sender), "program", request.sender)
    response.headers["Cache-Control"] = "no-store"
    with service.sessions.begin() as session:
        if len(list_keys(session, own_id())) >= MOST_KEYS:
            raise TooManyError(say("access.many_keys", most=MOST_KEYS))
        key, secret = create_key(session, own_id(), request.label, "live")
        audit.note(session, origin, "key made", f"key {key.id}", scope=key.scope, owner=key.owner)
    address = f"{base}/v1/live/{sender.name}/{secret}"
    link = None if sender.link is None else sender.link(address, request.label)
    typed = sender.typed.replace("{address}", address)
    return MadeAddress(key=Key.of(key), address=address, typed=typed, link=link)


@router.get("/last", summary="The last point of a key", responses=problems(401, 403, 503))
def last_point(service: ServiceDep) -> Streams:
    """The devices that send by this very key, with the last point of each that is in no log yet: all that such a key
    can read."""
    with service.reading() as session:
        return Streams(streams=[Stream.of(one) for one in store.own_streams(session, MOST_LISTED)])


@router.get(
    "/last/{capability}",
    summary="The last point of an address",
    responses=problems(401, 403, 503),
)
def last_by_address(service: ServiceDep, capability: Capability) -> Streams:
    """The same of the key that the address holds."""
    return last_point(service)


async def add_points(request: Request, service: ServiceDep, sender: SenderName) -> Response:
    """See ``_WHAT``."""
    program = existing(SENDERS.get(sender), "program", sender)
    if request.headers.get("sec-fetch-site", "none") not in {"none", "same-origin"}:
        raise CrossOriginWriteError(say("live.another_page"))
    message = Message(dict(request.query_params), await request.body(), request.headers)
    try:
        await run_in_threadpool(_receive, service, request.app.state.quota_looks, program, message)
    except QuotaError as error:
        request.app.state.metrics.refused(error.quota)
        raise
    return Response(program.answer, media_type=program.media_type)


async def add_by_address(
    request: Request, service: ServiceDep, sender: SenderName, capability: Capability
) -> Response:
    """See ``_WHAT``."""
    return await add_points(request, service, sender)


for _path, _route in (("/{sender}", add_points), ("/{sender}/{capability}", add_by_address)):
    for _method, _extra in (("GET", None), ("POST", _BODY)):
        router.add_api_route(
            _path,
            _route,
            methods=[_method],
            summary="Send points" if _method == "POST" else "Send a point in the address",
            description=_WHAT,
            operation_id=f"{_route.__name__}_by_{_method.lower()}",
            response_class=Response,
            responses=_ANSWERS,
            openapi_extra=_extra,
        )


def _receive(service: Service, looks: QuotaLooks, sender: Sender, message: Message) -> None:
    batch = Batch()
    sender.read(message, batch)
    if batch.is_empty and batch.unusable and not sender.insists:
        raise BadRequestError(say("live.no_point", why=batch.why), field="body")
    if batch.is_empty and not batch.unusable:
        return
    looks.look(service)
    devices = batch.points or {batch.device: []}
    with service.sessions.begin() as session:
        unusable, why = batch.unusable, batch.why
        for device in sorted(devices):
            store.add_points(
                session,
                sender.name,
                device,
                devices[device],
                silence_s=service.settings.live_silence_s,
                unusable=unusable,
                why=why,
            )
            unusable, why = 0, None
