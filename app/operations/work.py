"""What each kind of operation does: it plans, and carries out what was approved. ``run`` begins and ends its runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from app.core.tables import requests as tables
from app.jobs.requests.run import RequestRun
from app.network.locks import roads_change
from app.network.settle import settle_network
from app.operations.documents import Kind, Operation
from app.roads.documents import ImportCounts, Wishes, remarks, summary
from app.roads.imports import import_roads, remove_region
from app.roads.store import find_region
from app.terrain.coverage import effect_of_removal, rasters_over
from app.terrain.files import request_limits, store_files
from app.terrain.heights import renew_all
from app.terrain.imports import add_dem, remove_dem
from app.terrain.store import chosen, current_dem

Document = dict[str, Any]
Run = RequestRun[Operation]

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
class Outcome:
    """What came of a run: a plan that waits for a person, or the result."""

    document: Document
    planned: bool = False


def file_of(run: Run) -> Path:
    """Where the file that came with the operation is brought to be read, under its own name."""
    return run.folder / str(run.request.request["filename"])


def note_state(run: Run, **state: Any) -> None:
    """Keep what a later run has to know."""
    run.note(state=tables.Operation.state.concat(state))


def work(run: Run) -> Outcome:
    """Do what is asked for, as far as it may be done now. Raises ``PlanChangedError``."""
    return _WORK[run.request.kind](run)


def _roads(run: Run) -> Outcome:
    file, region = file_of(run), run.request.request.get("region")

    def bring(wishes: Wishes) -> ImportCounts:
        place, progress = run.settings.dem_dir, run.show
        return import_roads(run.sessions, file, place, progress, region=region, wishes=wishes)

    return _change_roads(run, bring)


def _remove_region(run: Run) -> Outcome:
    name = str(run.request.request["name"])
    if run.request.begun:
        with run.sessions() as session:
            if find_region(session, name) is None:  # a former run came to its end and could not say so
                return Outcome(_done(run.request.plan or {}, f"Region {name} is gone."))

    def bring(wishes: Wishes) -> ImportCounts:
        return remove_region(run.sessions, name, run.settings.dem_dir, run.show, wishes)

    return _change_roads(run, bring)


def _change_roads(run: Run, bring: Callable[[Wishes], ImportCounts]) -> Outcome:
    """Plan, or carry out what was approved: that, and nothing else."""
    operation, tolerance_m = run.request, run.settings.road_tolerance_m
    _wait_for_imports(run)
    if not operation.approved:
        with run.computing():
            return Outcome(_of_roads(bring(Wishes(dry_run=True, tolerance_m=tolerance_m))), planned=True)

    def agree(counts: ImportCounts) -> None:
        if not operation.begun and _is_other(counts, operation.plan or {}):
            raise PlanChangedError(_of_roads(counts, CHANGED, dry_run=True))
        note_state(run, begun=True)

    with run.computing():
        wishes = Wishes(accept_losses=True, tolerance_m=tolerance_m, agree=agree)
        return Outcome(_of_roads(bring(wishes)))


def _is_other(counts: ImportCounts, plan: Document) -> bool:
    figures = asdict(counts)
    lost = int(plan.get("measured_lost", 0))
    return (
        any(figures[name] != plan.get(name) for name in _SAME) or counts.measured_lost > lost * MORE_LOST + 1
    )


def _wait_for_imports(run: Run) -> None:
    """Without waiting for a lock, which would keep this lane from uploads."""
    while True:
        with run.sessions() as session:
            busy = roads_change(session)
        if not busy:
            return
        run.show("waiting for another import", 0.0)
        time.sleep(WAIT_S)


def _of_roads(counts: ImportCounts, before: str = "", *, dry_run: bool | None = None) -> Document:
    if dry_run is not None:
        counts = ImportCounts(**{**asdict(counts), "dry_run": dry_run})
    outline = summary(counts)
    sentence = " ".join([f"{before}{outline[0].upper()}{outline[1:]}.", *remarks(counts)])
    figures = {k: v for k, v in asdict(counts).items() if k not in {"dry_run", "longest_hold_s"}}
    return {**figures, "segments": counts.segments, "sentence": sentence}


def _dem(run: Run) -> Outcome:
    place, progress = run.settings.dem_dir, run.show
    with run.computing():
        progress("copying", 0.0)
        stored = store_files([file_of(run)], place, progress, request_limits(run.settings))
        note_state(run, begun=True)
        priority = run.request.request.get("priority")
        active = add_dem(run.sessions, stored, place, progress, priority=priority)
        with run.sessions() as session:
            lonely = sorted({source.name for source in stored} - set(rasters_over(session, active)))
    sentence = f"The terrain consists of {len(active.names)} raster(s), heights above {active.datum}."
    if lonely:
        sentence += (
            f" No road that is imported lies under {', '.join(lonely)}. Check the place, or import the roads there; "
            "until then it changes nothing."
        )
    figures = {"rasters": len(active.names), "datum": active.datum, "without_roads": lonely}
    return Outcome({**figures, "sentence": sentence})


def _remove_raster(run: Run) -> Outcome:
    name, place, sessions = str(run.request.request["name"]), run.settings.dem_dir, run.sessions
    with run.computing(), sessions() as session:
        run.show("comparing", 0.0)
        active = current_dem(session, place)
        sources = active.sources if active else ()
        there = name.casefold() in {source.name.casefold() for source in sources}
        gone = chosen(sources, [name]) if there or not run.request.begun else []
        left = [source for source in sources if source not in gone]
        effect = asdict(effect_of_removal(session, gone, left)) if gone else {}
        version = active.version_id if active else 0
    plan = {**effect, "rasters_left": len(left), "dem_version": version, "sentence": _of_raster(name, effect)}
    if not run.request.approved:
        return Outcome(plan, planned=True)
    if not run.request.begun and version != (run.request.plan or {}).get("dem_version"):
        raise PlanChangedError({**plan, "sentence": CHANGED + plan["sentence"]})
    note_state(run, begun=True)
    with run.computing():
        if gone:
            remove_dem(sessions, [name], place, run.show)
        renew_all(sessions, place, run.show)  # what a run that was cut off left to be done
    return Outcome(_done(run.request.plan or {}, f"Raster {name} is out of use."))


def _of_raster(name: str, effect: Document) -> str:
    return (
        f"{effect.get('segments', 0)} segments lie under {name}, {effect.get('measured', 0)} of them measured, by "
        f"{effect.get('drives', 0)} drives. {effect.get('bare', 0)} measured ones would lie under no raster any more."
    )


def _settle(run: Run) -> Outcome:
    note_state(run, begun=True)
    with run.computing():
        segments = settle_network(
            run.sessions,
            run.show,
            after_cell=int(run.request.state.get("cell", -1)),
            note_done=lambda cell: note_state(run, cell=cell),
        )
    return Outcome(
        {"segments": segments, "sentence": f"{segments} segments of the network were solved anew."}
    )


def _done(plan: Document, sentence: str) -> Document:
    return {**plan, "sentence": sentence}


_WORK: dict[Kind, Callable[[Run], Outcome]] = {
    Kind.IMPORT_ROADS: _roads,
    Kind.IMPORT_DEM: _dem,
    Kind.REMOVE_REGION: _remove_region,
    Kind.REMOVE_RASTER: _remove_raster,
    Kind.SETTLE: _settle,
}
