"""Many drives processed again at once, over HTTP: the request, how far it is, and calling it off."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response

from app.core.errors import BadQueryError, BadRequestError
from app.core.http import BaseUrl, Service, ServiceDep, existing, link, problems
from app.core.messages import Said
from app.core.query import parse_bbox, refuse_unknown
from app.core.telemetry.audit import Origin
from app.drives.batches import enqueuing
from app.drives.batches.documents import Batch, BatchAccepted, BatchRequest, Selection, Which, note
from app.drives.batches.store import batch_progress, count_selected, count_skipped, standing
from app.drives.method_choice import default_method
from app.roads.store import known_region
from fusion.errors import RoadsError

_LAST = 2**63 - 1  # that a number of the database can be

router = APIRouter(prefix="/v1/drives", tags=["drives"])

BatchNumber = Annotated[
    int, Query(ge=1, le=_LAST, description="The batch, as the link to it names it.", examples=[7])
]


@router.post(
    "/reprocess",
    status_code=202,
    summary="Process many drives again",
    responses=problems(403, 422, 503),
)
def reprocess_drives(
    request: Request,
    service: ServiceDep,
    base: BaseUrl,
    response: Response,
    origin: Origin,
    query: Annotated[BatchRequest, Query()],
) -> BatchAccepted:
    """Queue every done or failed drive that is meant; without any filter, those that are not of `method` already.

    Of the drives of the key's owner; with `operate` of those of all. They go behind uploads. What each published stays
    until its new run replaces it. Drives whose log itself cannot be used are left out (`force`, `skipped`, `note`).
    Follow the batch at `Location`. Asking for the same again while it is put into the queue goes on with it; drives
    that wait already are never queued twice. `dry_run=true` counts only, and answers 200.
    """
    refuse_unknown(request, BatchRequest.model_fields, BadRequestError)
    filters = query.model_dump(exclude={"method", "dry_run", "bbox"})
    selection, method = chosen(service, filters, query.bbox, query.method)
    with service.reading() as session:
        skipped, before = count_skipped(session, selection, method), standing(session)
        count = count_selected(session, selection, method) if query.dry_run else 0
    complete, links = True, []
    if query.dry_run:
        response.status_code = 200
    else:
        number, count = enqueuing.reprocess_all(service.sessions, selection, method, origin=origin)
        address = _address(base, number)
        response.headers["Location"] = address
        complete = _seen(service, base, number).state != "enqueuing"
        links = [link(address, "monitor", title="Its progress")]
    told = note(selection, method, count, skipped, before)
    return BatchAccepted(
        queued=count,
        complete=complete,
        method=method,
        dry_run=query.dry_run,
        skipped=skipped,
        note=told,
        note_said=None if told is None else Said.of(told),
        links=links,
    )


@router.get(
    "/reprocess",
    summary="Progress of such a batch, or of all that is under way",
    responses=problems(404, 422, 503),
)
def batch(
    request: Request,
    service: ServiceDep,
    base: BaseUrl,
    batch: Annotated[
        int | None,
        Query(
            ge=1,
            le=_LAST,
            description="The batch, as the link to here names it; without: all drives that wait or run, with what is "
            "done of their batches. After an update of the service that is what it computes again by itself.",
        ),
    ] = None,
) -> Batch:
    """How many of the batch's drives wait, run, are done and failed.

    A drive that is deleted or asked for anew meanwhile is no longer of it.
    """
    refuse_unknown(request, {"batch"}, BadRequestError)
    return _seen(service, base, batch)


@router.delete("/reprocess", summary="Cancel such a batch", responses=problems(403, 404, 422, 503))
def cancel_batch(
    request: Request, service: ServiceDep, base: BaseUrl, origin: Origin, batch: BatchNumber
) -> Batch:
    """Take what still waits of it out of the queue: those drives are done or failed as they were before, with all that
    they published. What runs runs to its end, and what is done stays so.
    """
    refuse_unknown(request, {"batch"}, BadRequestError)
    _seen(service, base, batch)  # there is one
    enqueuing.cancel(service.sessions, batch, origin=origin)
    return _seen(service, base, batch)


def _seen(service: Service, base: str, number: int | None) -> Batch:
    with service.reading() as session:
        seen = existing(batch_progress(session, number), "batch", number)
    address = f"{base}/v1/drives/reprocess" if number is None else _address(base, number)
    return seen.model_copy(update={"links": [link(address, "self")]})


def chosen(
    service: Service, filters: Mapping[str, Any], bbox: str | None, method: str | None
) -> tuple[Selection, str | None]:
    """The drives that a request names, and the method: the service's default where that is needed and none is named.

    ``BadRequestError`` for what cannot be meant, ``UnknownNameError`` for a method that there is not.
    """
    try:
        selection = Selection(**filters, bbox=parse_bbox(bbox))
    except BadQueryError as error:  # the OGC's status is not this route's
        raise BadRequestError(str(error), field="bbox") from error
    if selection.region is not None:
        with service.reading() as session:
            try:
                known_region(session, selection.region)
            except RoadsError as error:
                raise BadRequestError(str(error), field="region") from error
    if method is None and selection.which is Which.OTHER:
        method = default_method(service.settings)
    enqueuing.check(selection, method)
    return selection, method


def _address(base: str, number: int) -> str:
    return f"{base}/v1/drives/reprocess?batch={number}"
