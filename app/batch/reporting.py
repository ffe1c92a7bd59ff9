"""What became of each log: done, the same bytes as another, or the sentence why not."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import pyarrow as pa

from app.batch.folder import BatchFolder, write_table
from app.batch.listing import Log
from app.batch.locating import Located
from app.core.messages import say
from fusion.report import with_agreement
from fusion.results import Solution


class Outcome(NamedTuple):
    """Of one log. ``status``: done, repeated or failed, and why not done. ``report``: JSON, as ``versant fuse`` has it.

    ``segments`` are those with a slope of its own; on ``rejected_segments`` it contradicts the others.
    """

    log: str
    status: str
    reason: str | None
    segments: int
    rejected_segments: int
    duplicate_of: str | None
    warnings: list[str]
    report: str | None


SCHEMA = pa.schema(
    {
        "log": pa.string(),
        "status": pa.string(),
        "reason": pa.string(),
        "segments": pa.int64(),
        "rejected_segments": pa.int64(),
        "duplicate_of": pa.string(),
        "warnings": pa.list_(pa.string()),
        "report": pa.string(),
    }
)


def outcomes_of(
    located: Sequence[Located],
    repeated: Mapping[Log, str],
    drives: Sequence[Mapping[str, Any]],
    failed: Mapping[str, str],
    solution: Solution | None,
) -> list[Outcome]:
    """Of every log; ``drives`` are those of the solution (None: none), ``failed`` others."""
    number = {row["log"]: k for k, row in enumerate(drives)}
    out = []
    for one in located:
        name = one.log.name
        if one.log in repeated:
            out.append(_not_done(name, "repeated", say("fuse.same", earlier=repeated[one.log])))
        elif solution is not None and (k := number.get(name)) is not None:
            original = solution.duplicates.get(k)
            same = None if original is None else drives[original]["log"]
            text, rejected = drives[k]["report"], solution.rejected[k]
            warnings = with_agreement(json.loads(text), rejected, same)
            out.append(Outcome(name, "done", None, drives[k]["segments"], rejected, same, warnings, text))
        else:
            out.append(_not_done(name, "failed", failed.get(name, one.reason)))
    return out


def write_report(folder: BatchFolder, outcomes: Sequence[Outcome]) -> None:
    """A row a log."""
    columns = {name: [getattr(one, name) for one in outcomes] for name in SCHEMA.names}
    write_table(folder.report, pa.table(columns, schema=SCHEMA))


def _not_done(name: str, status: str, reason: str) -> Outcome:
    return Outcome(name, status, reason, 0, 0, None, [], None)
