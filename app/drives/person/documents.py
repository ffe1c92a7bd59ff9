"""What the API says of the removal of an owner. Knows no SQL."""

from __future__ import annotations

import uuid
from datetime import date
from enum import StrEnum
from typing import Any

from pydantic import BaseModel, Field

from app.core.http import EXAMPLE_ID, Link

_COUNTS = {
    "drives": 340,
    "bytes": 912_004_311,
    "trials": 2,
    "keys": 12,
    "sessions": 1,
    "exports": 3,
    "webhooks": 1,
    "zones": 2,
}
_EXAMPLE: dict[str, Any] = {
    "id": EXAMPLE_ID,
    "state": "done",
    "asked_on": "2026-11-27",
    "ended_on": "2026-11-27",
    "removed": _COUNTS,
    "drives_left": 0,
    "audit_rows_kept": 14,
    "sentences": ["340 drives with logs of 912.0 MB, 12 keys: all of it is removed."],
    "links": [{"href": f"http://127.0.0.1:8000/v1/removals/{EXAMPLE_ID}", "rel": "self"}],
}

WHY_AUDIT_STAYS = (
    "{rows} of the audit stay, because others have to be able to see why the map changed: what was done on which day, "
    "without key, address or program, and no longer under this owner."
)


class RemovalState(StrEnum):
    """Where a removal stands."""

    RUNNING = "running"
    DONE = "done"


class Counts(BaseModel):
    """What there was of an owner, and goes."""

    drives: int = Field(description="With their logs, tracks, profiles and estimates.")
    bytes: int = Field(description="Of the logs that were kept, as stored.")
    trials: int = Field(description="Other methods that were tried on the drives.")
    keys: int = Field(description="Those revoked before included.")
    sessions: int = Field(description="Browsers that were logged in.")
    exports: int
    webhooks: int
    zones: int


class OwnerRemoval(BaseModel, json_schema_extra={"examples": [_EXAMPLE]}):
    """The receipt of a removal: counts and days, and nothing that tells whose it was."""

    id: uuid.UUID = Field(description="Whoever knows it may read the receipt.")
    state: RemovalState = Field(
        description="`running`: nothing of it is shown to anybody any more, and the map is computed without it, piece "
        "by piece; `done`: nothing is left."
    )
    asked_on: date = Field(description="The day, UTC.")
    ended_on: date | None = Field(
        description="The day on which nothing was left, UTC; null: it is under way."
    )
    removed: Counts
    drives_left: int = Field(description="Drives that are still to be taken out of the map.")
    audit_rows_kept: int | None = Field(description="Rows of the audit that stay; null until it is done.")
    sentences: list[str] = Field(description="The same for a person, and what stays and why.")
    links: list[Link]


def sentences(removed: Counts, drives_left: int, kept: int | None) -> list[str]:
    """What a person is told."""
    drives, keys = _number(removed.drives, "drive"), _number(removed.keys, "key")
    what = f"{drives} with logs of {removed.bytes / 1e6:.1f} MB, {keys}"
    if kept is None:
        return [
            f"{what}: nobody sees anything of them any more, and no key lets anybody in.",
            f"{_number(drives_left, 'drive')} of them wait to be taken out of the map, behind what is uploaded.",
        ]
    audit = WHY_AUDIT_STAYS.format(rows=_number(kept, "row")) if kept else "Nothing of the audit is left."
    copies = "Backups of this service keep what they hold until they are deleted, and so does who fetched an edition."
    return [f"{what}: all of it is removed.", audit, copies]


def _number(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
