"""Exports as documents: what is asked for, and what became of it. Knows no SQL."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, Field, WithJsonSchema
from pydantic.config import JsonDict

from app.core.http import EXAMPLE_ID, Link, link
from app.core.messages import Said
from app.core.text import Moment
from app.jobs.requests.store import Request, RequestFailure

EXAMPLE_EXPORT = f"http://127.0.0.1:8000/v1/exports/{EXAMPLE_ID}"
EXAMPLE_REQUEST: dict[str, Any] = {"format": "flatgeobuf", "bbox": [8.46, 48.95, 8.5, 48.99], "driven": True}

Name = Annotated[str, Field(min_length=1, max_length=100)]


def _box_text(value: Any) -> Any:
    """Numbers as the text that ``parse_bbox`` takes."""
    return ",".join(map(str, value)) if isinstance(value, list) else value


_NUMBERS: JsonDict = {"type": "array", "items": {"type": "number"}, "minItems": 4, "maxItems": 6}
Box = Annotated[str, BeforeValidator(_box_text), WithJsonSchema({"anyOf": [_NUMBERS, {"type": "string"}]})]


class ExportStatus(StrEnum):
    """Where an export stands."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


class ExportRequest(BaseModel, extra="forbid", json_schema_extra={"examples": [EXAMPLE_REQUEST]}):
    """Which file of which part of the map."""

    format: Name = Field(
        description="One of the formats that `GET /v1/exports/formats` lists.", examples=["flatgeobuf"]
    )
    suffix: Name | None = Field(
        None, description="Which kind of it, for a format of several suffixes; by default the first."
    )
    bbox: Box | None = Field(
        None,
        description="Only what meets this box: west, south, east, north in degrees, as four numbers or as their text; "
        "west > east crosses the antimeridian.",
        examples=[[8.46, 48.95, 8.5, 48.99]],
    )
    region: Name | None = Field(None, description="Only roads of this region (`versant regions list`).")
    driven: bool = Field(False, description="Only what was driven.")
    gaps: bool = Field(False, description="Give undriven segments between driven ones a slope as well.")
    most_sigma_percent: float | None = Field(
        None, gt=0, le=1000, description="Only slopes with a sigma of at most so many percent."
    )
    least_drives: int = Field(0, ge=0, le=1_000_000, description="Only what so many drives measured.")
    options: dict[str, Any] = Field(
        default={}, description="Options of the format, by name.", examples=[{"max_zoom": 12}]
    )


class ExportFailure(RequestFailure):
    """Why an export failed."""


EXAMPLE: dict[str, Any] = {
    "id": EXAMPLE_ID,
    "status": "done",
    "progress": 1,
    "request": {
        **EXAMPLE_REQUEST,
        "suffix": ".fgb",
        "region": None,
        "gaps": False,
        "most_sigma_percent": None,
        "least_drives": 0,
        "options": {},
    },
    "failure": None,
    "data_version": "4711.12.1.1.6440f2c1a3e80",
    "provenance": {"generator": "Versant 0.1.0", "data_version": "4711.12.1.1.6440f2c1a3e80"},
    "notes": [],
    "entries": 1840,
    "file_name": "versant-flatgeobuf.fgb",
    "media_type": "application/vnd.flatgeobuf",
    "size_bytes": 498_112,
    "sha256": "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08",
    "created_at": "2026-11-20T09:12:44.120Z",
    "started_at": "2026-11-20T09:12:44.201Z",
    "finished_at": "2026-11-20T09:12:44.912Z",
    "expires_at": "2026-11-27T09:12:44.912Z",
    "links": [{"href": f"{EXAMPLE_EXPORT}/file", "rel": "enclosure", "type": "application/vnd.flatgeobuf"}],
}


class Export(Request, json_schema_extra={"examples": [EXAMPLE]}):
    """An export: a file that was asked for and what became of it."""

    status: ExportStatus = Field(
        description="`cancelled`: deleted; it is told for as long as an export is kept."
    )
    progress: float = Field(ge=0, le=1, description="Share of the work done, 0..1.")
    request: dict[str, Any] = Field(description="What was asked for, complete with defaults.")
    failure: ExportFailure | None = Field(description="Why it failed; null unless status is failed.")
    data_version: str | None = Field(
        description="Of the data that it was made from, all of one moment; equal for equal data. Null until it runs."
    )
    provenance: dict[str, Any] | None = Field(
        description="Whose data it holds and under which licence, regions and rasters with their SHA-256, datum, "
        "version of the program. The file says the same where its format has a place. Null until it is done."
    )
    notes: list[str] = Field(description="What is to be known of the file.")
    notes_said: list[Said | None] = Field(default_factory=list, description="Each of them by its key.")
    entries: int | None = Field(description="Segments, ways, tiles or whatever the file consists of.")
    file_name: str
    media_type: str
    size_bytes: int | None
    sha256: str | None = Field(description="Of the file, hex; in quotes it is the file's ETag.")
    created_at: Moment
    started_at: Moment | None
    finished_at: Moment | None
    expires_at: Moment | None = Field(
        description="When it is removed with its file; asking again makes it anew."
    )
    links: list[Link] = Field(default_factory=list)

    # The service's own, in no document.
    blob_key: str | None = Field(exclude=True)
    companions: dict[str, str] = Field(exclude=True)

    @classmethod
    def of(cls, columns: Mapping[str, Any]) -> Export:
        """The record of a row of the store."""
        failure, told = ExportFailure.of(columns), columns["notes"]
        notes, keys = told.get("notes", []), told.get("said", [])
        return cls.model_validate({**columns, "failure": failure, "notes": notes, "notes_said": keys})


class ExportList(BaseModel, json_schema_extra={"examples": [{"exports": [EXAMPLE], "links": []}]}):
    """One page of exports, the newest first."""

    exports: list[Export]
    links: list[Link] = Field(description="`next` is missing on the last page.")


class ExportFormat(BaseModel):
    """A format that can be asked for."""

    name: str
    description: str
    suffixes: list[str] = Field(description="The first is the usual one.")
    media_type: str
    filters: list[str] = Field(description="By which it can be narrowed, besides bbox.")
    options: dict[str, Any] = Field(description="JSON schema of its options.")


class ExportFormats(BaseModel, json_schema_extra={"examples": [{"formats": []}]}):
    """All formats that can be asked for."""

    formats: list[ExportFormat]


def export_address(base: str, export: Export) -> str:
    """Absolute address of the export."""
    return f"{base}/v1/exports/{export.id}"


def linked(base: str, export: Export) -> Export:
    """The export as the API shows it: with its links."""
    here = export_address(base, export)
    links = [link(here, "self", title="This export")]
    if export.status is ExportStatus.DONE:
        links.append(link(f"{here}/file", "enclosure", export.media_type, "The file"))
        for name in sorted(export.companions):
            links.append(link(f"{here}/beside/{name}", "related", None, "Belongs beside the file"))
    return export.model_copy(update={"links": links})
