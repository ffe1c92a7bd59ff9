"""Many drives removed at once: cancelled piece by piece, each with a job of its own that takes back what it said.

The request cancels them itself, so that all are removed when it is answered. Where it is cut off, its job continues: a
cancelled drive is not chosen again. It cannot be called off; a dry run shows before what it would remove.
"""

from __future__ import annotations

import logging
import uuid
from collections.abc import Callable
from datetime import datetime
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, Field
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.core.errors import BadRequestError
from app.core.http import BaseUrl, Link, Service, ServiceDep, problems
from app.core.messages import say
from app.core.query import refuse_unknown
from app.core.telemetry import audit
from app.core.telemetry.audit import Origin
from app.core.telemetry.logs import tell
from app.drives.batches import removing_store as store
from app.drives.batches.documents import BatchRequest, Which
from app.drives.batches.removing_store import Sums, Targets
from app.drives.batches.routes import chosen
from app.drives.documents import removal_links
from app.jobs.requests.pieces import do_pieces, never
from app.jobs.task import Task, Work

MOST_IDS = 500
"""In one request: as many as an address has room for."""

logger = logging.getLogger(__name__)

router = APIRouter(prefix="/v1/drives", tags=["drives"])


class RemovalRequest(BatchRequest):
    """Which drives are to go, as query parameters: those of `reprocess`, or their ids."""

    which: Which | None = Field(  # type: ignore[assignment]
        None,
        description="As of `POST /v1/drives/reprocess`; unset: `all` for which the other filters hold. Without any "
        "filter nothing is removed: `which=all` says that all are meant.",
    )
    ids: list[str] | None = Field(
        None,
        description=f"Only these drives, whatever their status; at most {MOST_IDS}, separated by commas or repeated.",
    )
    dry_run: bool = Field(False, description="Only say what would go; change nothing.")


_EXAMPLE: dict[str, Any] = {
    "drives": 12,
    "km": 74.9,
    "uploaded_bytes": 61_004_311,
    "dry_run": True,
    "sentence": "12 drives of 74.9 km, and their logs of 61.0 MB, would be removed for good.",
    "links": [],
}


class Removal(BaseModel, json_schema_extra={"examples": [_EXAMPLE]}):
    """What goes, or would go."""

    drives: int
    km: float = Field(description="Driven in all of them.")
    uploaded_bytes: int = Field(description="Size of their logs.")
    dry_run: bool
    sentence: str = Field(description="The same for a person.")
    links: list[Link]


@router.post(
    "/remove",
    status_code=202,
    summary="Remove many drives",
    responses={
        200: {"model": Removal, "description": "Of a dry run: nothing was changed."},
        **problems(403, 422, 503),
    },
)
def remove_drives(
    request: Request,
    service: ServiceDep,
    base: BaseUrl,
    response: Response,
    origin: Origin,
    query: Annotated[RemovalRequest, Query()],
) -> Removal:
    """Remove every done or failed drive that is meant, with its log and all that it said, as `DELETE` does of one.

    Of the drives of the key's owner; with `operate` of those of all. `dry_run=true` answers 200 with what would go.
    Else they and all their parts are 404 from the answer on, and workers take back what they said, behind uploads;
    drives that are uploaded or asked for again meanwhile stay. It cannot be called off. Once more finds nothing left to
    remove.
    """
    refuse_unknown(request, RemovalRequest.model_fields, BadRequestError)
    targets = _parse_targets(service, query)
    with service.sessions.begin() as session:
        sums = store.sums_of(session, targets)
        asked_at = store.ask(session, targets) if sums.drives and not query.dry_run else None
        if asked_at is not None:
            audit.note(
                session,
                origin,
                "drives removed",
                "1 drive" if sums.drives == 1 else f"{sums.drives} drives",
                **targets.selection.model_dump(mode="json", exclude_none=True, exclude={"force"}),
                ids=targets.model_dump(mode="json")["ids"],
                km=round(sums.km, 1),
            )
    if query.dry_run:
        response.status_code = 200
    else:
        tell(logger, "removal of drives asked for", drives=sums.drives)
    if asked_at is not None:
        remove_all(service.sessions, targets, asked_at)
    links = [] if query.dry_run else removal_links(base)
    return Removal(
        **sums._asdict(), dry_run=query.dry_run, sentence=_sentence(sums, query.dry_run), links=links
    )


def removing_task(sessions: Sessions) -> Task:
    """What a worker does for such a request."""

    def run(work: Work, *, asked_at: str, **arguments: Any) -> str:
        targets = Targets.model_validate(arguments)
        return f"{remove_all(sessions, targets, datetime.fromisoformat(asked_at), work.should_stop)} drives"

    def fail(kind: str, reason: str, **_: Any) -> None:
        logger.error("not all drives could be removed that were to be: %s", reason)

    return Task(store.REMOVE_DRIVES, run, fail, subject="removal")


def remove_all(
    sessions: Sessions, targets: Targets, asked_at: datetime | None, should_stop: Callable[[], bool] = never
) -> int:
    """Cancel all that are meant, each with a job that takes it back; how many. ``asked_at`` None: those of now."""
    count, last = 0, None

    def piece(session: Session) -> bool:
        nonlocal count, last
        drives, last = store.remove_piece(session, targets, asked_at, last)
        count += drives
        return last is not None

    do_pieces(sessions, piece, should_stop=should_stop)
    if count:
        tell(logger, "drives cancelled", drives=count, reason="their removal was asked for")
    return count


def _parse_targets(service: Service, query: RemovalRequest) -> Targets:
    """``BadRequestError`` for what cannot be meant."""
    ids = _ids(query.ids)
    filters = query.model_dump(exclude={"method", "dry_run", "bbox", "which", "ids", "force"})
    if ids is None and query.which is None and query.bbox is None and not any(filters.values()):
        raise BadRequestError(say("drives.which"), field="which")
    # Also those whose log cannot be used: of these one wants to be rid.
    filters |= {"which": query.which or Which.ALL, "force": True}
    selection, method = chosen(service, filters, query.bbox, query.method)
    return Targets(selection=selection, method=method, ids=ids)


def _ids(query: list[str] | None) -> tuple[uuid.UUID, ...] | None:
    if query is None:
        return None
    named = [one.strip() for text in query for one in text.split(",") if one.strip()]
    if not named or len(named) > MOST_IDS:
        raise BadRequestError(say("drives.ids_number", most=MOST_IDS), field="ids")
    try:
        return tuple(dict.fromkeys(uuid.UUID(one) for one in named))
    except ValueError:
        raise BadRequestError(say("drives.ids"), field="ids") from None


def _sentence(sums: Sums, dry_run: bool) -> str:
    if not sums.drives:
        return "No drive is meant: nothing " + ("would be removed." if dry_run else "is removed.")
    drives, logs = ("1 drive", "its log") if sums.drives == 1 else (f"{sums.drives} drives", "their logs")
    verb = "would be" if dry_run else ("is" if sums.drives == 1 else "are")
    return f"{drives} of {sums.km:.1f} km, and {logs} of {sums.uploaded_bytes / 1e6:.1f} MB, {verb} removed for good."
