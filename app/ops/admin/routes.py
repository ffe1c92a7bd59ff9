"""Routes to operators' queries: the list of them, and each as JSON or CSV."""

from __future__ import annotations

import csv
import io
import json
import uuid
from datetime import UTC, date, datetime
from decimal import Decimal
from email.utils import format_datetime
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Path, Query, Request, Response
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field

from app.core.errors import NotFoundError
from app.core.http import JSON, BaseUrl, Link, ServiceDep, json_answer, link, problems, text_answer
from app.core.messages import say
from app.core.text import preferred, utc_text
from app.ops.admin.queries import QUERIES, AdminQuery
from app.ops.admin.store import Parameters

CSV = "text/csv"
DIGITS = 6


class QueryDescription(BaseModel):
    """What a query tells."""

    name: str
    title: str
    description: str
    columns: dict[str, str] = Field(description="Name -> what it is.")
    kept: bool = Field(description="Made by a worker from time to time; `as_of` says when.")
    links: list[Link]


class QueryList(BaseModel):
    """All queries."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"queries": [], "links": []}]})

    queries: list[QueryDescription]
    links: list[Link]


ANSWER_EXAMPLE: dict[str, Any] = {
    "name": "queue",
    "title": "What waits and runs",
    "as_of": "2026-11-23T07:41:00.000Z",
    "columns": {
        "kind": "What",
        "jobs": "How many",
        "oldest_s": "Seconds since the first of them came, or began",
    },
    "rows": [{"kind": "drive, running", "jobs": 2, "oldest_s": 1.25}],
}

ANSWER = json_answer("Rows with the query's columns.", ANSWER_EXAMPLE)
ANSWER["content"] |= text_answer(CSV, "", "kind,jobs,oldest_s\n")["content"]

router = APIRouter(prefix="/v1/admin", tags=["operation"])


@router.get("", summary="Queries for operators", responses=problems(503))
def queries(base: BaseUrl) -> QueryList:
    """What can be asked under `/v1/admin/{name}`, with the meaning of each column."""
    here = f"{base}/v1/admin"
    described = [
        QueryDescription(
            name=query.name,
            title=query.title,
            description=query.description,
            columns=dict(query.columns),
            kept=query.kept,
            links=[
                link(f"{here}/{query.name}", "self"),
                link(f"{here}/{query.name}?f=csv", "alternate", CSV),
            ],
        )
        for _, query in QUERIES.items()
    ]
    return QueryList(queries=described, links=[link(here, "self"), link(f"{here}/stats", "related")])


@router.get(
    "/{name}",
    summary="One query for operators",
    response_class=Response,
    responses={200: ANSWER, **problems(404, 422, 503)},
)
def query(
    request: Request,
    service: ServiceDep,
    name: Annotated[str, Path(description="One of the list at /v1/admin.", examples=["queue"])],
    days: Annotated[
        int, Query(ge=1, le=3660, description="How many days back, where a query asks for days.")
    ] = 30,
    f: Annotated[Literal["json", "csv"] | None, Query(description="Else what Accept asks for.")] = None,
) -> Response:
    """Rows of figures for operators. Each is answered in a tenth of a second on a map of a million segments: what takes
    a look at all of it is made by a worker and kept, and `as_of` says of which moment it is.
    """
    if name not in QUERIES:
        names = ", ".join(name for name, _ in QUERIES.items())
        raise NotFoundError(say("query.no_query", name=name[:60], names=names), field="name")
    chosen = QUERIES[name]
    now = datetime.now(UTC)
    room = service.blobs.free_bytes(), service.settings.min_free_bytes
    with service.reading() as session:
        answered, made_at = chosen.read(session, Parameters(days, *room))
    rows = [{column: _plain(row.get(column)) for column in chosen.columns} for row in answered]
    as_of = made_at or now
    accepted = preferred(request.headers.get("accept"), (JSON, CSV))
    media_type = {"json": JSON, "csv": CSV}.get(f or "") or accepted or JSON
    headers = {"Cache-Control": "no-store", "Vary": "Accept"}
    if media_type == CSV:
        return Response(
            _csv(chosen, rows),
            media_type=CSV,
            headers={**headers, "Last-Modified": format_datetime(as_of.astimezone(UTC), usegmt=True)},
        )
    document = {
        "name": chosen.name,
        "title": chosen.title,
        "as_of": utc_text(as_of),
        "columns": dict(chosen.columns),
        "rows": rows,
    }
    return JSONResponse(document, headers=headers)


def _csv(query: AdminQuery, rows: list[dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(query.columns), lineterminator="\n")
    writer.writeheader()
    writer.writerows([{column: _cell(value) for column, value in row.items()} for row in rows])
    return text.getvalue()


def _cell(value: Any) -> Any:
    return json.dumps(value, ensure_ascii=False) if isinstance(value, dict) else value


def _plain(value: Any) -> Any:
    """A value of the database as JSON has it."""
    if isinstance(value, Decimal):
        value = float(value)
    if isinstance(value, float):
        return round(value, DIGITS)
    if isinstance(value, datetime):
        return utc_text(value)
    if isinstance(value, date | uuid.UUID):
        return str(value)
    return value
