"""Many drives processed again at once, over HTTP: the request, and how far it is."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from app.core.errors import BadRequestError
from app.core.http import BaseUrl, ServiceDep, link, problems
from app.core.query import refuse_unknown
from app.drives import intake
from app.drives.bulk import batch_progress
from app.drives.documents import Batch, BatchAccepted
from app.drives.method_choice import MethodQuery, default_method

# Of 1970 and in microseconds, the database's resolution: a batch's moment as an integer.
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND = timedelta(microseconds=1)
_LAST = (datetime(9999, 1, 1, tzinfo=UTC) - _EPOCH) // _MICROSECOND


router = APIRouter(prefix="/v1/drives", tags=["drives"])


@router.post(
    "/reprocess",
    status_code=202,
    summary="Process all drives again that are of another method",
    responses=problems(403, 422, 503),
)
def reprocess_drives(
    request: Request,
    service: ServiceDep,
    base: BaseUrl,
    response: Response,
    method: MethodQuery = None,
    from_method: Annotated[
        str | None,
        Query(description="Only drives that were processed by this method.", examples=["particle"]),
    ] = None,
) -> BatchAccepted:
    """Queue every done or failed drive that is not of `method` already, with the method's default options.

    They go behind uploads. What each published stays until its new run replaces it. Follow the batch at
    `Location`.
    """
    refuse_unknown(request, {"method", "from_method"}, BadRequestError)
    wanted = method or default_method(service.settings)
    moment, count = intake.reprocess_all(service.sessions, wanted, from_method)
    address = _address(base, (moment - _EPOCH) // _MICROSECOND)
    response.headers["Location"] = address
    return BatchAccepted(queued=count, method=wanted, links=[link(address, "monitor", title="Its progress")])


@router.get(
    "/reprocess",
    summary="Progress of such a batch, or of all that is under way",
    responses=problems(422, 503),
)
def batch(
    service: ServiceDep,
    base: BaseUrl,
    batch: Annotated[
        int | None,
        Query(
            ge=0,
            le=_LAST,
            description="The batch, as the link to here names it; without: all drives that wait or run, with what is "
            "done of their batches. After an update of the service that is what it computes again by itself.",
        ),
    ] = None,
) -> Batch:
    """How many of the batch's drives wait, run, are done and failed.

    A drive that is deleted or asked for anew meanwhile is no longer of it.
    """
    with service.reading() as session:
        found = batch_progress(session, None if batch is None else _EPOCH + batch * _MICROSECOND)
    address = f"{base}/v1/drives/reprocess" if batch is None else _address(base, batch)
    return found.model_copy(update={"links": [link(address, "self")]})


def _address(base: str, number: int) -> str:
    return f"{base}/v1/drives/reprocess?batch={number}"
