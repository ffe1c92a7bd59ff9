"""A person's own data over HTTP: all of it as one archive, and its removal with a receipt."""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from datetime import date
from enum import StrEnum
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, Field
from starlette.types import Receive, Scope, Send

from app.access import store as access
from app.access.gate import callers_of
from app.access.routes import OwnerId
from app.core.admission import RequestClass
from app.core.blobs import EXPORTS, BlobStore
from app.core.caller import STILL_KNOWN, seeing_all
from app.core.http import EXAMPLE_ID, BaseUrl, Link, Service, ServiceDep, existing, link, problems
from app.core.receiving.sse import while_known
from app.core.telemetry.audit import Origin
from app.drives.parts.reading import attachment
from app.drives.person import removal, store
from app.drives.person.archive import Archive

_COUNTS = {
    "drives": 340,
    "bytes": 912_004_311,
    "trials": 2,
    "keys": 12,
    "sessions": 1,
    "exports": 3,
    "webhooks": 1,
    "zones": 2,
}
_EXAMPLE: dict[str, Any] = {
    "id": EXAMPLE_ID,
    "state": "done",
    "asked_on": "2026-11-27",
    "ended_on": "2026-11-27",
    "removed": _COUNTS,
    "drives_left": 0,
    "audit_rows_kept": 14,
    "sentences": ["340 drives with logs of 912.0 MB, 12 keys: all of it is removed."],
    "links": [{"href": f"http://127.0.0.1:8000/v1/removals/{EXAMPLE_ID}", "rel": "self"}],
}

WHY_AUDIT_STAYS = (
    "{rows} of the audit stay, because others have to be able to see why the map changed: what was done on which day, "
    "without key, address or program, and no longer under this owner."
)


class RemovalState(StrEnum):
    """Where a removal stands."""

    RUNNING = "running"
    DONE = "done"


class Counts(BaseModel):
    """What there was of an owner, and goes."""

    drives: int = Field(description="With their logs, tracks, profiles and estimates.")
    bytes: int = Field(description="Of the logs that were kept, as stored.")
    trials: int = Field(description="Other methods that were tried on the drives.")
    keys: int = Field(description="Those revoked before included.")
    sessions: int = Field(description="Browsers that were logged in.")
    exports: int
    webhooks: int
    zones: int


class OwnerRemoval(BaseModel, json_schema_extra={"examples": [_EXAMPLE]}):
    """The receipt of a removal: counts and days, and nothing that tells whose it was."""

    id: uuid.UUID = Field(description="Whoever knows it may read the receipt.")
    state: RemovalState = Field(
        description="`running`: nothing of it is shown to anybody any more, and the map is computed without it, piece "
        "by piece; `done`: nothing is left."
    )
    asked_on: date = Field(description="The day, UTC.")
    ended_on: date | None = Field(
        description="The day on which nothing was left, UTC; null: it is under way."
    )
    removed: Counts
    drives_left: int = Field(description="Drives that are still to be taken out of the map.")
    audit_rows_kept: int | None = Field(description="Rows of the audit that stay; null until it is done.")
    sentences: list[str] = Field(description="The same for a person, and what stays and why.")
    links: list[Link]


def sentences(removed: Counts, drives_left: int, kept: int | None) -> list[str]:
    """What a person is told."""
    drives, keys = _number(removed.drives, "drive"), _number(removed.keys, "key")
    what = f"{drives} with logs of {removed.bytes / 1e6:.1f} MB, {keys}"
    if kept is None:
        return [
            f"{what}: nobody sees anything of them any more, and no key lets anybody in.",
            f"{_number(drives_left, 'drive')} of them wait to be taken out of the map, behind what is uploaded.",
        ]
    audit = WHY_AUDIT_STAYS.format(rows=_number(kept, "row")) if kept else "Nothing of the audit is left."
    copies = "Backups of this service keep what they hold until they are deleted, and so does who fetched an edition."
    return [f"{what}: all of it is removed.", audit, copies]


def _number(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


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
