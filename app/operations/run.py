"""What each kind of operation does: it plans, and carries out what was approved. One at a time, behind uploads.

Runs begin and end as ``app.jobs.requests.run`` says. Knows no HTTP.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from app.core.blobs import IMPORTS
from app.core.db import plain_json
from app.core.filesystems import full_is_told, require_room
from app.core.messages import say
from app.core.tables import requests as tables
from app.core.telemetry.logs import tell
from app.jobs.requests.run import RequestKind, RequestRun, expected_failure
from app.network import widenings
from app.network.locks import roads_change
from app.network.settle import settle_network
from app.operations import store
from app.operations.documents import Kind, Operation
from app.operations.store import operations
from app.releases.run import add_files, in_words, is_due, release
from app.roads.documents import ImportCounts, Wishes, remarks, summary
from app.roads.imports import import_roads, remove_region
from app.roads.store import find_region
from app.terrain.coverage import effect_of_removal, rasters_over
from app.terrain.files import request_limits, store_files
from app.terrain.heights import renew_all
from app.terrain.imports import add_dem, remove_dem
from app.terrain.store import chosen, current_dem
from fusion.errors import FusionError
from fusion.messages import joined, said, with_key

Document = dict[str, Any]
Run = RequestRun[Operation]

CHUNK_BYTES = 2**20
SLICE_S = 20.0
"""An operation lets others go first at once, then after so long, twice, four times as long: it comes to its end."""
LOST = say("operation.file_gone")
NO_ROOM = say("operation.no_room")
WAIT_S = 1.0
"""Between two looks at whether another import, asked for at a command line, is over."""
MORE_LOST = 1.1
"""Drives come while a plan waits: what is lost may have grown by so much without being asked for again."""
CHANGED = say("operation.changed")
_SAME = ("kept", "moved", "renumbered", "reversed", "far", "split", "merged", "dropped", "released", "added")


logger = logging.getLogger(__name__)


class FileLostError(FusionError):
    """The file that came with an operation is not there any more."""

    kind = "file-lost"


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


def _file_of(run: Run) -> Path:
    """Where the file that came with the operation is brought to be read, under its own name."""
    return run.folder / str(run.request.request["filename"])


def _note_state(run: Run, **state: Any) -> None:
    """Keep what a later run has to know."""
    run.note(state=tables.Operation.state.concat(state))


def _roads(run: Run) -> Outcome:
    region, place = run.request.request.get("region"), run.settings.dem_dir
    return _change_roads(
        run, partial(import_roads, run.sessions, _file_of(run), place, run.show, region=region)
    )


def _remove_region(run: Run) -> Outcome:
    name = str(run.request.request["name"])
    if run.request.begun:
        with run.sessions() as session:
            if find_region(session, name) is None:  # a former run came to its end and could not say so
                return _done(run, f"Region {name} is gone.")
    return _change_roads(run, partial(remove_region, run.sessions, name, run.settings.dem_dir, run.show))


def _change_roads(run: Run, bring: Callable[..., ImportCounts]) -> Outcome:
    """Plan, or carry out what was approved: that, and nothing else. ``bring(wishes=...)`` does it."""
    operation, tolerance_m = run.request, run.settings.road_tolerance_m
    _wait_for_imports(run)
    if not operation.approved:
        with run.computing():
            wishes = Wishes(dry_run=True, tolerance_m=tolerance_m)
            return Outcome(_of_roads(bring(wishes=wishes)), planned=True)

    def agree(counts: ImportCounts) -> None:
        if not operation.begun and _is_other(counts, operation.plan or {}):
            raise PlanChangedError(_of_roads(replace(counts, dry_run=True), CHANGED))
        _note_state(run, begun=True)

    with run.computing():
        wishes = Wishes(accept_losses=True, tolerance_m=tolerance_m, agree=agree)
        return Outcome(_of_roads(bring(wishes=wishes)))


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


def _of_roads(counts: ImportCounts, before: str = "") -> Document:
    outline = say("operation.of_roads", summary=summary(counts))
    begun = with_key(outline[:1].upper() + outline[1:], said(outline))
    sentence = joined([before, begun, *remarks(counts)])
    figures = {k: v for k, v in asdict(counts).items() if k not in {"dry_run", "longest_hold_s"}}
    return {**figures, "segments": counts.segments, "sentence": sentence}


def _dem(run: Run) -> Outcome:
    place, progress = run.settings.dem_dir, run.show
    with run.computing():
        progress("copying", 0.0)
        stored = store_files([_file_of(run)], place, progress, request_limits(run.settings))
        _note_state(run, begun=True)
        said = {name: run.request.request.get(name) for name in ("priority", "source", "licence")}
        active = add_dem(run.sessions, stored, place, progress, **said)
        with run.sessions() as session:
            lonely = sorted({source.name for source in stored} - set(rasters_over(session, active)))
    sentence = say("operation.terrain", n=len(active.names), datum=active.datum)
    if lonely:
        sentence = joined([sentence, say("operation.lonely", names=lonely)])
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
        return Outcome({**plan, "sentence": joined([CHANGED, plan["sentence"]])}, planned=True)
    _note_state(run, begun=True)
    with run.computing():
        if gone:
            remove_dem(sessions, [name], place, run.show)
        renew_all(sessions, place, run.show)  # what a run that was cut off left to be done
    return _done(run, say("operation.raster_out_of_use", name=name))


def _of_raster(name: str, effect: Document) -> str:
    return say(
        "operation.raster_effect",
        segments=effect.get("segments", 0),
        name=name,
        measured=effect.get("measured", 0),
        drives=effect.get("drives", 0),
        bare=effect.get("bare", 0),
    )


def _settle(run: Run) -> Outcome:
    _note_state(run, begun=True)
    with run.computing():
        segments = settle_network(
            run.sessions,
            run.show,
            after_cell=int(run.request.state.get("cell", -1)),
            note_done=lambda cell: _note_state(run, cell=cell),
        )
    return Outcome({"segments": segments, "sentence": say("operation.settled", n=segments)})


def _widen(change: Callable[..., list[Document]], run: Run) -> Outcome:
    _note_state(run, begun=True)
    with run.computing():
        classes = change(run.sessions, run.show)
    applied = {one["name"]: one["applied"] for one in classes}
    return Outcome({"widenings": applied, "sentence": widenings.sentence(classes)})


def _release(run: Run) -> Outcome:
    """One that the service asks for by itself may be late: another edition was made meanwhile."""
    settings = run.settings
    if run.request.request.get("when_due") and not is_due(run.sessions, settings):
        with run.computing():
            add_files(str(settings.database_url), settings, run.show)  # it was made, and its maker cut off
        return Outcome({"sentence": say("operation.edition_made_already")})
    _note_state(run, begun=True)
    with run.computing():
        edition = release(str(settings.database_url), settings, progress=run.show)
    return Outcome(
        {**plain_json(asdict(edition)), "day": edition.day.isoformat(), "sentence": in_words(edition)}
    )


def _done(run: Run, sentence: str) -> Outcome:
    return Outcome({**(run.request.plan or {}), "sentence": sentence})


_WORK: dict[Kind, Callable[[Run], Outcome]] = {
    Kind.IMPORT_ROADS: _roads,
    Kind.IMPORT_DEM: _dem,
    Kind.REMOVE_REGION: _remove_region,
    Kind.REMOVE_RASTER: _remove_raster,
    Kind.SETTLE: _settle,
    Kind.LEARN_WIDENINGS: partial(_widen, widenings.learn),
    Kind.RESET_WIDENINGS: partial(_widen, widenings.reset),
    Kind.RELEASE: _release,
}


def _operate(run: Run) -> str:
    """Do, or plan, what was asked for; a word on how it ended."""
    operation = run.request
    run.show("beginning", 0.0)
    if operation.blob_key is not None:
        _fetch_file(run, operation.blob_key)
    try:
        outcome = _WORK[operation.kind](run)
    except PlanChangedError as changed:
        outcome = Outcome(changed.plan, planned=True)
    document = {**outcome.document, "sentence_said": said(outcome.document["sentence"])}
    with run.sessions.begin() as session:
        if outcome.planned:
            ours = store.plan(session, operation, document)
        else:
            ours = operations.finish(session, operation, result=plain_json(document), blob_key=None)
    if not ours:
        return "unwanted"
    if outcome.planned:
        return "planned"
    if operation.blob_key is not None:
        run.context.part(IMPORTS).delete(operation.blob_key)
    run.context.roads_changed(run.sessions)
    tell(logger, "operation done", kind=operation.kind)
    return "done"


def _fetch_file(run: Run, blob_key: str) -> None:
    """Bring the file that came with the operation to this machine."""
    size = max(int(run.request.request["size_bytes"]), 1)
    try:
        with full_is_told(), run.context.part(IMPORTS).open(blob_key, CHUNK_BYTES) as source:
            run.folder.mkdir(parents=True, exist_ok=True)
            require_room(run.folder, size, run.settings.min_free_bytes)
            with _file_of(run).open("wb") as target:
                while chunk := source.read(CHUNK_BYTES):
                    target.write(chunk)
                    run.show("fetching the file", target.tell() / size)
    except FileNotFoundError as error:
        raise FileLostError(LOST) from error


OPERATION = RequestKind(
    operations,
    _operate,
    advice=say("processing.operation_again"),
    failure=expected_failure(NO_ROOM),
    folder="operations",
    files=IMPORTS,
    undisturbed_s=lambda yields: SLICE_S * (2**yields - 1),
    expire=store.forget,
)
"""What a worker does for operations."""
