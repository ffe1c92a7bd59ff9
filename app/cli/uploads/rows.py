"""A line of ``versant upload`` for each drive, and for each file that is in none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from app.cli.console import spoken
from app.core.messages import say
from fusion.messages import remarks_of

if TYPE_CHECKING:
    from app.cli.client import RemoteDrive

SHOWN = ("file", "drive", "status", "segments")
"""What the table shows of each upload; why one failed is said once, on standard error."""

SENT_BEFORE = "sent before"
"""The status of a drive that an earlier run sent, of which no more is asked."""

NO_LOGS = frozenset({"unknown-format", "repeated", "no-drive", "not-on-roads"})
"""Kinds of files that nobody misses where they are left out."""


@dataclass
class Upload:
    """One drive on its way, or a file that is in none."""

    name: str
    drive: RemoteDrive | None = None
    reason: str | None = None
    segments: int | None = None
    left_out: str | None = None
    """Why it is in no drive: a kind of the service's; None: it is, or was to be."""

    is_of_archive: bool = False
    """Whether the manifest told before that it is in no drive: then nothing failed."""

    @property
    def status(self) -> str:
        """The drive's status, ``not sent``, or ``left out``."""
        return self.drive.status if self.drive else "left out" if self.left_out else "not sent"

    @property
    def failed(self) -> bool:
        """Whether nothing came of it, though it was to."""
        is_missed = self.left_out not in {None, *NO_LOGS} and not self.is_of_archive
        return self.status in {"not sent", "failed", "cancelled"} or is_missed

    @property
    def waits_for(self) -> dict[str, Any] | None:
        """What is missing until it is computed by itself; None: nothing, or the service is too old to say."""
        return self.drive.document.get("waits_for") if self.drive else None

    @property
    def report(self) -> dict[str, Any]:
        """What the service reports of it; empty before it is done."""
        return (self.drive.document.get("report") or {}) if self.drive and self.status == "done" else {}

    def figures(self) -> dict[str, Any]:
        """What ``--json`` says; the table shows ``SHOWN`` of it."""
        from app.cli.client import link_of
        from app.drives.outputs.summary import summary

        document = self.drive.document if self.drive else {}
        return {
            "file": self.name,
            "drive": self.drive.id if self.drive else None,
            "status": self.status,
            "segments": self.segments,
            "reason": self.reason,
            "waits_for": self.waits_for,
            "summary": summary(self.name, self.report) if self.report else None,
            "warnings": remarks_of(self.report),
            "address": link_of(document, "self"),
            "profile": link_of(document, "profile", "image/png") if self.report else None,
        }


def shown_status(status: str, waits_for: Mapping[str, Any] | None) -> str:
    """A drive's status for people: one that failed for want of roads waits for them."""
    return say("drives.waits_for", what=waits_for["kind"]) if waits_for else spoken(status)
