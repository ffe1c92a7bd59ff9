"""What is said of a batch besides its number of drives: which were left out, and why none was chosen. Knows no SQL."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from app.core.version import code_version
from app.drives.batches.documents import Selection, Which


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
    if skipped:
        kinds = ", ".join(f"{count} {kind}" for kind, count in skipped.items())
        sentences.append(
            f"{_drives(sum(skipped.values()), 'failed ')} left out, because this version of the code has found that "
            f"the log itself cannot be used, and would again: {kinds}. To try all the same, name the drive (--drive "
            "ID), name the kind of failure (--failure KIND, failure=KIND), or use --force (force=true)."
        )
    if not chosen and not skipped:
        sentences.append(f"Nothing was chosen. {_why_none(selection, method, standing)}")
    return " ".join(sentences) or None


def _why_none(selection: Selection, method: str | None, standing: Standing) -> str:
    if not standing.ended:
        waiting = f" {_drives(standing.under_way)} waiting or running already." if standing.under_way else ""
        return f"No drive is done or failed.{waiting}"
    if selection.model_dump(exclude={"which", "force"}, exclude_none=True):
        return (
            f"Of {standing.ended} that are done or failed, no drive fits all that was asked for; fewer filters choose "
            "more."
        )
    return {
        Which.OTHER: f"Of {standing.ended} that are done or failed, every drive is of the method {method} already. "
        "--all (which=all) chooses each of them, --stale (which=stale) those that another version of the code or other "
        "defaults computed, --failed (which=failed) those that failed.",
        Which.STALE: f"Of {standing.ended} that are done or failed, no drive has estimates that are stale: all were "
        f"computed by this version of the code ({code_version()}) with the defaults of now. --all (which=all) chooses "
        "each of them, --failed (which=failed) those that failed.",
        Which.FAILED: "No drive is failed.",
        Which.ALL: "",  # it chooses every drive that ended
    }[selection.which]


def _drives(count: int, what: str = "") -> str:
    return f"{count} {what}drive is" if count == 1 else f"{count} {what}drives are"
