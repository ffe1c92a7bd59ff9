"""Exports over HTTP: asked for, looked at, fetched in parts, removed. Knows no SQL."""

from __future__ import annotations

import logging
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any, BinaryIO

from fastapi import APIRouter, Query, Request, Response

from app.core.blobs import EXPORTS, BlobStore
from app.core.errors import BadQueryError, BadRequestError, NotDoneError, NotFoundError
from app.core.http import (
    UNREADABLE_BODY,
    BaseUrl,
    Service,
    ServiceDep,
    existing,
    file_answers,
    problems,
    quota_used_up,
)
from app.core.messages import say
from app.core.query import parse_bbox, refuse_unknown
from app.core.telemetry import audit
from app.core.telemetry.audit import Origin
from app.core.telemetry.logs import tell
from app.exports import documents, store
from app.exports.ranges import Stored, stored_answer
from app.exports.store import exports
from app.jobs.requests.listing import AfterQuery, page_of
from fusion.errors import BadOptionsError, RoadsError, UnknownNameError
from fusion.messages import message_of

if TYPE_CHECKING:
    from app.exports.format import NoOptions
    from app.exports.making import Request as FileRequest

logger = logging.getLogger(__name__)

BLOCK_BYTES = 4 * 2**20
"""What one download holds of a bucket's file."""

router = APIRouter(prefix="/v1/exports", tags=["exports"])

_LOCATION = {"Location": {"description": "The export.", "schema": {"type": "string", "format": "uri"}}}


@router.post(
    "",
    status_code=202,
    summary="Ask for a file",
    responses={
        200: {"model": documents.Export, "description": "It is there already.", "headers": _LOCATION},
        202: {"description": "Queued, or being made.", "headers": _LOCATION},
        **UNREADABLE_BODY,
        **quota_used_up(
            "You may have 10 exports that wait or are being made: there are 10. Ask again when one of them is done, or "
            "remove one.",
            {},
        ),
        **problems(403, 413, 422, 503),
    },
)
def ask_for_export(
    request: Request, service: ServiceDep, base: BaseUrl, response: Response, body: documents.ExportRequest
) -> documents.Export:
    """Have the map, or a part of it, written to a file in the background, as it stands at one moment.

    Follow it at `Location`. The same request of the same owner, while the data are the same, answers with the export
    that there is. Files of one version of the data are the same bytes, whenever they are made.
    """
    refuse_unknown(request, (), BadRequestError)
    file_request = _parse_request(body)
    export, created = _find_or_add(service, file_request)
    if export.blob_key is not None and not _blobs(service).exists(
        export.blob_key
    ):  # somebody emptied the storage
        with service.sessions.begin() as session:
            store.cancel(session, export.id, service.settings)
        export, created = _find_or_add(service, file_request)
    if created:
        tell(logger, "export asked for", export=export.id, format=file_request.format.name)
    response.status_code = 200 if export.status is documents.ExportStatus.DONE else 202
    response.headers["Location"] = documents.export_address(base, export)
    return documents.linked(base, export)


@router.get("", summary="List exports", responses=problems(422, 503))
def list_exports(
    request: Request,
    service: ServiceDep,
    base: BaseUrl,
    status: Annotated[
        documents.ExportStatus | None, Query(description="Only exports of this status.")
    ] = None,
    limit: Annotated[int, Query(ge=1, le=1000, description="Exports per page.")] = 100,
    after: AfterQuery = None,
) -> documents.ExportList:
    """Those of the key's owner, with `operate` those of all, the newest first.

    Follow the `next` link until there is none; each export comes once.
    """
    refuse_unknown(request, {"status", "limit", "after"}, BadRequestError)
    shown, links = page_of(service, exports, f"{base}/v1/exports", limit=limit, after=after, status=status)
    return documents.ExportList(exports=[documents.linked(base, export) for export in shown], links=links)


@router.get("/formats", summary="Formats of exports")
def list_formats() -> documents.ExportFormats:
    """What can be asked for, with the options of each. Options that name files are for `versant export` alone.

    Who has no key finds files of the map at `/v1/editions`, where the service makes editions.
    """
    # Some formats stand on large libraries: an API that nobody asks for files does without them.
    from app.exports.formats import FORMATS  # noqa: PLC0415

    return documents.ExportFormats(
        formats=[
            documents.ExportFormat(
                name=one.name,
                description=one.description,
                suffixes=list(one.suffixes),
                media_type=one.media_type,
                filters=sorted(one.filters),
                options=_options_schema(one.options),
            )
            for one in FORMATS.values()
        ]
    )


@router.get("/{export_id}", summary="One export", responses=problems(404, 503))
def get_export(export_id: uuid.UUID, service: ServiceDep, base: BaseUrl) -> documents.Export:
    """Status, progress, the version and origin of its data, and where its file is."""
    return documents.linked(base, _get_export(service, export_id))


@router.delete("/{export_id}", status_code=204, summary="Remove an export", responses=problems(403, 404, 503))
def delete_export(export_id: uuid.UUID, service: ServiceDep, origin: Origin) -> None:
    """Always works, whatever the status: a worker that makes it stops, its file goes at once.

    The export is `cancelled`, and is told as such until it would have expired. Once more changes nothing.
    """
    with service.sessions.begin() as session:
        export = existing(exports.get(session, export_id), "export", export_id)
        blob_key = store.cancel(session, export_id, service.settings)
        if export.status is not documents.ExportStatus.CANCELLED:
            audit.note(session, origin, "export removed", export_id, file_name=export.file_name)
    if blob_key is not None:
        _blobs(service).delete(blob_key)


@router.get(
    "/{export_id}/file",
    summary="The file of an export",
    response_class=Response,
    responses={
        **file_answers("(the bytes of versant-gpkg.gpkg)"),
        **problems(404, 409, 416, 503),
    },
)
def get_file(export_id: uuid.UUID, request: Request, service: ServiceDep) -> Response:
    """The bytes as they were made, resumable: `Range` with `If-Range`. The ETag is the SHA-256 of the whole file."""
    export = _done(service, export_id)
    stored = Stored(str(export.sha256), int(export.size_bytes or 0), export.media_type)
    disposition = f'attachment; filename="{export.file_name}"'

    def opened() -> BinaryIO:
        try:
            return _blobs(service).open(str(export.blob_key), BLOCK_BYTES)
        except FileNotFoundError:
            raise NotFoundError(say("export.file_gone", id=export_id)) from None

    headers = {"Cache-Control": "no-cache", "Content-Disposition": disposition}
    return stored_answer(request, stored, opened, headers)


@router.get(
    "/{export_id}/beside/{name}",
    summary="A small file that belongs beside it",
    response_class=Response,
    responses={
        200: {
            "description": "Its text.",
            "content": {"text/plain": {"schema": {"type": "string"}, "example": '{"generator": "Versant"}'}},
        },
        **problems(404, 409, 503),
    },
)
def get_beside(export_id: uuid.UUID, name: str, service: ServiceDep) -> Response:
    """How the file is drawn, or what its format has no place for, under the name that readers look for."""
    export = _done(service, export_id)
    text = existing(export.companions.get(name), f"file beside export {export_id} called", name[:80])
    kind = "application/json" if name.endswith(".json") else "text/plain"
    return Response(text, media_type=kind, headers={"Cache-Control": "no-cache"})


def _parse_request(body: documents.ExportRequest) -> FileRequest:
    from app.exports.making import request_of  # noqa: PLC0415 - as above

    with _naming("bbox"):
        box = parse_bbox(body.bbox)
    filters = body.model_dump(exclude={"format", "options", "bbox"})
    with _naming("format"):
        return request_of(body.format, body.options, bbox=box, **filters)


def _find_or_add(service: Service, file_request: FileRequest) -> tuple[documents.Export, bool]:
    from app.exports.making import data_state  # noqa: PLC0415 - as above

    with service.sessions.begin() as session:
        with _naming("region"):
            file_request.query(session)
        return store.ask(
            session,
            request=file_request.document(),
            request_sha256=file_request.sha256(),
            data_version=data_state(session).version,
            file_name=file_request.file_name,
            media_type=file_request.format.media_type,
            quota=service.settings.quota_exports,
        )


@contextmanager
def _naming(field: str) -> Iterator[None]:
    """Refuse by 422, and name the member of the body at fault, what is refused inside."""
    try:
        yield
    except (BadQueryError, RoadsError, UnknownNameError) as error:
        raise BadRequestError(message_of(error), field=field) from error
    except BadOptionsError as error:
        at = error.where or "options"
        inside = at not in documents.ExportRequest.model_fields
        raise BadRequestError(message_of(error), field=f"options.{at}" if inside else at) from error


def _get_export(service: Service, export_id: uuid.UUID) -> documents.Export:
    with service.reading() as session:
        return existing(exports.get(session, export_id), "export", export_id)


def _done(service: Service, export_id: uuid.UUID) -> documents.Export:
    """The export, which has a file; ``NotDoneError`` and ``NotFoundError`` say why it has none."""
    export = _get_export(service, export_id)
    if export.status is documents.ExportStatus.DONE:
        return export
    if export.status in {documents.ExportStatus.QUEUED, documents.ExportStatus.RUNNING}:
        raise NotDoneError(say("export.not_done", id=export.id, status=export.status, share=export.progress))
    why = export.failure.reason if export.failure is not None else "It was removed. Ask for it again."
    raise NotFoundError(say("export.no_file", id=export.id, status=export.status, why=why))


def _blobs(service: Service) -> BlobStore:
    return BlobStore(service.settings.blob_store_url, EXPORTS)


def _options_schema(options: type[NoOptions]) -> dict[str, Any]:
    """The options that requests may name, as JSON schema."""
    schema = options.model_json_schema()
    properties = {k: v for k, v in schema.get("properties", {}).items() if k not in options.local_files}
    return {**schema, "properties": properties}
