"""What each kind of operation does: it says what it would do, and does it. How runs begin and end is ``run``'s."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from app.core.db import Sessions
from app.core.settings import Settings
from app.network.locks import roads_change
from app.network.settle import settle_network
from app.operations.documents import Kind, Operation
from app.operations.look import Look
from app.roads.documents import ImportCounts, Wishes
from app.roads.imports import import_roads, remove_region
from app.roads.regions import find_region
from app.roads.sentences import remarks, summary
from app.terrain.copying import request_limits
from app.terrain.coverage import effect_of_removal, rasters_over
from app.terrain.files import store_files
from app.terrain.heights import renew_all
from app.terrain.imports import add_dem, remove_dem
from app.terrain.store import chosen, current_dem

Document = dict[str, Any]

WAIT_S = 1.0
"""Between two looks at whether another import, asked for at a command line, is over."""
MORE_LOST = 1.1
"""Drives come while a plan waits: what is lost may have grown by so much without being asked for again."""
CHANGED = "The map has changed since this was approved, so nothing was done. "
_SAME = ("kept", "moved", "renumbered", "reversed", "far", "split", "merged", "dropped", "released", "added")


class PlanChangedError(Exception):
    """What would be done is not what was approved."""

    def __init__(self, plan: Document) -> None:
        super().__init__("the plan is another one")
        self.plan = plan


@dataclass(frozen=True)
class Bench:
    """What the work is done with."""

    settings: Settings
    sessions: Sessions
    operation: Operation
    look: Look
    file: Path | None
    computing: Callable[[], AbstractContextManager[None]]


@dataclass(frozen=True)
class Outcome:
    """What came of a run: a plan that waits for a person, or the result."""

    document: Document
    planned: bool = False


def work(bench: Bench) -> Outcome:
    """Do what is asked for, as far as it may be done now. Raises ``PlanChangedError``."""
    return _WORK[bench.operation.kind](bench)


def _roads(bench: Bench) -> Outcome:
    assert bench.file is not None  # noqa: S101 - none is asked for without
    file, region = bench.file, bench.operation.request.get("region")

    def bring(wishes: Wishes) -> ImportCounts:
        place, progress = bench.settings.dem_dir, bench.look.progress
        return import_roads(bench.sessions, file, place, progress, region=region, wishes=wishes)

    return _change_roads(bench, bring)


def _remove_region(bench: Bench) -> Outcome:
    name = str(bench.operation.request["name"])
    if bench.operation.begun:
        with bench.sessions() as session:
            if find_region(session, name) is None:  # a former run came to its end and could not say so
                return Outcome(_done(bench.operation.plan or {}, f"Region {name} is gone."))

    def bring(wishes: Wishes) -> ImportCounts:
        return remove_region(bench.sessions, name, bench.settings.dem_dir, bench.look.progress, wishes)

    return _change_roads(bench, bring)


def _change_roads(bench: Bench, bring: Callable[[Wishes], ImportCounts]) -> Outcome:
    """Plan, or carry out what was approved: that, and nothing else."""
    operation, tolerance_m = bench.operation, bench.settings.road_tolerance_m
    _wait_for_imports(bench)
    if not operation.approved:
        with bench.computing():
            return Outcome(_of_roads(bring(Wishes(dry_run=True, tolerance_m=tolerance_m))), planned=True)

    def agree(counts: ImportCounts) -> None:
        if not operation.begun and _is_other(counts, operation.plan or {}):
            raise PlanChangedError(_of_roads(counts, CHANGED, dry_run=True))
        bench.look.note(begun=True)

    with bench.computing():
        wishes = Wishes(accept_losses=True, tolerance_m=tolerance_m, agree=agree)
        return Outcome(_of_roads(bring(wishes)))


def _is_other(counts: ImportCounts, plan: Document) -> bool:
    said = asdict(counts)
    lost = int(plan.get("measured_lost", 0))
    return any(said[name] != plan.get(name) for name in _SAME) or counts.measured_lost > lost * MORE_LOST + 1


def _wait_for_imports(bench: Bench) -> None:
    """Without a lock that keeps this lane: uploads may want it meanwhile."""
    while True:
        with bench.sessions() as session:
            busy = roads_change(session)
        if not busy:
            return
        bench.look.progress("waiting for another import", 0.0)
        time.sleep(WAIT_S)


def _of_roads(counts: ImportCounts, before: str = "", *, dry_run: bool | None = None) -> Document:
    if dry_run is not None:
        counts = ImportCounts(**{**asdict(counts), "dry_run": dry_run})
    said = summary(counts)
    sentence = " ".join([f"{before}{said[0].upper()}{said[1:]}.", *remarks(counts)])
    figures = {k: v for k, v in asdict(counts).items() if k not in {"dry_run", "longest_hold_s"}}
    return {**figures, "segments": counts.segments, "sentence": sentence}


def _dem(bench: Bench) -> Outcome:
    assert bench.file is not None  # noqa: S101 - as above
    place, progress = bench.settings.dem_dir, bench.look.progress
    with bench.computing():
        progress("copying", 0.0)
        stored = store_files([bench.file], place, progress, request_limits(bench.settings))
        bench.look.note(begun=True)
        priority = bench.operation.request.get("priority")
        active = add_dem(bench.sessions, stored, place, progress, priority=priority)
        with bench.sessions() as session:
            lonely = sorted({source.name for source in stored} - set(rasters_over(session, active)))
    sentence = f"The terrain consists of {len(active.names)} raster(s), heights above {active.datum}."
    if lonely:
        sentence += (
            f" No road that is imported lies under {', '.join(lonely)}. Check the place, or import the roads there; "
            "until then it changes nothing."
        )
    figures = {"rasters": len(active.names), "datum": active.datum, "without_roads": lonely}
    return Outcome({**figures, "sentence": sentence})


def _remove_raster(bench: Bench) -> Outcome:
    name, place, sessions = str(bench.operation.request["name"]), bench.settings.dem_dir, bench.sessions
    with bench.computing(), sessions() as session:
        bench.look.progress("comparing", 0.0)
        active = current_dem(session, place)
        sources = active.sources if active else ()
        there = name.casefold() in {source.name.casefold() for source in sources}
        gone = chosen(sources, [name]) if there or not bench.operation.begun else []
        left = [source for source in sources if source not in gone]
        effect = asdict(effect_of_removal(session, gone, left)) if gone else {}
        version = active.version_id if active else 0
    plan = {**effect, "rasters_left": len(left), "dem_version": version, "sentence": _of_raster(name, effect)}
    if not bench.operation.approved:
        return Outcome(plan, planned=True)
    if not bench.operation.begun and version != (bench.operation.plan or {}).get("dem_version"):
        raise PlanChangedError({**plan, "sentence": CHANGED + plan["sentence"]})
    bench.look.note(begun=True)
    with bench.computing():
        if gone:
            remove_dem(sessions, [name], place, bench.look.progress)
        renew_all(sessions, place, bench.look.progress)  # what a run that was cut off left to be done
    return Outcome(_done(bench.operation.plan or {}, f"Raster {name} is out of use."))


def _of_raster(name: str, effect: Document) -> str:
    return (
        f"{effect.get('segments', 0)} segments lie under {name}, {effect.get('measured', 0)} of them measured, by "
        f"{effect.get('drives', 0)} drives. {effect.get('bare', 0)} measured ones would lie under no raster any more."
    )


def _settle(bench: Bench) -> Outcome:
    bench.look.note(begun=True)
    with bench.computing():
        segments = settle_network(
            bench.sessions,
            bench.look.progress,
            after_cell=int(bench.operation.state.get("cell", -1)),
            note_done=lambda cell: bench.look.note(cell=cell),
        )
    return Outcome(
        {"segments": segments, "sentence": f"{segments} segments of the network were solved anew."}
    )


def _done(plan: Document, sentence: str) -> Document:
    return {**plan, "sentence": sentence}


_WORK: dict[Kind, Callable[[Bench], Outcome]] = {
    Kind.IMPORT_ROADS: _roads,
    Kind.IMPORT_DEM: _dem,
    Kind.REMOVE_REGION: _remove_region,
    Kind.REMOVE_RASTER: _remove_raster,
    Kind.SETTLE: _settle,
}
