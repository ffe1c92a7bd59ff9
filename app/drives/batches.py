"""Many drives processed again at once."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from app.core.errors import BadRequestError
from app.core.http import BaseUrl, Link, ServiceDep, link, problems
from app.core.query import refuse_unknown
from app.drives import intake as ingest
from app.drives.options import MethodQuery, default_method
from app.drives.store import batch_progress

# Of 1970 and in microseconds, the database's resolution: a batch's moment as an integer.
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND = timedelta(microseconds=1)
_LAST = (datetime(9999, 1, 1, tzinfo=UTC) - _EPOCH) // _MICROSECOND

EXAMPLE_BATCH = "http://127.0.0.1:8000/v1/drives/reprocess?batch=1795166382004000"


class BatchAccepted(BaseModel):
    """The answer to a request to process many drives again."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "queued": 12,
                    "method": "raw",
                    "links": [{"href": EXAMPLE_BATCH, "rel": "monitor", "type": "application/json"}],
                }
            ]
        }
    )

    queued: int = Field(description="Drives that wait to be processed again.")
    method: str
    links: list[Link]


class Batch(BaseModel):
    """How far many drives are that are processed again."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "drives": 12,
                    "queued": 4,
                    "running": 1,
                    "done": 6,
                    "failed": 1,
                    "progress": 0.6125,
                    "links": [{"href": EXAMPLE_BATCH, "rel": "self", "type": "application/json"}],
                }
            ]
        }
    )

    drives: int
    queued: int
    running: int
    done: int
    failed: int
    progress: float = Field(ge=0, le=1, description="Share of the work done, 0..1; 1: nothing is left to do.")
    links: list[Link]


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
    moment, count = ingest.reprocess_all(service.sessions, wanted, from_method)
    address = _address(base, (moment - _EPOCH) // _MICROSECOND)
    response.headers["Location"] = address
    return BatchAccepted(queued=count, method=wanted, links=[link(address, "monitor", title="Its progress")])


@router.get("/reprocess", summary="Progress of such a batch", responses=problems(422, 503))
def batch(
    service: ServiceDep,
    base: BaseUrl,
    batch: Annotated[int, Query(ge=0, le=_LAST, description="The batch, as the link to here names it.")],
) -> Batch:
    """How many of the batch's drives wait, run, are done and failed.

    A drive that is deleted or asked for anew meanwhile is no longer of it.
    """
    with service.reading() as session:
        found = batch_progress(session, _EPOCH + batch * _MICROSECOND)
    return Batch(**vars(found), links=[link(_address(base, batch), "self")])


def _address(base: str, number: int) -> str:
    return f"{base}/v1/drives/reprocess?batch={number}"
