"""Operations over HTTP: asked for, looked at, approved, cancelled. Knows no SQL."""

from __future__ import annotations

import logging
import uuid
from collections.abc import Mapping
from pathlib import PurePosixPath
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, Field
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from app.core.blobs import IMPORTS, BlobStore
from app.core.databases import database_identity
from app.core.errors import BadRequestError, NotDoneError
from app.core.http import BaseUrl, Service, ServiceDep, existing, problems
from app.core.messages import say
from app.core.query import refuse_unknown
from app.core.receiving.files import announced_bytes
from app.core.telemetry import audit
from app.core.telemetry.audit import Origin
from app.core.telemetry.logs import tell
from app.jobs.requests.listing import AfterQuery, page_of
from app.operations import store
from app.operations.documents import (
    WITH_FILE,
    Kind,
    Operation,
    OperationList,
    Status,
    linked,
    operation_address,
)
from app.operations.receiving import Received, receive_file
from app.operations.store import operations
from app.roads.store import check_name, known_region
from app.terrain.store import chosen, current_dem
from fusion.errors import RoadsError, TerrainError
from fusion.messages import message_of

logger = logging.getLogger(__name__)

TAKEN: Mapping[Kind, frozenset[str]] = {
    Kind.IMPORT_ROADS: frozenset({"region", "filename"}),
    Kind.IMPORT_DEM: frozenset({"priority", "source", "licence", "filename"}),
    Kind.REMOVE_REGION: frozenset({"name"}),
    Kind.REMOVE_RASTER: frozenset({"name"}),
    Kind.SETTLE: frozenset(),
    Kind.LEARN_WIDENINGS: frozenset(),
    Kind.RESET_WIDENINGS: frozenset(),
    Kind.RELEASE: frozenset(),
}
"""Which parameters belong to which kind."""
LEAST_PRIORITY, MOST_PRIORITY = -1000, 1000
MOST_CREDIT = 200
"""Characters of a source, or of a licence."""

router = APIRouter(prefix="/v1/operations", tags=["operation"])

_BINARY = {"type": "string", "format": "binary"}
_BODY: dict[str, Any] = {
    "required": False,
    "description": "Of imports: the file, as a form field or as the body itself with its name in `filename`.",
    "content": {
        "multipart/form-data": {
            "schema": {"type": "object", "required": ["file"], "properties": {"file": _BINARY}},
            "example": {"file": "karlsruhe.osm.pbf"},
        },
        "application/octet-stream": {"schema": _BINARY, "example": "(the bytes of karlsruhe.osm.pbf)"},
    },
}
_LOCATION = {"Location": {"description": "The operation.", "schema": {"type": "string", "format": "uri"}}}


class OperationRequest(BaseModel):
    """What is to be done, and with what, as query parameters."""

    kind: Kind = Field(description="What is to be done.", examples=["import-roads"])
    region: str | None = Field(
        None,
        max_length=100,
        description="Of `import-roads`: the region that the file brings up to date; else it is named after the file.",
    )
    priority: int | None = Field(
        None,
        ge=LEAST_PRIORITY,
        le=MOST_PRIORITY,
        description="Of `import-dem`: where rasters lie over each other the highest counts.",
    )
    source: str | None = Field(
        None,
        max_length=MOST_CREDIT,
        description="Of `import-dem`: whose data it is, as maps and files are to credit it.",
        examples=["Copernicus DEM GLO-30, © DLR and Airbus"],
    )
    licence: str | None = Field(
        None, max_length=MOST_CREDIT, description="Of `import-dem`: its licence.", examples=["CC BY 4.0"]
    )
    name: str | None = Field(None, max_length=255, description="Of removals: the region or the raster.")
    filename: str | None = Field(
        None, max_length=255, description="Of imports whose body is the file itself: its name."
    )


@router.post(
    "",
    status_code=202,
    summary="Ask for an operation",
    responses={
        202: {"description": "Queued, or the same that waits already.", "headers": _LOCATION},
        **problems(403, 413, 415, 422, 503, 507),
    },
    openapi_extra={"requestBody": _BODY},
)
async def ask_for_operation(
    request: Request,
    response: Response,
    service: ServiceDep,
    base: BaseUrl,
    origin: Origin,
    query: Annotated[OperationRequest, Query()],
) -> Operation:
    """Have a worker import roads or an elevation raster, remove a region or a raster, solve the whole map anew, or
    learn by how much each device class's sigmas are too small, or reset that.

    One at a time, behind uploads. `import-roads` and removals first say what they would do, and wait as `planned` for
    `approve`; the others are done at once. The same again, while it waits, is the same operation. Follow it at
    `Location`.
    """
    refuse_unknown(request, OperationRequest.model_fields, BadRequestError)
    kind, given = query.kind, query.model_dump(exclude={"kind"}, exclude_none=True)
    _require_fitting(kind, given)
    parameters = {name: value for name, value in given.items() if name != "filename"}
    await run_in_threadpool(_check, service, kind, parameters)
    received = None
    if kind in WITH_FILE:
        await run_in_threadpool(_require_place, service, announced_bytes(request))
        received = await receive_file(
            request, BlobStore(service.settings.blob_store_url, IMPORTS), service.settings
        )
    operation = await run_in_threadpool(_add_operation, service, origin, kind, parameters, received)
    response.headers["Location"] = operation_address(base, operation)
    return linked(base, operation)


@router.get("", summary="List operations", responses=problems(422, 503))
def list_operations(
    request: Request,
    service: ServiceDep,
    base: BaseUrl,
    limit: Annotated[int, Query(ge=1, le=1000, description="Operations per page.")] = 100,
    after: AfterQuery = None,
) -> OperationList:
    """The newest first. Follow the `next` link until there is none; each operation comes once."""
    refuse_unknown(request, {"limit", "after"}, BadRequestError)
    shown, links = page_of(service, operations, f"{base}/v1/operations", limit=limit, after=after)
    return OperationList(operations=[linked(base, one) for one in shown], links=links)


@router.get("/{operation_id}", summary="One operation", responses=problems(404, 503))
def get_operation(operation_id: uuid.UUID, service: ServiceDep, base: BaseUrl) -> Operation:
    """Where it stands, what it would do, what it did, or why it failed."""
    with service.reading() as session:
        return linked(base, _get(session, operation_id))


@router.post(
    "/{operation_id}/approve",
    status_code=202,
    summary="Carry a plan out",
    responses=problems(403, 404, 409, 422, 503),
)
def approve_operation(
    operation_id: uuid.UUID, service: ServiceDep, base: BaseUrl, origin: Origin
) -> Operation:
    """Do what was planned, and only that: where the map has changed so that something else would be done, nothing is,
    and the operation is `planned` anew with what would be done now. Once more changes nothing.
    """
    with service.sessions.begin() as session:
        approved = store.approve(session, operation_id)
        if approved is not None:
            audit.note(session, origin, f"{approved.kind} approved", approved.subject, id=str(approved.id))
            return linked(base, approved)
        operation = _get(session, operation_id)
    if operation.approved and operation.status in {Status.QUEUED, Status.RUNNING, Status.DONE}:
        return linked(base, operation)
    if operation.status in {Status.QUEUED, Status.RUNNING}:
        raise NotDoneError(say("operation.no_plan_yet", id=operation_id, status=operation.status))
    raise BadRequestError(say("operation.nothing_to_approve", id=operation_id, status=operation.status))


@router.delete("/{operation_id}", summary="Cancel an operation", responses=problems(403, 404, 409, 422, 503))
def cancel_operation(
    operation_id: uuid.UUID, service: ServiceDep, base: BaseUrl, origin: Origin
) -> Operation:
    """Drop what waits, is planned, or is being planned: nothing of it was done. What has begun to change the map goes
    on to its end (409). Its file goes at once. Once more changes nothing.
    """
    with service.sessions.begin() as session:
        cancelled = store.cancel(session, operation_id)
        if cancelled is None:
            operation = _get(session, operation_id)
        else:
            operation, key = cancelled
            audit.note(
                session, origin, f"{operation.kind} cancelled", operation.subject, id=str(operation.id)
            )
    if cancelled is not None and key is not None:
        BlobStore(service.settings.blob_store_url, IMPORTS).delete(key)
    if operation.status is Status.CANCELLED:
        return linked(base, operation)
    if operation.status in {Status.QUEUED, Status.RUNNING}:
        raise NotDoneError(say("operation.goes_on", id=operation_id))
    raise BadRequestError(say("operation.nothing_to_cancel", id=operation_id, status=operation.status))


def _require_fitting(kind: Kind, given: Mapping[str, Any]) -> None:
    """``BadRequestError`` for a parameter of another kind of operation, or where one is missing."""
    for name in given:
        if name not in TAKEN[kind]:
            raise BadRequestError(say("operation.takes_no", kind=kind.value, name=name), field=name)
    if "name" in TAKEN[kind] and not given.get("name"):
        raise BadRequestError(say("operation.which", kind=kind.value), field="name")


def _require_place(service: Service, size_bytes: int) -> None:
    """Refuse before a large body is received; ``_add_operation`` looks again when its file is there."""
    with service.reading() as session:
        store.require_place(session, size_bytes, service.settings.imports_kept_bytes)


def _check(service: Service, kind: Kind, parameters: Mapping[str, Any]) -> None:
    """``BadRequestError`` for a region or raster that there is not, before any file is taken."""
    try:
        if "region" in parameters:
            check_name(parameters["region"])
        with service.reading() as session:
            if kind is Kind.REMOVE_REGION:
                known_region(session, parameters["name"])
            if kind is Kind.REMOVE_RASTER:
                active = current_dem(session, service.settings.dem_dir)
                chosen(active.sources if active else (), [parameters["name"]])
    except (RoadsError, TerrainError) as error:
        raise BadRequestError(
            message_of(error), field="region" if "region" in parameters else "name"
        ) from error


def _add_operation(
    service: Service, origin: str, kind: Kind, parameters: dict[str, Any], received: Received | None
) -> Operation:
    """The operation, with its audit row; a file that is not its own goes."""
    blobs, key = BlobStore(service.settings.blob_store_url, IMPORTS), None
    subject = parameters.get("name") or "map"
    if received is not None:
        key, subject = received.blob.key, received.name
        file = {"filename": PurePosixPath(received.name).name, "size_bytes": received.blob.size_bytes}
        parameters |= {**file, "sha256": received.blob.sha256}
    is_wanted = False
    try:
        with service.sessions.begin() as session:
            blobs.register_database(database_identity(session))
            operation, created = store.ask(
                session,
                kind=kind.value,
                subject=subject,
                request=parameters,
                kept_bytes=service.settings.imports_kept_bytes,
                blob_key=key,
            )
            if created:
                audit.note(
                    session, origin, f"{kind.value} asked for", subject, id=str(operation.id), **parameters
                )
        is_wanted = created
    finally:
        if key is not None and not is_wanted:
            blobs.delete(key)
    if created:
        tell(logger, "operation asked for", operation=operation.id, kind=kind.value)
    return operation


def _get(session: Session, number: uuid.UUID) -> Operation:
    return existing(operations.get(session, number), "operation", number)
