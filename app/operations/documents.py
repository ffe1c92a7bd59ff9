"""Operations as documents: what the operator asked for, what it would do, and what became of it. Knows no SQL."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any

from pydantic import BaseModel, Field

from app.core.http import EXAMPLE_ID, Link, link
from app.core.text import Moment
from app.jobs.requests.store import Request, RequestFailure


class Kind(StrEnum):
    """What is to be done."""

    IMPORT_ROADS = "import-roads"
    IMPORT_DEM = "import-dem"
    REMOVE_REGION = "remove-region"
    REMOVE_RASTER = "remove-raster"
    SETTLE = "settle"
    LEARN_WIDENINGS = "learn-widenings"
    RESET_WIDENINGS = "reset-widenings"
    RELEASE = "release"


WITH_FILE = frozenset({Kind.IMPORT_ROADS, Kind.IMPORT_DEM})
PLANNED_FIRST = frozenset({Kind.IMPORT_ROADS, Kind.REMOVE_REGION, Kind.REMOVE_RASTER})
"""They say what they would do, and wait for it to be approved."""


class Status(StrEnum):
    """Where an operation stands."""

    QUEUED = "queued"
    RUNNING = "running"
    PLANNED = "planned"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


EXAMPLE_ADDRESS = f"http://127.0.0.1:8000/v1/operations/{EXAMPLE_ID}"
EXAMPLE: dict[str, Any] = {
    "id": EXAMPLE_ID,
    "kind": "import-roads",
    "subject": "karlsruhe.osm.pbf",
    "status": "planned",
    "progress": 1,
    "stage": None,
    "plan": {
        "region": "karlsruhe",
        "kept": 141_702,
        "moved": 14,
        "dropped": 31,
        "added": 46,
        "measured_lost": 3,
        "drives_again": 2,
        "segments": 141_762,
        "sentence": "Region karlsruhe would have 141762 segments (141702 kept, 14 moved within the tolerance, "
        "46 added; 31 dropped).",
    },
    "result": None,
    "failure": None,
    "created_at": "2026-11-20T09:12:44.120Z",
    "started_at": "2026-11-20T09:12:44.201Z",
    "finished_at": None,
    "links": [{"href": EXAMPLE_ADDRESS, "rel": "self", "type": "application/json"}],
}


class Failure(RequestFailure):
    """Why an operation failed."""


class Operation(Request, json_schema_extra={"examples": [EXAMPLE]}):
    """Something that the operator asked for and a worker does."""

    kind: Kind
    subject: str = Field(description="With what: the name of the file, region or raster; `map` of all.")
    status: Status = Field(
        description="`planned`: it has said what it would do, has changed nothing, and waits to be approved; forgotten "
        "after 7 days."
    )
    progress: float = Field(ge=0, le=1, description="Share of the present stage, 0..1.")
    stage: str | None = Field(description="What is being done just now.")
    plan: dict[str, Any] | None = Field(
        description="What it would do, with a `sentence`; of roads the numbers of segments."
    )
    result: dict[str, Any] | None = Field(description="What it did, with a `sentence`.")
    failure: Failure | None = Field(description="Why it failed; null unless status is failed.")
    created_at: Moment
    started_at: Moment | None
    finished_at: Moment | None
    links: list[Link] = Field(default_factory=list)

    # The service's own, in no document.
    request: dict[str, Any] = Field(exclude=True)
    state: dict[str, Any] = Field(exclude=True)
    approved: bool = Field(exclude=True)
    blob_key: str | None = Field(exclude=True)

    @classmethod
    def of(cls, columns: Mapping[str, Any]) -> Operation:
        """The record of a row of the store."""
        return cls.model_validate({**columns, "failure": Failure.of(columns)})

    @property
    def begun(self) -> bool:
        """Whether it may have changed anything."""
        return bool(self.state.get("begun"))


class OperationList(BaseModel, json_schema_extra={"examples": [{"operations": [EXAMPLE], "links": []}]}):
    """One page of operations, the newest first."""

    operations: list[Operation]
    links: list[Link] = Field(description="`next` is missing on the last page.")


def operation_address(base: str, operation: Operation) -> str:
    """Absolute address of the operation."""
    return f"{base}/v1/operations/{operation.id}"


def linked(base: str, operation: Operation) -> Operation:
    """The operation as the API shows it: with its links."""
    here = operation_address(base, operation)
    links = [link(here, "self", title="This operation")]
    if operation.status is Status.PLANNED:
        links.append(link(f"{here}/approve", "edit", title="POST carries the plan out"))
    return operation.model_copy(update={"links": links})
