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
from app.core.messages import say
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
from fusion.messages import joined
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
            findings.append(
                Finding(
                    subject, "fail", say("doctor.check_failed", reason=reason), say("doctor.check_failed_do")
                )
            )
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
    advice = ""
    if settings.access == "open" and not settings.is_local:
        finding = say("doctor.open", host=host)
        advice = say("doctor.open_do")
    elif "*" in settings.host_names:
        finding = say("doctor.any_host")
        advice = say("doctor.any_host_do")
    elif settings.access == "open":
        state = "ok"
        finding = say("doctor.local", host=host)
    else:
        shown = {"live": "the map", "off": "nothing of the map", "releases": "editions of the map"}[
            settings.shown_map
        ]
        state = "ok"
        finding = say("doctor.keys", host=host, shown=shown)
    yield Finding("access", state, finding, advice)


def _room(patient: Patient) -> Iterator[Finding]:
    settings = patient.settings
    places = {"data folder": str(settings.data_dir), "logs": settings.blob_store_url}
    places["rasters"] = str(mirror.local_folder(settings.dem_dir))
    for name, url in places.items():
        free, least = free_bytes(*file_system(url)), settings.min_free_bytes
        if free is None:
            yield Finding(say("doctor.room_of", name=name), "ok", say("doctor.bucket"))
        elif free < least:
            finding = say("doctor.no_room", mib=free / _MIB, least_mib=least / _MIB)
            yield Finding(
                say("doctor.room_of", name=name), "fail", finding, say("doctor.no_room_do", place=url)
            )
        elif free < 4 * least:
            finding = say("doctor.little_room", mib=free / _MIB, least_mib=least / _MIB)
            yield Finding(
                say("doctor.room_of", name=name), "warn", finding, say("doctor.little_room_do", place=url)
            )
        else:
            yield Finding(say("doctor.room_of", name=name), "ok", say("doctor.free", mib=free / _MIB))


def _reachable(patient: Patient) -> Iterator[Finding]:
    if patient.sessions is None:
        yield Finding("database", "fail", patient.away, say("doctor.away"))


def _database(settings: Settings, session: Session) -> Iterator[Finding]:
    server = store.versions(session)
    if server.postgis is None:
        finding = say("doctor.no_postgis", version=server.postgres)
        yield Finding("database", "fail", finding, say("doctor.no_postgis_do"))
    else:
        yield Finding("database", "ok", f"PostgreSQL {server.postgres}, PostGIS {server.postgis}")
    standing = migrate.standing(session)
    if not standing.usable:
        yield Finding("schema", "fail", standing.sentence, say("doctor.schema_do"))
        return
    state: State = "warn" if standing.newer else "ok"
    found = standing.sentence or say("doctor.schema", revision=standing.revision)
    yield Finding("schema", state, found, say("doctor.update_do") if standing.newer else "")


def _standby(settings: Settings, session: Session) -> Iterator[Finding]:
    if (url := standby_url(settings)) is None:
        return
    advice = say("doctor.standby_do")
    engine = make_engine(url, pool_size=1, pooled=settings.database_pooled, patience=_BRIEFLY)
    try:
        with session_factory(engine)() as there:
            here, now = standby.written(session), standby.replayed(there)
            schema = migrate.standing(there)
    except SQLAlchemyError as error:
        reason = " ".join(str(getattr(error, "orig", None) or error).split())
        yield Finding("standby", "fail", say("doctor.standby_silent", reason=reason), advice)
        return
    finally:
        engine.dispose()
    behind = max(here.lsn - now.lsn, 0)
    problem = standby.unfit(now, here) or (None if schema.usable else schema.sentence)
    if problem is not None:
        yield Finding("standby", "fail", problem, advice)
    elif behind > FAR_BEHIND_BYTES:
        yield Finding("standby", "warn", say("doctor.standby_far", mib=behind / _MIB), advice)
    else:
        yield Finding("standby", "ok", say("doctor.standby_near", n=behind))


def _roles(settings: Settings, session: Session) -> Iterator[Finding]:
    lacking = store.lacking_roles(session)
    if lacking is None:
        return
    if lacking:
        named = ", ".join(lacking)
        finding = say("doctor.no_roles", names=named)
        advice = say("doctor.no_roles_do")
        yield Finding("roles", "fail", finding, advice)
    else:
        yield Finding("roles", "ok", say("doctor.roles"))


def _clock(settings: Settings, session: Session) -> Iterator[Finding]:
    before, there, after = datetime.now(UTC), store.server_clock(session), datetime.now(UTC)
    skew_s = max((before - there).total_seconds(), (there - after).total_seconds(), 0.0)
    state: State = "fail" if skew_s > SKEW_FAIL_S else "warn" if skew_s > SKEW_WARN_S else "ok"
    finding = say("doctor.clocks", seconds=skew_s)
    advice = say("doctor.clocks_do")
    yield Finding("clocks", state, finding, advice if state != "ok" else "")


def _queue(settings: Settings, session: Session) -> Iterator[Finding]:
    waiting, workers = figures.queue(session), store.workers(session, settings.stalled_after_s)
    here = lanes_here(settings)
    # A lane that was killed stands in the table until others take it off: of this machine the kernel knows better, and
    # a lane here that has given no sign there for long (the machine slept) lives all the same.
    lanes = max(workers.alive, here)
    first = waiting.oldest_wait_s
    since = "" if first is None else say("doctor.first_waits", seconds=first)
    alive = say("doctor.lanes", n=lanes, here=here)
    finding = say("doctor.queue", drives=waiting.depth, since=since, lanes=alive)
    if lanes > here:
        finding = joined([finding, say("doctor.others", seconds=settings.stalled_after_s)])
    if waiting.depth and not lanes:
        yield Finding("queue", "warn", finding, say("doctor.no_worker_do"))
    elif (waiting.oldest_wait_s or 0.0) > LONG_WAIT_S:
        advice = say("doctor.long_wait_do")
        yield Finding("queue", "warn", finding, advice)
    else:
        yield Finding("queue", "ok", finding)
    if workers.stuck:
        finding = say("doctor.stuck", n=workers.stuck)
        advice = say("doctor.stuck_do")
        yield Finding("stuck jobs", "warn", finding, advice)
    if workers.queued:
        finding = say("doctor.no_job", n=workers.queued)
        advice = say("doctor.no_job_do")
        yield Finding("drives without a job", "warn", finding, advice)
    if workers.running:
        finding = say("doctor.nobody", n=workers.running)
        advice = say("doctor.nobody_do")
        yield Finding("drives nobody computes", "fail", finding, advice)


def _cells(settings: Settings, session: Session) -> Iterator[Finding]:
    cells = figures.waiting_cells(session)
    state = say("doctor.cells", n=cells.waiting)
    if cells.unsolved:
        state = joined([state, say("doctor.unsolved", n=cells.unsolved)])
        advice = say("doctor.unsolved_do")
        yield Finding("cells", "warn", state, advice)
    else:
        yield Finding("cells", "ok", state)


def _derived(settings: Settings, session: Session) -> Iterator[Finding]:
    behind = figures.behind(session)
    if behind.behind_s is None:
        yield Finding("ways and low zooms", "ok", say("doctor.derived"))
        return
    finding = say("doctor.behind", seconds=behind.behind_s, cells=behind.cells)
    if behind.behind_s > LONG_BEHIND_S:
        advice = say("doctor.behind_do")
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
        finding = say("doctor.lost", n=len(without), names=some(without))
        advice = say("doctor.lost_do")
        yield Finding("logs", "fail", finding, advice)
    else:
        yield Finding("logs", "ok", say("doctor.logs", n=len(drives)))
    if orphans := unreferenced_blobs(session, keys):
        finding = say("doctor.orphans", n=len(orphans))
        advice = say("doctor.orphans_do")
        yield Finding("logs without a drive", "warn" if len(orphans) > len(drives) else "ok", finding, advice)


def _elevation(settings: Settings, session: Session) -> Iterator[Finding]:
    active = current_dem(session, settings.dem_dir)
    if active is None:
        advice = say("doctor.no_rasters_do")
        yield Finding("elevation", "warn", say("doctor.no_rasters"), advice)
        return
    bad = [problem for s in active.sources if (problem := mirror.problem(settings.dem_dir, s.uri, s.sha256))]
    if bad:
        advice = say("doctor.bad_rasters_do")
        finding = say("doctor.bad_rasters", n=len(active.sources), names=some(bad))
        yield Finding("elevation", "fail", finding, advice)
    else:
        yield Finding("elevation", "ok", say("doctor.rasters", n=len(active.sources)))
    if pending_heights(session) is not None:
        advice = say("doctor.heights_do")
        yield Finding("heights", "warn", say("doctor.heights"), advice)


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
