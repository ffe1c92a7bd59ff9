"""What the columns of a CSV are taken as over HTTP: of a stored log, and of a file that was not uploaded yet."""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool

from app.core.http import ServiceDep, existing, problems
from app.drives import store as drives
from app.drives.method_choice import asked_columns
from app.drives.parts.reading import opened_log
from app.drives.receiving.first_look import unpacked
from fusion.errors import LogError

HEAD_BYTES = 64 * 1024
"""Read of a log: its header and the first of its rows. No body that is no upload may be larger."""

router = APIRouter(prefix="/v1/drives", tags=["drives"])


class LogColumn(BaseModel):
    """A column of a CSV, and what it is taken as."""

    name: str = Field(description="As the header calls it.")
    taken_as: str | None = Field(
        description="The column of Versant that it is taken for; `date` and `device_acceleration` are such too, and "
        "nothing else can be said of them. Null: it is not used."
    )
    unit: str | None = Field(
        description="The unit that its values are taken in. Null: it has none or, of a speed, none is named and the "
        "positions tell it."
    )
    guessed: bool = Field(description="Whether that is guessed from its name, and nobody said it.")
    values: list[str] = Field(description="Its first three values, as they are written.")


_EXAMPLE = {
    "name": "Altitude (ft)",
    "taken_as": "alt_msl_m",
    "unit": "ft",
    "guessed": True,
    "values": ["384.1", "384.4", "384.9"],
}


class LogColumns(BaseModel, json_schema_extra={"examples": [{"columns": [_EXAMPLE]}]}):
    """The columns of a log."""

    columns: list[LogColumn] = Field(
        description="In the order of the file; empty where the log is no table whose columns have names, or several "
        "files."
    )


@router.get(
    "/{drive_id}/columns",
    summary="What the columns of a drive's log are taken as",
    responses=problems(404, 410, 503),
)
def drive_columns(drive_id: uuid.UUID, service: ServiceDep) -> LogColumns:
    """Of a CSV each column, what it is taken as, its unit and three values, as far as the first 64 kB tell.

    To correct it, process the drive again with the option `columns`: Versant's name -> the header's, or `-` where the
    file has no such column, whatever its names are like. 410 where the owner keeps logs no longer.
    """
    with service.reading() as session:
        drive = existing(drives.get_drive(session, drive_id), "drive", drive_id)
    drive.require_log()
    with opened_log(service, drive, HEAD_BYTES) as file:
        head = file.read(HEAD_BYTES)
    named = drive.options.get("columns")
    return _columns(head, named if isinstance(named, dict) else {})


@router.post(
    "/columns",
    summary="What the columns of a CSV would be taken as",
    responses=problems(413, 422, 503),
    openapi_extra={
        "requestBody": {
            "required": True,
            "description": "The beginning of the file, plain or gzipped.",
            "content": {
                "application/octet-stream": {
                    "schema": {"type": "string", "format": "binary"},
                    "example": "time,Latitude,Longitude,Altitude (ft)",
                }
            },
        }
    },
)
async def columns_of_file(
    request: Request,
    columns: Annotated[
        list[str],
        Query(
            description="One column that is called otherwise, as `versant_name=name in the header`; may be repeated.",
            examples=[["alt_msl_m=Altitude"]],
        ),
    ] = [],  # noqa: B006 - FastAPI copies it
) -> LogColumns:
    """The same of the first bytes of a file, 64 kB at most, before it is uploaded. Nothing is stored."""
    named = asked_columns(columns).get("columns", {})
    return await run_in_threadpool(_columns, await request.body(), named)


def _columns(head: bytes, named: Mapping[str, Any]) -> LogColumns:
    from fusion.formats import columns_of  # noqa: PLC0415 - with its readers only where they are needed

    try:
        taken = columns_of(unpacked(head)[:HEAD_BYTES], named)
    except LogError:
        return LogColumns(columns=[])
    return LogColumns(columns=[LogColumn.model_validate(asdict(one)) for one in taken])
