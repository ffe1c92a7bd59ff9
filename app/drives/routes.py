"""Drives over HTTP: list, look, delete, process again. Knows no SQL; uploads and results have files of their own."""

from __future__ import annotations

import uuid
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Body, Query, Request, Response
from pydantic import BaseModel, Field

from app.core.errors import BadRequestError
from app.core.http import UNREADABLE_BODY, BaseUrl, ServiceDep, existing, link, problems, with_query
from app.core.messages import say
from app.core.query import refuse_unknown
from app.core.telemetry.audit import Origin
from app.drives import intake
from app.drives import store as drives
from app.drives.batches.documents import Name, Time
from app.drives.documents import (
    Drive,
    DriveAccepted,
    DriveList,
    DrivePlace,
    DriveStatus,
    ReprocessRequest,
    accepted,
    drive_address,
    linked,
    removal_links,
)
from app.drives.listing import Direction, Order, Sort, cursor, default_direction, place_of
from app.drives.method_choice import (
    MethodQuery,
    asked_positioning,
)

router = APIRouter(prefix="/v1/drives", tags=["drives"])


class DriveListRequest(BaseModel):
    """Which drives a list shows, in which order, and where its page begins, as query parameters."""

    status: DriveStatus | None = Field(None, description="Only drives of this status.")
    failure: Name | None = Field(
        None, description="Only drives that failed for this reason.", examples=["no-match"]
    )
    waits_for: Literal["roads", "nothing"] | None = Field(
        None,
        description="Only drives that wait for that, and are computed by themselves once it is there; `nothing`: only "
        "those that wait for nothing.",
    )
    created_after: Time | None = Field(None, description="Only drives uploaded then or later.")
    created_before: Time | None = Field(None, description="Only drives uploaded before.")
    batch: int | None = Field(
        None, ge=1, le=2**63 - 1, description="Only drives that were last asked for with this batch."
    )
    q: Name | None = Field(
        None,
        description="Only drives whose file's name has words that begin so (a number is a word of its own), or "
        "whose id begins so (8 digits at least).",
        examples=["karlsruhe 2026"],
    )
    sort: Sort = Field(
        Sort.CREATED_AT, description="What the drives are ordered by; what is not known comes last."
    )
    order: Direction | None = Field(
        None, description="Which end comes first. Unset: `asc` for `filename` and `status`, else `desc`."
    )
    limit: int = Field(100, ge=1, le=1000, description="Drives per page.")
    after: str | None = Field(
        None, description="Where the page begins; only `next` links know what to write here."
    )
    before: str | None = Field(
        None, description="Where the page ends; only `prev` links know what to write here."
    )


@router.get("", summary="List drives", responses=problems(422, 503))
def list_drives(
    request: Request, service: ServiceDep, base: BaseUrl, query: Annotated[DriveListRequest, Query()]
) -> DriveList:
    """The drives of the key's owner, with `operate` those of all, the newest upload first unless asked otherwise.

    Follow the `next` link until there is none. Each drive comes once; one whose place in the order changes meanwhile
    (its status, say) may come again or be missed.
    """
    refuse_unknown(request, DriveListRequest.model_fields, BadRequestError)
    after, before, limit = query.after, query.before, query.limit
    if after is not None and before is not None:
        raise BadRequestError(say("drives.after_or_before"), field="before")
    by = Order(query.sort, (query.order or default_direction(query.sort)) is Direction.DESC)
    filters = query.model_dump(exclude={"sort", "order", "limit", "after", "before"})
    places: dict[str, Any] = {
        "after": None if after is None else place_of(by, after, "after"),
        "before": None if before is None else place_of(by, before, "before"),
    }
    with service.reading() as session:
        listed = drives.list_drives(session, **filters, order=by, limit=limit + 1, **places)
    more = len(listed) > limit
    shown = listed[-limit:] if before is not None else listed[:limit]
    asked = filters | {
        "created_after": query.created_after and query.created_after.isoformat(),
        "created_before": query.created_before and query.created_before.isoformat(),
        "sort": None if query.sort is Sort.CREATED_AT else query.sort,
        "order": query.order,
        "limit": limit,
    }
    here = f"{base}/v1/drives"
    links = [link(with_query(here, **asked, after=after, before=before), "self")]
    if shown and (more or before is not None):
        links.append(link(with_query(here, **asked, after=_cursor(by, shown[-1])), "next"))
    if shown and (more if before is not None else after is not None):
        links.append(link(with_query(here, **asked, before=_cursor(by, shown[0])), "prev"))
    return DriveList(drives=[linked(base, drive) for drive in shown], links=links)


@router.get("/{drive_id}", summary="One drive", responses=problems(404, 503))
def get_drive(drive_id: uuid.UUID, service: ServiceDep, base: BaseUrl) -> Drive:
    """Status, progress, reason of a failure, and the report of the last successful run.

    A key of scope `upload` sees the drives that it sent.
    """
    with service.reading() as session:
        return linked(base, existing(drives.get_drive(session, drive_id), "drive", drive_id))


@router.delete("/{drive_id}", status_code=202, summary="Remove a drive", responses=problems(403, 404, 503))
def delete_drive(drive_id: uuid.UUID, service: ServiceDep, base: BaseUrl, origin: Origin) -> DriveAccepted:
    """Always works, whatever the status: a worker that computes it, or a trial of it, stops and discards the result.

    From the answer on the drive and every part of it are 404. Its influence leaves every segment, and its log the
    store, within seconds; `/v1/admin/queue` tells operators how many removals are under way. The same bytes uploaded
    meanwhile are a drive of their own.
    """
    existing(intake.remove_drive(service.sessions, drive_id, origin) or None, "drive", drive_id)
    return DriveAccepted(id=drive_id, status=DriveStatus("cancelled"), links=removal_links(base))


@router.post(
    "/{drive_id}/reprocess",
    status_code=202,
    summary="Process a drive again",
    responses={**UNREADABLE_BODY, **problems(403, 404, 410, 413, 422, 503)},
)
def reprocess_drive(
    drive_id: uuid.UUID,
    service: ServiceDep,
    base: BaseUrl,
    response: Response,
    query: MethodQuery,
    body: Annotated[ReprocessRequest | None, Body(description="The same as the query parameters.")] = None,
) -> DriveAccepted:
    """Queue the drive again, perhaps for another method or with other options.

    With neither a method nor options it keeps both; with a method alone, that method's defaults are used. `gnss` and
    `gnss_option` change how positions are computed, and nothing else.
    What it published stays until the new run replaces it. 410 where its log was deleted (`log_deleted_at`).
    """
    method, gnss, wanted_options = query.method, query.gnss, query.asked_options()
    if body is not None:
        method, gnss = method or body.method, gnss or body.gnss
        wanted_options = body.options if wanted_options is None else wanted_options
    positioning = asked_positioning(gnss, query.gnss_option)
    drive = existing(
        intake.reprocess(service.sessions, drive_id, method, wanted_options, positioning), "drive", drive_id
    )
    response.headers["Location"] = drive_address(base, drive)
    return accepted(base, drive)


def _cursor(order: Order, drive: Drive) -> str:
    return cursor(order, DrivePlace(drive.created_at, drive.id, drive.list_key))
