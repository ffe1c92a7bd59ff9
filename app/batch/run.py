"""A batch from its logs to its slopes: listing, locating, fusing by groups, one network, files."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
import pyarrow as pa

from app.batch.archive import write_inputs
from app.batch.folder import BatchFolder, key_of, remove_but, write_table, written
from app.batch.fusing import Choices, Group
from app.batch.hands import Hands, Job
from app.batch.listing import Log, list_logs
from app.batch.locating import Located, chunks, groups
from app.batch.outputs import SolvedSource, remove_outputs, write_outputs
from app.batch.roads import PlacedRoads, key_of_roads
from app.batch.solving import StoredDrive, StoredEvidence
from app.batch.stored import alone_of, facts_of, read_drives
from app.core.messages import say
from app.core.mirror import sha256_of
from app.core.version import code_version
from app.map.segment import attribution
from fusion.methods.base import OF_TERRAIN
from fusion.network.control import read_control
from fusion.report import with_agreement
from fusion.results import Solution, solution_of
from fusion.roads.table import RoadTable
from fusion.together import network_datum, solve_evidence
from fusion.types import Ints, Progress


class Shown(Protocol):
    """Where it is seen how far the work is."""

    def work(self, name: str) -> Progress:
        """One piece of work, from 0 to 1."""
        ...

    def count(self, name: str, total: int) -> Callable[[int], None]:
        """Many pieces; call it with how many more are done."""
        ...


@dataclass(frozen=True)
class Request:
    """What is asked for; ``method`` and ``options`` are checked, ``formats`` of ``outputs.formats_of_segments``."""

    logs: tuple[str, ...]
    roads: Path
    rasters: tuple[Path, ...]
    method: str
    options: dict[str, Any]
    control: Path | None
    gaps: bool
    formats: tuple[str, ...]
    sports: tuple[str, ...] | None = None
    """Logs that tell of another are left out; None: none is."""


@dataclass(frozen=True)
class Done:
    """What came of it; ``solution`` is None where no log can be used. ``notes`` are on the files, for a person."""

    outcomes: Sequence[Outcome]
    solution: Solution | None
    files: list[Path]
    notes: list[str]


def run(request: Request, folder: BatchFolder, hands: Hands, shown: Shown) -> Done:
    """All of it, as far as it is not done yet.

    Raises ``BatchError`` where it cannot go on, ``RoadsError``, ``TerrainError`` and ``ControlError`` for these files,
    ``OSError`` where the folder cannot be written. A log that cannot be used is an outcome.
    """
    listing = shown.count("listing", 1)
    logs = list_logs(request.logs)
    listing(1)
    choices = _choices(request, folder, shown)
    looks = chunks(folder, logs, request.options.get("columns", {}), code_version(), request.sports)
    _do(looks, hands, shown.count("locating", len(logs)))
    located = [log for one in looks for log in one.found()]
    used, repeated = _each_once(located)
    every = [Group.of(folder, [(one.log, one.sha256) for one in run], choices) for run in groups(used)]
    _do(every, hands, shown.count("fusing", sum(len(one.logs) for one in every)))
    drives = Drives.of(every, choices)
    if not drives.rows:
        outcomes = outcomes_of(located, repeated, [], drives.failed, None)
        write_report(folder, outcomes)
        remove_outputs(folder, set())
        return Done(outcomes, None, [], [])
    solution = drives.solved(hands, folder, request, shown)
    outcomes = outcomes_of(located, repeated, drives.rows, drives.failed, solution)
    source = SolvedSource(solution, drives.newest(), [request.roads], choices.terrain)
    writing = shown.count("files", 1)
    files = write_outputs(hands, folder, request.formats, source, attribution(drives.rasters(solution)))
    write_report(folder, outcomes)
    _write_manifest(request, folder, choices, located, every, solution)
    _tidy(folder, {*(one.key for one in looks), *(one.key for one in every)}, choices)
    writing(1)
    return Done(outcomes, solution, files, source.notes)


def _choices(request: Request, folder: BatchFolder, shown: Shown) -> Choices:
    roads = PlacedRoads.cut(
        request.roads, folder.roads(key_of_roads(request.roads)), shown.work(request.roads.name)
    )
    rasters = tuple(
        (str(path.absolute()), path.stat().st_size, path.stat().st_mtime_ns) for path in request.rasters
    )
    choices = Choices(code_version(), request.method, request.options, roads, rasters)
    choices.terrain()  # what is wrong with the rasters is said before any log is read
    return choices


def _each_once(located: Sequence[Located]) -> tuple[list[Located], dict[Log, str]]:
    """Logs that can be used, the first of the same bytes; and the others with its name."""
    first: dict[str, str] = {}
    used, repeated = [], {}
    for one in located:
        if one.sha256:
            earlier = first.setdefault(one.sha256, one.log.name)
            if earlier != one.log.name:
                repeated[one.log] = earlier
                continue
        if not one.reason:
            used.append(one)
    return used, repeated


def _do(jobs: Sequence[Job], hands: Hands, bar: Callable[[int], None]) -> None:
    """Those whose results are not there yet."""
    todo = []
    for one in jobs:
        if one.is_done:
            bar(len(one.logs))
        else:
            todo.append(one)
    for job in hands.done(todo):
        bar(len(job.logs))


@dataclass(frozen=True, eq=False)
class Drives:
    """All drives, in the order of the names of their logs: where each is kept, and what is known of it (``rows``)."""

    groups: Sequence[Group]
    where: list[StoredDrive]
    rows: list[dict[str, Any]]
    failed: dict[str, str]
    """Names of logs that are none, and why not"""
    choices: Choices

    @classmethod
    def of(cls, groups: Sequence[Group], choices: Choices) -> Drives:
        """Of groups that are done."""
        found, failed = [], {}
        for number, group in enumerate(groups):
            for place, row in enumerate(read_drives(group.folder.drives(group.key))):
                if row["reason"] is None:
                    found.append((row, StoredDrive(number, place, row["lag_s"])))
                else:
                    failed[row["log"]] = row["reason"]
        found.sort(key=lambda one: one[0]["log"])
        return cls(groups, [where for _, where in found], [row for row, _ in found], failed, choices)

    def roads(self) -> tuple[RoadTable, Ints]:
        """The roads around the drives, and their rows in the file of roads."""
        near = np.unique(np.concatenate([row["near"] for row in self.rows]))
        places = np.unique(np.concatenate([row["place"] for row in self.rows]))
        table, rows = self.choices.roads.of_places(places.tolist())
        return table.subset(np.isin(rows, near)), near

    def solved(self, hands: Hands, folder: BatchFolder, request: Request, shown: Shown) -> Solution:
        """What they say together, as ``fusion.results.solve_fused`` has it."""
        control = read_control(request.control) if request.control else []
        dem = self.choices.terrain()
        roads, near = self.roads()
        key = key_of([one.key for one in self.groups], [vars(point) for point in control])
        evidence = StoredEvidence(
            hands, folder, self.groups, self.where, near, self.choices, key, shown.count
        )
        facts = [facts_of(row, near) for row in self.rows]
        network = solve_evidence(roads, dem, facts, evidence, control)
        of_terrain = self.choices.method in OF_TERRAIN
        alone: Iterator[Any] = (alone_of(row, near, of_terrain) for row in self.rows)
        reports = [json.loads(row["report"]) for row in self.rows if row["in_network"]]
        datum = network_datum(dem, reports, control)
        return solution_of(roads, dem, network, alone, datum, gaps=request.gaps)

    def rasters(self, solution: Solution) -> tuple[str, ...]:
        """Names of the elevation rasters that give the heights of the segments of a solution."""
        from fusion.network.unknowns import knot_positions  # noqa: PLC0415

        dem = self.choices.terrain()
        return () if dem is None else dem.sources_at(*knot_positions(solution.roads))

    def newest(self) -> datetime:
        """When the last of the drives ended: what is published is as new as that, whenever it is computed."""
        return datetime.fromtimestamp(max(row["end_s"] for row in self.rows), UTC)


def _write_manifest(
    request: Request,
    folder: BatchFolder,
    choices: Choices,
    located: Sequence[Located],
    groups_done: Sequence[Group],
    solution: Solution,
) -> None:
    logs = [[one.log.name, one.log.size, one.sha256] for one in located]
    write_inputs(folder, located, [(one.key, one.logs) for one in groups_done])
    document = {
        "choices": choices.document(),
        "logs": len(logs),
        "logs_sha256": key_of(logs),
        "control_sha256": None if request.control is None else sha256_of(request.control),
        "gaps": request.gaps,
        "formats": list(request.formats),
        "segments": len(solution),
    }
    with written(folder.manifest) as partial:
        partial.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


def _tidy(folder: BatchFolder, keys: set[str], choices: Choices) -> None:
    """Remove what former logs and options left."""
    shutil.rmtree(folder.scratch, ignore_errors=True)
    for name in ("located", "drives", "tracks", "passes"):
        below = folder.path / name
        remove_but(below, {path for path in below.rglob("*.parquet") if path.stem in keys})
    roads = choices.roads.folder
    remove_but(roads.parent, {path for path in roads.iterdir() if not path.name.startswith(".")})


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
