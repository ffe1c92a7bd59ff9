"""Examines a service without changing it: each finding says what is wrong and what to do about it.

Checks run one after the other; a check that fails is a finding itself and does not end the others.
"""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Literal

from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from app.core import migrate, mirror
from app.core.blobs import BlobStore
from app.core.db import Patience, Sessions, make_engine, session_factory
from app.core.filesystems import file_system, free_bytes
from app.core.settings import Settings
from app.core.standby import store as standby
from app.core.standby.use import standby_url
from app.core.version import code_version
from app.drives.queue import lanes_here
from app.drives.store import unreferenced_blobs
from app.ops import store as figures
from app.terrain.store import current_dem, pending_heights
from app.upkeep import store
from app.upkeep.manifest import some
from fusion.errors import FusionError
from fusion.types import Progress, no_progress

State = Literal["ok", "warn", "fail"]

LONG_WAIT_S = 3600.0
"""Drives that wait longer make a warning."""
LONG_BEHIND_S = 600.0
"""What is derived from segments and is farther behind makes a warning."""
FAR_BEHIND_BYTES = 64 * 2**20
"""Of the log, by which a standby is behind: makes a warning."""
SKEW_WARN_S, SKEW_FAIL_S = 2.0, 60.0
_MIB = 2**20
_BRIEFLY = Patience(5.0, 5.0, 5.0)


@dataclass(frozen=True)
class Finding:
    """What was found of one thing, and what to do about it; nothing where it is as it should be."""

    subject: str
    state: State
    found: str
    advice: str = ""


@dataclass(frozen=True)
class Patient:
    """The service that is examined. ``sessions`` None: its database cannot be reached, for the reason in ``away``."""

    settings: Settings
    sessions: Sessions | None
    away: str = ""


_Look = Callable[[Patient], Iterable[Finding]]
_DatabaseLook = Callable[[Settings, Session], Iterable[Finding]]


def examine(patient: Patient, progress: Progress = no_progress) -> list[Finding]:
    """All findings, those that others depend on first."""
    findings: list[Finding] = []
    looks = [*_LOOKS, *(_with_session(name, look) for name, look in _DATABASE_LOOKS.items())]
    for done, (subject, look) in enumerate(looks):
        progress(subject, done / len(looks))
        try:
            findings.extend(look(patient))
        except (SQLAlchemyError, FusionError, OSError) as error:
            reason = " ".join(str(getattr(error, "orig", None) or error).split())
            findings.append(Finding(subject, "fail", f"The check failed: {reason}", "Fix that first."))
    return findings


def _with_session(subject: str, look: _DatabaseLook) -> tuple[str, _Look]:
    def looks(patient: Patient) -> Iterable[Finding]:
        if patient.sessions is None:
            return []
        with patient.sessions() as session:
            return list(look(patient.settings, session))

    return subject, looks


def _programs(patient: Patient) -> Iterator[Finding]:
    import pyproj  # noqa: PLC0415 - as rasterio, of no use to other commands
    import rasterio  # noqa: PLC0415

    here = f"Versant {code_version()}, Python {platform.python_version()}"
    libraries = f"GDAL {rasterio.__gdal_version__}, PROJ {pyproj.proj_version_str}"
    yield Finding("programs", "ok", f"{here}, {libraries}")


def _access(patient: Patient) -> Iterator[Finding]:
    settings, host = patient.settings, patient.settings.host
    state: State = "warn"
    if settings.access == "open" and not settings.is_local:
        finding = f"The API listens on {host}, others reach it, and it asks for no keys: they may remove every drive."
        advice = "Leave VERSANT_ACCESS at keys, or see that something in front of it asks who comes."
    elif "*" in settings.host_names:
        finding = "The API answers under any host name (VERSANT_ALLOWED_HOSTS is *)."
        advice = "Name those that people use, unless something in front of it checks them."
    elif settings.access == "open":
        state, advice = "ok", ""
        finding = f"The API listens on {host}, for this machine alone, and asks for no keys."
    else:
        shown = {"live": "the map", "off": "nothing of the map", "releases": "editions of the map"}[
            settings.shown_map
        ]
        state, advice = "ok", ""
        finding = f"The API listens on {host} and asks for keys; who shows none sees {shown}."
    yield Finding("access", state, finding, advice)


def _room(patient: Patient) -> Iterator[Finding]:
    settings = patient.settings
    places = {"data folder": str(settings.data_dir), "logs": settings.blob_store_url}
    places["rasters"] = str(mirror.local_folder(settings.dem_dir))
    for name, url in places.items():
        free, least = free_bytes(*file_system(url)), settings.min_free_bytes
        if free is None:
            yield Finding(f"room of {name}", "ok", "Nothing tells how much room a bucket has.")
        elif free < least:
            finding = (
                f"{free / _MIB:.0f} MiB are free, less than the {least / _MIB:.0f} of VERSANT_MIN_FREE_BYTES."
            )
            yield Finding(f"room of {name}", "fail", finding, f"Make room in {url}: uploads are refused.")
        elif free < 4 * least:
            finding = f"{free / _MIB:.0f} MiB are free; at {least / _MIB:.0f} uploads are refused."
            yield Finding(f"room of {name}", "warn", finding, f"Make room in {url}.")
        else:
            yield Finding(f"room of {name}", "ok", f"{free / _MIB:.0f} MiB are free.")


def _reachable(patient: Patient) -> Iterator[Finding]:
    if patient.sessions is None:
        yield Finding("database", "fail", patient.away, "Nothing else of it can be checked.")


def _database(settings: Settings, session: Session) -> Iterator[Finding]:
    server = store.versions(session)
    if server.postgis is None:
        finding = f"PostgreSQL {server.postgres} without PostGIS."
        yield Finding("database", "fail", finding, "Install PostGIS there.")
    else:
        yield Finding("database", "ok", f"PostgreSQL {server.postgres}, PostGIS {server.postgis}")
    standing = migrate.standing(session)
    if not standing.usable:
        yield Finding("schema", "fail", standing.sentence, "Until then neither API nor workers run.")
        return
    finding = standing.sentence or f"The database is at migration {standing.revision}, as this program."
    state: State = "warn" if standing.newer else "ok"
    yield Finding("schema", state, finding, "Update the program." * standing.newer)


def _standby(settings: Settings, session: Session) -> Iterator[Finding]:
    if (url := standby_url(settings)) is None:
        return
    advice = (
        "The API reads the map from the primary meanwhile. See to the standby (VERSANT_DATABASE_READ_URL)."
    )
    engine = make_engine(url, pool_size=1, pooled=settings.database_pooled, patience=_BRIEFLY)
    try:
        with session_factory(engine)() as there:
            here, now = standby.written(session), standby.replayed(there)
            schema = migrate.standing(there)
    except SQLAlchemyError as error:
        reason = " ".join(str(getattr(error, "orig", None) or error).split())
        yield Finding("standby", "fail", f"It does not answer: {reason}", advice)
        return
    finally:
        engine.dispose()
    behind = max(here.lsn - now.lsn, 0)
    problem = standby.unfit(now, here) or (None if schema.usable else schema.sentence)
    if problem is not None:
        yield Finding("standby", "fail", problem, advice)
    elif behind > FAR_BEHIND_BYTES:
        yield Finding("standby", "warn", f"It is {behind / _MIB:.0f} MiB of log behind.", advice)
    else:
        yield Finding("standby", "ok", f"It is {behind} bytes of log behind.")


def _roles(settings: Settings, session: Session) -> Iterator[Finding]:
    lacking = store.lacking_roles(session)
    if lacking is None:
        return
    if lacking:
        named = ", ".join(lacking)
        finding = f"The database does not tell callers apart, or cannot act as they do: see to {named}."
        advice = "`versant migrate` makes roles and gives rights, as a user who may. Tables need row level security."
        yield Finding("roles", "fail", finding, advice)
    else:
        yield Finding("roles", "ok", "The database shows every caller its own rows.")


def _clock(settings: Settings, session: Session) -> Iterator[Finding]:
    before, there, after = datetime.now(UTC), store.server_clock(session), datetime.now(UTC)
    skew_s = max((before - there).total_seconds(), (there - after).total_seconds(), 0.0)
    state: State = "fail" if skew_s > SKEW_FAIL_S else "warn" if skew_s > SKEW_WARN_S else "ok"
    finding = f"The database's clock and this one are {skew_s:.1f} s apart."
    advice = "Let both follow a time server: signs of life and ages are told by the clocks."
    yield Finding("clocks", state, finding, advice * (state != "ok"))


def _queue(settings: Settings, session: Session) -> Iterator[Finding]:
    waiting, workers = figures.queue(session), store.workers(session, settings.stalled_after_s)
    here = lanes_here(settings)
    # A lane that was killed stands in the table until others take it off: of this machine the kernel knows better, and
    # a lane here that has given no sign there for long (the machine slept) lives all the same.
    lanes = max(workers.alive, here)
    finding = f"{waiting.depth} drives wait"
    if waiting.oldest_wait_s is not None:
        finding += f", the first for {waiting.oldest_wait_s:.0f} s"
    finding += (
        f"; {lanes} {'lane' if lanes == 1 else 'lanes'} of workers alive, {here} of them on this machine."
    )
    if lanes > here:
        finding += f" The others gave a sign of life in the last {settings.stalled_after_s:.0f} s."
    if waiting.depth and not lanes:
        yield Finding("queue", "warn", finding, "Start `versant worker` or `versant up`.")
    elif (waiting.oldest_wait_s or 0.0) > LONG_WAIT_S:
        advice = "Start more workers, or wait: uploads go before what is processed again."
        yield Finding("queue", "warn", finding, advice)
    else:
        yield Finding("queue", "ok", finding)
    if workers.stuck:
        finding = f"{workers.stuck} jobs are held by workers that are silent."
        advice = "A worker that lives puts them back by itself; start one."
        yield Finding("stuck jobs", "warn", finding, advice)
    if workers.queued:
        finding = f"{workers.queued} drives wait and have no job, as after an update."
        advice = "A worker gives them one within minutes; start one."
        yield Finding("drives without a job", "warn", finding, advice)
    if workers.running:
        finding = f"{workers.running} drives run and have no job: nobody computes them."
        advice = "`versant drives reprocess --drive ID` for each (`versant drives list --status running`)."
        yield Finding("drives nobody computes", "fail", finding, advice)


def _cells(settings: Settings, session: Session) -> Iterator[Finding]:
    cells = figures.waiting_cells(session)
    state = f"{cells.waiting} cells wait to be solved."
    if cells.unsolved:
        state += f" {cells.unsolved} of them repeatedly failed to be solved."
        advice = "/v1/admin/stats names them and what to do (`unsolved`); the worker's log says why."
        yield Finding("cells", "warn", state, advice)
    else:
        yield Finding("cells", "ok", state)


def _derived(settings: Settings, session: Session) -> Iterator[Finding]:
    behind = figures.behind(session)
    if behind.behind_s is None:
        yield Finding("ways and low zooms", "ok", "They show what the segments do.")
        return
    finding = f"They are {behind.behind_s:.0f} s behind the segments; {behind.cells} cells wait to be drawn."
    if behind.behind_s > LONG_BEHIND_S:
        advice = (
            "A worker sees to it beside its drives; start one. Where one runs, its log says what is in its way, or a "
            "transaction has been open for so long (pg_stat_activity)."
        )
        yield Finding("ways and low zooms", "warn", finding, advice)
    else:
        yield Finding("ways and low zooms", "ok", finding)


def _logs(settings: Settings, session: Session) -> Iterator[Finding]:
    blobs = BlobStore(settings.blob_store_url)
    # The store after the database: what is uploaded meanwhile has its log, whatever is listed.
    drives, keys = store.drive_blobs(session), blobs.keys()
    there = set(keys)
    without = sorted(drive for drive, key in drives.items() if key not in there)
    if without:
        finding = f"{len(without)} drives have lost their logs: {some(without)}."
        advice = "Bring them back from a backup, or upload them again; what these drives finding stays."
        yield Finding("logs", "fail", finding, advice)
    else:
        yield Finding("logs", "ok", f"{len(drives)} drives have their logs.")
    if orphans := unreferenced_blobs(session, keys):
        finding = f"{len(orphans)} logs are of no drive."
        advice = "Workers remove them after VERSANT_ORPHAN_DAYS; `versant sweep` says whether they may."
        yield Finding("logs without a drive", "warn" if len(orphans) > len(drives) else "ok", finding, advice)


def _elevation(settings: Settings, session: Session) -> Iterator[Finding]:
    active = current_dem(session, settings.dem_dir)
    if active is None:
        advice = "`versant import-dem FILE...` adds some: slopes of roads that few drove gain by it."
        yield Finding("elevation", "warn", "There are no elevation rasters.", advice)
        return
    bad = [problem for s in active.sources if (problem := mirror.problem(settings.dem_dir, s.uri, s.sha256))]
    if bad:
        advice = "Import them again (`versant import-dem`), or remove them (`versant elevation remove`)."
        finding = f"Of {len(active.sources)} rasters some are not sound: {some(bad)}."
        yield Finding("elevation", "fail", finding, advice)
    else:
        count = len(active.sources)
        there = "1 raster is there as it was" if count == 1 else f"{count} rasters are there as they were"
        yield Finding("elevation", "ok", f"{there} imported.")
    if pending_heights(session) is not None:
        advice = "A worker goes on with it; start one."
        yield Finding("heights", "warn", "Heights of segments are still of the rasters before.", advice)


_LOOKS: tuple[tuple[str, _Look], ...] = (
    ("programs", _programs),
    ("access", _access),
    ("room", _room),
    ("database", _reachable),
)
_DATABASE_LOOKS: dict[str, _DatabaseLook] = {
    "database": _database,
    "standby": _standby,
    "roles": _roles,
    "clocks": _clock,
    "queue": _queue,
    "cells": _cells,
    "ways and low zooms": _derived,
    "logs": _logs,
    "elevation": _elevation,
}
