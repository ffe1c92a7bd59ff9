"""A person's own data over HTTP: all of it as one archive, and its removal with a receipt."""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from app.access import store as access
from app.access.gate import callers_of
from app.access.routes import OwnerId
from app.core.admission import RequestClass
from app.core.blobs import EXPORTS, BlobStore
from app.core.caller import STILL_KNOWN, seeing_all
from app.core.http import BaseUrl, Service, ServiceDep, existing, link, problems
from app.core.receiving.sse import while_known
from app.core.telemetry.audit import Origin
from app.drives.parts.reading import attachment
from app.drives.person import removal, store
from app.drives.person.archive import Archive
from app.drives.person.documents import Counts, OwnerRemoval, RemovalState, sentences

ZIP = "application/zip"

router = APIRouter(prefix="/v1", tags=["access"])

_ARCHIVE: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "A ZIP; `index.json` in it says what is damaged or missing.",
        "content": {ZIP: {"schema": {"type": "string", "format": "binary"}, "example": "(the bytes)"}},
    }
}
_LOCATION = {"Location": {"description": "The receipt.", "schema": {"type": "string", "format": "uri"}}}
NameQuery = Annotated[
    str, Query(min_length=1, max_length=100, description="The owner's name: it confirms what is meant.")
]


class ArchiveAnswer(StreamingResponse):
    """An archive; it holds a place among those that are sent until its last byte is, or its client leaves."""

    def __init__(self, archive: Archive, places: RequestClass, headers: Mapping[str, str]) -> None:
        super().__init__(archive.pieces(), media_type=ZIP, headers=headers)
        self._places = places

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if (still_known := scope.get(STILL_KNOWN)) is not None:
            self.body_iterator = while_known(still_known, self.body_iterator)
        async with self._places.place():
            await super().__call__(scope, receive, send)


@router.get(
    "/owner/archive",
    summary="Everything that the caller's owner has",
    response_class=StreamingResponse,
    responses={**_ARCHIVE, **problems(401, 403, 503)},
)
def own_archive(request: Request, service: ServiceDep, base: BaseUrl) -> ArchiveAnswer:
    """One ZIP: the logs as they came; of each drive its document with the report, track, profile, estimates and
    measurements; the owner with quotas and zones, its keys without secrets, webhooks, and what the audit has of it.

    Written while it is read: its size is not known before. A log that is damaged or lost is told in `index.json`, the
    last of its files. Where two are being sent already, 503. When the key is revoked meanwhile it breaks off.
    """
    return _archive(request, service, base, access.own_id())


@router.get(
    "/owners/{owner_id}/archive",
    summary="Everything that an owner has",
    response_class=StreamingResponse,
    responses={**_ARCHIVE, **problems(401, 403, 404, 503)},
)
def owners_archive(owner_id: OwnerId, request: Request, service: ServiceDep, base: BaseUrl) -> ArchiveAnswer:
    """As `/v1/owner/archive`, of any owner."""
    return _archive(request, service, base, owner_id)


def _archive(request: Request, service: Service, base: str, owner_id: int) -> ArchiveAnswer:
    with service.reading() as session:
        owner = existing(access.get_owner(session, owner_id), "owner", owner_id)
    headers = {"Content-Disposition": attachment(f"{owner.name}.zip"), "Cache-Control": "no-store"}
    return ArchiveAnswer(Archive(service, base, owner_id), request.app.state.archives, headers)


@router.delete(
    "/owner",
    status_code=202,
    summary="Remove the caller's owner with all that it has",
    responses={202: {"headers": _LOCATION}, **problems(401, 403, 422, 503)},
)
def remove_own(
    request: Request, response: Response, service: ServiceDep, base: BaseUrl, origin: Origin, name: NameQuery
) -> OwnerRemoval:
    """For good. From the answer on no key of the owner lets anybody in, and nobody sees anything of its drives; workers
    take back what they said. Keep the address of the receipt: it is all that there is to ask for afterwards.

    Fetch the archive first. The operator's owner stays (403).
    """
    return _remove(request, response, service, base, origin, access.own_id(), name)


@router.delete(
    "/owners/{owner_id}",
    status_code=202,
    summary="Remove an owner with all that it has",
    responses={202: {"headers": _LOCATION}, **problems(401, 403, 404, 422, 503)},
)
def remove_owner(
    owner_id: OwnerId,
    request: Request,
    response: Response,
    service: ServiceDep,
    base: BaseUrl,
    origin: Origin,
    name: NameQuery,
) -> OwnerRemoval:
    """As `DELETE /v1/owner`, of any owner but the operator's. Once more answers with the same removal."""
    return _remove(request, response, service, base, origin, owner_id, name)


@router.get(
    "/removals/{removal_id}",
    summary="The receipt of a removal",
    responses=problems(404, 503),
)
def get_removal(removal_id: uuid.UUID, service: ServiceDep, base: BaseUrl) -> OwnerRemoval:
    """How far it is, and what was removed, for whoever knows its address: the keys are gone."""
    return _receipt(service, base, removal_id)


def _remove(
    request: Request,
    response: Response,
    service: Service,
    base: str,
    origin: str,
    owner_id: int,
    name: str,
) -> OwnerRemoval:
    exports = BlobStore(service.settings.blob_store_url, EXPORTS)
    removal_id = removal.remove_owner(service.sessions, exports, owner_id, name, origin)
    callers_of(request.scope).forget()
    response.headers["Location"] = f"{base}/v1/removals/{removal_id}"
    response.headers["Cache-Control"] = "no-store"
    return _receipt(service, base, removal_id)


def _receipt(service: Service, base: str, removal_id: uuid.UUID) -> OwnerRemoval:
    with service.reading() as session, seeing_all(session):
        found = existing(store.get(session, removal_id), "removal", removal_id)
    removed = Counts.model_validate(found.counts)
    kept = found.counts.get("audit_rows_kept")
    return OwnerRemoval(
        id=found.id,
        state=RemovalState.RUNNING if found.ended_on is None else RemovalState.DONE,
        asked_on=found.asked_on,
        ended_on=found.ended_on,
        removed=removed,
        drives_left=found.drives_left,
        audit_rows_kept=kept,
        sentences=sentences(removed, found.drives_left, kept),
        links=[link(f"{base}/v1/removals/{found.id}", "self")],
    )
