"""Trials as documents: what was asked for, and what became of it. Knows no SQL."""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from datetime import timedelta
from enum import StrEnum
from typing import Any

from pydantic import BaseModel, Field

from app.core.http import EXAMPLE_ID, Link, link
from app.core.tables.requests import TRIAL_STATUSES
from app.core.text import GEO_JSON, Moment
from app.drives.documents import EXAMPLE_DRIVE, Failure
from app.jobs.requests.store import Request

KEPT = timedelta(days=7)
"""After its end a trial is forgotten."""
MOST_OF_A_DRIVE = 20

EXAMPLE_TRIAL_ID = "8c1de0f4-6f0a-4d52-9f55-0f0b7a3c9e21"
EXAMPLE_TRIAL = f"{EXAMPLE_DRIVE}/trials/{EXAMPLE_TRIAL_ID}"
TRIAL_EXAMPLE: dict[str, Any] = {
    "id": EXAMPLE_TRIAL_ID,
    "drive_id": EXAMPLE_ID,
    "method": "particle",
    "options": {"particles": 10_000},
    "status": "done",
    "progress": 1.0,
    "stage": None,
    "failure": None,
    "report": {"matched_share": 0.97, "segments_estimated": 181, "warnings": []},
    "created_at": "2026-11-20T09:12:44.120Z",
    "started_at": "2026-11-20T09:12:44.661Z",
    "finished_at": "2026-11-20T09:13:02.004Z",
    "expires_at": "2026-11-27T09:13:02.004Z",
    "links": [{"href": EXAMPLE_TRIAL, "rel": "self", "type": "application/json"}],
}

TrialStatus = StrEnum("TrialStatus", {name.upper(): name for name in TRIAL_STATUSES})  # type: ignore[misc]


class Trial(Request, json_schema_extra={"examples": [TRIAL_EXAMPLE]}):
    """A drive computed by another method or with other options, for a look at it."""

    drive_id: uuid.UUID
    method: str = Field(description="The estimator asked for.")
    options: dict[str, Any] = Field(description="The options asked for.")
    status: TrialStatus
    progress: float = Field(ge=0, le=1, description="Share of the work done, 0..1.")
    stage: str | None = Field(description="What the worker is doing, or was doing when it failed.")
    failure: Failure | None = Field(description="Why it failed; null unless status is failed.")
    report: dict[str, Any] | None = Field(description="As of a drive, of this run; null until it is done.")
    created_at: Moment
    started_at: Moment | None
    finished_at: Moment | None
    expires_at: Moment | None = Field(description="When it is forgotten; null while it is not at its end.")
    links: list[Link] = Field(default_factory=list)

    # The service's own, in no document.
    blob_key: str = Field(exclude=True)

    @classmethod
    def of(cls, columns: Mapping[str, Any]) -> Trial:
        """The record of a row of the store."""
        ended = columns["finished_at"]
        expires = None if ended is None else ended + KEPT
        return cls.model_validate({**columns, "failure": Failure.of(columns), "expires_at": expires})


class TrialList(BaseModel, json_schema_extra={"examples": [{"trials": [TRIAL_EXAMPLE]}]}):
    """The trials of a drive, the newest first."""

    trials: list[Trial]


_ACCEPTED = {name: TRIAL_EXAMPLE[name] for name in ("id", "drive_id", "status", "links")} | {
    "status": "queued"
}


class TrialAccepted(BaseModel, json_schema_extra={"examples": [_ACCEPTED]}):
    """The answer to a request for a trial."""

    id: uuid.UUID
    drive_id: uuid.UUID
    status: TrialStatus
    links: list[Link]


def trial_address(base: str, trial: Trial) -> str:
    """Absolute address of the trial."""
    return f"{base}/v1/drives/{trial.drive_id}/trials/{trial.id}"


def trial_links(base: str, trial: Trial) -> list[Link]:
    """Where the trial's parts are."""
    here = trial_address(base, trial)
    links = [
        link(here, "self", title="This trial"),
        link(f"{base}/v1/drives/{trial.drive_id}", "up", title="Its drive"),
    ]
    if trial.status == "done":
        links += [
            link(f"{here}/profile", "profile", title="Its elevation profile"),
            link(f"{here}/measurements", "measurements", title="What the sensors said along it"),
            link(f"{here}/segments", "segments", GEO_JSON, "Its estimates per road segment"),
        ]
    return links


def linked(base: str, trial: Trial) -> Trial:
    """The trial as the API shows it: with its links."""
    return trial.model_copy(update={"links": trial_links(base, trial)})


def accepted(base: str, trial: Trial) -> TrialAccepted:
    """The short answer to a request."""
    return TrialAccepted(
        id=trial.id, drive_id=trial.drive_id, status=trial.status, links=trial_links(base, trial)
    )
