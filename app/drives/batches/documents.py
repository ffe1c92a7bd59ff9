"""Batches of drives that are processed again: which are asked for, and the documents about them. Knows no SQL."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from enum import StrEnum
from typing import Annotated, Any, NamedTuple

from pydantic import AfterValidator, BaseModel, Field

from app.core.db import Bounds
from app.core.http import Link
from app.core.messages import SAID, Said, say
from app.core.text import Moment
from app.core.version import code_version
from fusion.messages import joined
from fusion.registry import DEFAULT_METHOD

EXAMPLE_BATCH = "http://127.0.0.1:8000/v1/drives/reprocess?batch=7"

HOPELESS = ("unknown-format", "empty-log", "malformed-log", "bad-log")
"""Kinds of failures that are the log's own fault: the same code finds the same again, whatever the method."""

LOG_DELETED = "log-deleted"
"""Among the reasons why a drive is left out: its owner keeps logs no longer."""


class Which(StrEnum):
    """The drives that a batch begins from; further filters narrow them."""

    OTHER = "other"
    STALE = "stale"
    FAILED = "failed"
    ALL = "all"


def _utc(moment: datetime) -> datetime:
    """Times are UTC where they do not say otherwise."""
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


Time = Annotated[datetime, AfterValidator(_utc)]
Name = Annotated[str, Field(min_length=1, max_length=100)]  # without a bound, they could not be indexed


class Selection(BaseModel, frozen=True):
    """Which drives are meant: done or failed ones for which all that is said here holds."""

    which: Which = Field(
        Which.OTHER,
        description="`other`: drives that are not of `method` already; `stale`: whose estimates were made by another "
        "version of the code, with other defaults, on other roads, or with other elevation rasters where they drove, "
        "than would be taken now; `failed`; `all`.",
    )
    from_method: Name | None = Field(
        None, description="Only drives that were processed by this method.", examples=["particle"]
    )
    code_version: Name | None = Field(
        None,
        description="Only drives whose estimates were made by this version of the code.",
        examples=["1.0.0"],
    )
    failure: Name | None = Field(
        None, description="Only drives that failed for this reason.", examples=["no-match"]
    )
    created_after: Time | None = Field(None, description="Only drives uploaded then or later.")
    created_before: Time | None = Field(None, description="Only drives uploaded before.")
    driven_after: Time | None = Field(None, description="Only drives recorded then or later.")
    driven_before: Time | None = Field(None, description="Only drives recorded before.")
    region: Name | None = Field(
        None,
        description="Only drives on roads of this region (`versant regions list`).",
        examples=["karlsruhe"],
    )
    imported: int | None = Field(
        None,
        ge=1,
        le=2**63 - 1,
        description="Only drives that came with this import (`versant import-batch`).",
        examples=[7],
    )
    bbox: Bounds | None = None
    force: bool | None = Field(
        None,
        description="Also drives of which this version of the code has found that the log itself cannot be used (kinds "
        f"{', '.join(HOPELESS)}). They are left out otherwise, unless `failure` names their kind.",
    )


class BatchRequest(Selection):
    """What can be asked of many drives at once, as query parameters."""

    method: str | None = Field(
        None,
        description="The estimator, with its default options. Unset: with `which=other` the service's default, else "
        "each drive keeps its own with the options that it has.",
        examples=[DEFAULT_METHOD],
    )
    dry_run: bool = Field(False, description="Only count the drives; change nothing.")
    bbox: str | None = Field(  # type: ignore[assignment]
        None,
        description="Only drives whose positions' box meets this one: west,south,east,north in degrees; "
        "west > east crosses the antimeridian.",
        examples=["8.46,48.95,8.50,48.99"],
    )


class BatchState(StrEnum):
    """Where a batch stands."""

    ENQUEUING = "enqueuing"
    RUNNING = "running"
    DONE = "done"
    CANCELLED = "cancelled"


_ACCEPTED = {
    "queued": 12,
    "complete": True,
    "method": "raw",
    "dry_run": False,
    "links": [{"href": EXAMPLE_BATCH, "rel": "monitor", "type": "application/json"}],
}


class BatchAccepted(BaseModel, json_schema_extra={"examples": [_ACCEPTED]}):
    """The answer to a request to process many drives again."""

    queued: int = Field(description="Drives that wait to be processed again; of a dry run: that would.")
    complete: bool = Field(description="False: there are more, which a worker puts into the queue by itself.")
    method: str | None = Field(description="Null: each drive keeps its own.")
    dry_run: bool
    skipped: dict[str, int] = Field(
        default={},
        description="Drives that were left out: failed ones by the kind of their failure (see `force`), and those "
        f"whose log was deleted (`{LOG_DELETED}`), done ones as well.",
    )
    note: str | None = Field(None, description="Why these were left out, or why no drive was chosen.")
    note_said: Said | None = Field(None, description=f"The same by its key; {SAID}")
    links: list[Link]


_EXAMPLE: dict[str, Any] = {
    "state": "running",
    "asked_at": "2026-11-20T09:12:44.120Z",
    "method": "raw",
    "selection": {"which": "other"},
    "drives": 12,
    "queued": 4,
    "running": 1,
    "done": 6,
    "failed": 1,
    "progress": 0.6125,
    "links": [{"href": EXAMPLE_BATCH, "rel": "self", "type": "application/json"}],
}


class Batch(
    BaseModel,
    frozen=True,
    json_schema_serialization_defaults_required=True,
    json_schema_extra={"examples": [_EXAMPLE]},
):
    """How far many drives are that are processed again."""

    state: BatchState = Field(
        description="`enqueuing`: its drives are not all in the queue yet; `cancelled`: those that waited are as they "
        "were before."
    )
    asked_at: Moment | None = Field(None, description="Null of all that is under way.")
    method: str | None = Field(None, description="Null: each drive keeps its own.")
    selection: dict[str, Any] | None = Field(
        None, description="Which drives were asked for; of a batch that is in the queue without its `bbox`."
    )
    drives: int
    queued: int
    running: int
    done: int
    failed: int
    progress: float = Field(ge=0, le=1, description="Share of the work done, 0..1; 1: nothing is left to do.")
    links: list[Link] = Field(default_factory=list)


class Standing(NamedTuple):
    """How many drives there are for a batch to choose from."""

    ended: int
    """Done or failed."""
    under_way: int
    """They wait or run already."""


def note(
    selection: Selection, method: str | None, chosen: int, skipped: Mapping[str, int], standing: Standing
) -> str | None:
    """The sentences for whoever asked; None where all that was meant was chosen."""
    sentences = []
    hopeless = {kind: count for kind, count in skipped.items() if kind != LOG_DELETED}
    if hopeless:
        kinds = ", ".join(f"{count} {kind}" for kind, count in hopeless.items())
        sentences.append(say("batch.hopeless", n=sum(hopeless.values()), kinds=kinds))
    if without := skipped.get(LOG_DELETED):
        sentences.append(say("batch.log_deleted", n=without))
    if not chosen and not skipped:
        sentences.append(say("batch.nothing", why=_why_none(selection, method, standing)))
    return joined(sentences) if sentences else None


def _why_none(selection: Selection, method: str | None, standing: Standing) -> str:
    if not standing.ended:
        waiting = say("batch.under_way", n=standing.under_way) if standing.under_way else ""
        return joined([say("batch.none_ended"), waiting])
    if selection.model_dump(exclude={"which", "force"}, exclude_none=True):
        return say("batch.none_fits", n=standing.ended)
    return {
        Which.OTHER: say("batch.all_of_method", n=standing.ended, method=method),
        Which.STALE: say("batch.none_stale", n=standing.ended, version=code_version()),
        Which.FAILED: say("batch.none_failed"),
        Which.ALL: "",  # it chooses every drive that ended
    }[selection.which]
