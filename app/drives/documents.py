"""A drive as one record, from its row to its JSON, and the other documents about drives.

What the store returns, the worker works by and the API shows is the same ``Drive``; only its links wait until it is
served, because they need the address that the request came to. Knows no SQL and no route.
"""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from datetime import datetime
from enum import StrEnum
from typing import Any, NamedTuple

from pydantic import BaseModel, Field

from app.core.caller import present_caller
from app.core.db import Bounds
from app.core.errors import LogDeletedError
from app.core.http import EXAMPLE_ID, Link, link
from app.core.messages import SAID, Said, said_in, say
from app.core.tables import DRIVE_STATUSES
from app.core.text import GEO_JSON, Moment
from app.drives.remaining import remaining_s
from app.network.cells import cell_name
from app.network.rejections import Rejections
from app.roads.named_extracts import NO_ROADS, extracts_over
from fusion.messages import remarks_of, with_remarks
from fusion.report import with_contradiction, with_duplicate

EXAMPLE_DRIVE = f"http://127.0.0.1:8000/v1/drives/{EXAMPLE_ID}"

DRIVE_EXAMPLE: dict[str, Any] = {
    "id": EXAMPLE_ID,
    "status": "done",
    "progress": 1.0,
    "stage": None,
    "remaining_s": None,
    "failure": None,
    "waits_for": None,
    "filename": "monday.ubx",
    "size_bytes": 5_021_417,
    "sha256": "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08",
    "method": "profile",
    "options": {},
    "created_at": "2026-11-20T09:12:44.120Z",
    "queued_at": "2026-11-20T09:12:44.120Z",
    "started_at": "2026-11-20T09:12:44.661Z",
    "finished_at": "2026-11-20T09:13:02.004Z",
    "drive_time": "2026-11-20T07:55:10.000Z",
    "duplicate_of": None,
    "same_as": None,
    "unsolved": [],
    "epochs": 549,
    "distance_m": 6240.3,
    "bbox": [8.4611, 48.9512, 8.4987, 48.9838],
    "log_deleted_at": None,
    "report": {"matched_share": 0.98, "breaks": [], "rejected_segments": 0, "warnings": []},
    "links": [{"href": EXAMPLE_DRIVE, "rel": "self", "type": "application/json"}],
}

# A StrEnum made from the tuple that the table's constraint is made from: one list of statuses.
DriveStatus = StrEnum("DriveStatus", {name.upper(): name for name in DRIVE_STATUSES})  # type: ignore[misc]
ENDED = frozenset({"done", "failed"})
"""Statuses that stay until somebody asks for more; a cancelled drive will soon be gone."""
ROADS_STAGE = "roads"
"""The stage in which a drive fails for want of roads where it was."""
MOST_NAMED = 5
"""Cells that one warning names."""


class Failure(BaseModel):
    """Why a drive failed."""

    kind: str = Field(description="Stable identifier of the reason.")
    reason: str = Field(description="What is wrong and what to do about it.")
    stage: str | None = Field(description="What the worker was doing.")
    where: str | None = Field(description="The line, byte or field at fault, as far as known.")
    said: Said | None = Field(None, description=f"The reason by its key; {SAID}")
    where_said: Said | None = Field(None, description="The same of where.")

    @classmethod
    def of(cls, columns: Mapping[str, Any]) -> Failure | None:
        """The reason in the columns of a row, of a drive or of a trial; None unless it is failed."""
        if columns["status"] != "failed":
            return None
        return cls(
            kind=columns["failure_kind"] or "unknown",
            reason=columns["failure_reason"] or say("drive.no_reason"),
            stage=columns["stage"],
            where=columns["failure_where"],
            **said_in(columns),
        )


class WaitsFor(BaseModel):
    """What a drive that failed lacks, and is computed by itself once it is there."""

    kind: str = Field(description="`roads`: none are imported where it was driven. Others may come.")
    extract: str | None = Field(
        description="Name of the extract of OpenStreetMap that very likely holds them, such as "
        "`europe/germany/baden-wuerttemberg`; null: none that is known holds the whole drive's box."
    )
    extracts: list[str] = Field(description="The same and others that may, the likeliest first.")

    @classmethod
    def of(cls, columns: Mapping[str, Any]) -> WaitsFor | None:
        """What the drive of a row waits for; None: nothing. The list's filter says the same (``app.drives.store``)."""
        if columns["status"] != "failed" or columns["stage"] != ROADS_STAGE:
            return None
        if columns["failure_kind"] not in NO_ROADS or columns["log_deleted_at"] is not None:
            return None
        box = columns["bbox"]
        names = () if box is None else extracts_over((box[0], box[1], box[2], box[3]))
        return cls(kind="roads", extract=next(iter(names), None), extracts=list(names))


# Whoever reads the document finds every member, also the links, which a drive fresh from the store has not.
class Drive(
    BaseModel,
    frozen=True,
    json_schema_serialization_defaults_required=True,
    json_schema_extra={"examples": [DRIVE_EXAMPLE]},
):
    """A drive: an uploaded log and what became of it."""

    id: uuid.UUID
    status: DriveStatus
    progress: float = Field(ge=0, le=1, description="Share of the work done, 0..1.")
    stage: str | None = Field(description="What the worker is doing, or was doing when it failed.")
    remaining_s: float | None = Field(
        None,
        description="About how long it will still be computed, seconds, rounded; null where nobody knows.",
    )
    failure: Failure | None = Field(description="Why it failed; null unless status is failed.")
    waits_for: WaitsFor | None = Field(
        None,
        description="Of a drive with status `failed` that is nobody's fault: what is missing until it is computed by "
        "itself. Its track and profile are what the log says. Null where it waits for nothing.",
    )
    filename: str = Field(description="Of several files their names, separated by commas.")
    size_bytes: int = Field(
        description="Size as uploaded; of several files that of the zip that they are kept as."
    )
    sha256: str = Field(
        description="SHA-256 of these bytes. The same content is the same drive, unpacked, gzipped or in a zip."
    )
    method: str = Field(description="The estimator asked for.")
    options: dict[str, Any] = Field(description="The options asked for; the report holds all of them.")
    created_at: Moment
    queued_at: Moment
    started_at: Moment | None
    finished_at: Moment | None
    drive_time: Moment | None = Field(description="When the recording begins.")
    duplicate_of: uuid.UUID | None = Field(
        description="The drive that this one duplicates: it was at the same places at the same times and holds more "
        "measurements, so it alone counts. Usually null; another owner's drive is not told."
    )
    same_as: uuid.UUID | None = Field(
        description="Former name of `duplicate_of`.", json_schema_extra={"deprecated": True}
    )
    unsolved: list[str] = Field(
        default_factory=list,
        description="Cells of the map, z/x/y, that solvers repeatedly failed to solve: the drive's slopes there are "
        "not published yet. A drive waits some minutes for them, and is done without them.",
    )
    epochs: int | None
    distance_m: float | None
    bbox: Bounds | None = Field(description="West, south, east, north; degrees.")
    log_deleted_at: Moment | None = Field(
        description="When its log was deleted, because its owner keeps logs no longer; null: it is there. Results "
        "stay, but the drive cannot be computed again."
    )
    report: dict[str, Any] | None = Field(
        description="Of the last successful run: matched share and breaks, learned noise, mount, what each sensor "
        "contributes, on how many segments it contradicts other drives now (rejected_segments), how positions were "
        "computed (gnss: epochs solved and predicted, satellites, clock jumps ...), warnings, versions ..."
    )
    links: list[Link] = Field(default_factory=list)

    def require_log(self) -> None:
        """``LogDeletedError`` where it was deleted."""
        if self.log_deleted_at is not None:
            raise LogDeletedError(say("drives.log_deleted", id=self.id))

    # The service's own, in no document.
    owner_id: int = Field(exclude=True)
    blob_key: str = Field(exclude=True)
    generation: int = Field(exclude=True)
    duplicate_is_anothers: bool | None = Field(exclude=True)
    """Whether ``duplicate_of`` is another owner's; None: there is none, or it is not to be seen."""
    traceparent: str | None = Field(None, exclude=True)
    list_key: Any = Field(None, exclude=True)  # what a list has it ordered by, beside its time and id

    @classmethod
    def of(cls, columns: Mapping[str, Any]) -> Drive:
        """The record of a row of the store, which has the reason of a failure in columns of its own."""
        unsolved = [cell_name(cell) for cell in columns["unsolved_cells"]]
        report = _as_it_is_now(columns["report"], columns["rejections"], columns["duplicate_of"], unsolved)
        left_s = remaining_s(columns["ran_s"], columns["progress"], columns["stage"])
        derived = {
            "failure": Failure.of(columns),
            "waits_for": WaitsFor.of(columns),
            "unsolved": unsolved,
            "report": report,
            "remaining_s": left_s,
        }
        return cls.model_validate({**columns, "same_as": columns["duplicate_of"], **derived})


def _as_it_is_now(
    report: dict[str, Any] | None,
    rejections: Rejections | None,
    duplicate_of: uuid.UUID | None,
    unsolved: Sequence[str],
) -> dict[str, Any] | None:
    """The report with what changes as other drives come and go, and is therefore said when it is read.

    ``rejections``: on how many segments the drive has passes, and on how many of them none is accepted; None: on none.
    """
    if report is None:
        return None
    segments, rejected = rejections or Rejections(0, 0)
    warnings = with_contradiction(remarks_of(report), rejected, segments)
    if duplicate_of is not None:
        warnings = with_duplicate(warnings, str(duplicate_of))
    if unsolved:
        warnings.append(_unsolved_warning(unsolved))
    return with_remarks({**report, "rejected_segments": rejected}, warnings)


def _unsolved_warning(unsolved: Sequence[str]) -> str:
    """That something of the drive is not on the map."""
    more = say("more", n=len(unsolved) - MOST_NAMED) if len(unsolved) > MOST_NAMED else ""
    return say("drive.unsolved", cells=list(unsolved[:MOST_NAMED]), more=more)


class DrivePlace(NamedTuple):
    """A place in the list of drives, whether or not the drive is still there."""

    created_at: datetime
    id: uuid.UUID
    key: Any = None
    """What the list is ordered by before these; None: not known, or nothing (``app.drives.listing``)."""


class DriveList(BaseModel, json_schema_extra={"examples": [{"drives": [DRIVE_EXAMPLE], "links": []}]}):
    """One page of drives, in the order asked for."""

    drives: list[Drive]
    links: list[Link] = Field(description="`next` is missing on the last page, `prev` on the first.")


_ACCEPTED = {"id": EXAMPLE_ID, "status": "queued", "links": DRIVE_EXAMPLE["links"]}


class DriveAccepted(BaseModel, json_schema_extra={"examples": [_ACCEPTED]}):
    """The answer to an upload or a request to process again."""

    id: uuid.UUID
    status: DriveStatus
    links: list[Link]


_ANEW = {"method": "particle", "options": {"particles": 10_000}}


class ReprocessRequest(BaseModel, extra="forbid", json_schema_extra={"examples": [_ANEW]}):
    """How to process a drive again; what is left out stays as it was."""

    method: str | None = Field(None, description="Another estimator.")
    options: dict[str, Any] | None = Field(None, description="Its options; leaving them out means defaults.")
    gnss: str | None = Field(
        None, description="Another way to compute positions, in the place of the option `gnss`."
    )


def drive_address(base: str, drive: Drive) -> str:
    """Absolute address of the drive."""
    return f"{base}/v1/drives/{drive.id}"


def drive_links(base: str, drive: Drive) -> list[Link]:
    """Where the drive's parts are, as far as the caller's key is for them."""
    here = drive_address(base, drive)
    links = [
        link(here, "self", title="This drive"),
        link(f"{here}/events", "events", "text/event-stream", "Its progress as server-sent events"),
    ]
    if not present_caller().may("own"):
        return links
    links += [
        link(f"{here}/track", "track", GEO_JSON, "Its estimated track"),
        link(f"{here}/track?f=gpx", "track", "application/gpx+xml", "The same for other programs"),
        link(f"{here}/track?f=csv", "track", "text/csv", "The same as a log"),
        link(f"{here}/profile", "profile", title="Its elevation profile"),
        link(f"{here}/profile?f=png", "profile", "image/png", "Its elevation profile as a picture"),
        link(f"{here}/segments", "segments", GEO_JSON, "Its estimates per road segment"),
        link(f"{here}/measurements", "measurements", title="What its sensors said along it"),
        link(f"{here}/trials", "trials", title="What other methods made of it; POST: try one"),
    ]
    if drive.log_deleted_at is None:
        links += [
            link(f"{here}/columns", "describedby", title="What the columns of its log are taken as"),
            link(f"{here}/log", "enclosure", "application/octet-stream", "Its log as it was uploaded"),
            link(f"{here}/reprocess", "reprocess", title="POST: process it again"),
        ]
    return links


def removal_links(base: str) -> list[Link]:
    """Where operators read how many removals are under way."""
    if not present_caller().may("operate"):
        return []
    return [link(f"{base}/v1/admin/queue", "monitor", title="How many removals are under way")]


def linked(base: str, drive: Drive) -> Drive:
    """The drive as the API shows it to the caller: with its links, and without what is another owner's."""
    shown = drive if _may_know_duplicate(drive) else _without_duplicate(drive)
    return shown.model_copy(update={"links": drive_links(base, drive)})


def _may_know_duplicate(drive: Drive) -> bool:
    """The database tells an owner of no other's drive. What all followers are told is read once, for operators."""
    caller = present_caller()
    return caller.may("operate") or (caller.may("own") and not drive.duplicate_is_anothers)


def _without_duplicate(drive: Drive) -> Drive:
    report = drive.report
    if report is not None and drive.duplicate_of is not None:
        told = with_duplicate((), str(drive.duplicate_of))
        report = with_remarks(report, [one for one in remarks_of(report) if one not in told])
    return drive.model_copy(update={"duplicate_of": None, "same_as": None, "report": report})


def accepted(base: str, drive: Drive) -> DriveAccepted:
    """The short answer to an upload or a request to process again."""
    return DriveAccepted(id=drive.id, status=drive.status, links=drive_links(base, drive))
