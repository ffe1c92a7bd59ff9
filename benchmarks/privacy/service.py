"""A service of its own for the attack: databases with the town's roads, drives as workers store them, and HTTP."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import httpx
import psycopg
from psycopg import sql
from sqlalchemy import make_url

from accuracy.arguments import REPOSITORY
from app.access.store import create_owner
from app.core import databases, migrate
from app.core.blobs import BlobStore
from app.core.caller import Caller, as_caller, guard
from app.core.db import Sessions, make_engine, session_factory
from app.core.settings import Settings
from app.core.settings.places import libpq_url
from app.core.version import code_version
from app.drives import claims, intake, publishing, tracks
from app.drives import store as drives
from app.network import extracts
from app.network import results as slopes
from app.network.marks import MarkedBy
from app.network.swap import solve_all_marked
from app.releases.run import release
from app.roads import store as road_store
from app.roads.imports import import_roads
from fusion.roads.table import RoadTable
from fusion.types import Ints
from privacy.recording import Recorded
from privacy.town import MONDAY_S, WEEK_S
from service.databases import begun_drive, sessions_of
from service.processes import Service as Process

ROADS = "privacy_roads"


@dataclass(frozen=True, eq=False)
class Service:
    """One database with people in it."""

    settings: Settings
    sessions: Sessions
    owned: Sessions
    """Its transactions are those of the present caller."""
    ids: Ints
    """The service's number of each row of the roads."""

    def add_owner(self, name: str) -> int:
        """A new owner's number."""
        with self.sessions.begin() as session:
            return create_owner(session, name).id

    def store(self, owner: int, recorded: Recorded) -> uuid.UUID:
        """Store a drive of an owner as a worker does at its end, without solving."""
        with as_caller(Caller("own", owner)), self.owned.begin() as session:
            drive = begun_drive(session)
        with self.sessions.begin() as session:
            slopes.begin_change(session, drive.id, slopes.in_database(recorded.factors, self.ids))
            version = road_store.current_road_version(session)
            if version is None or not claims.lock_running(session, drive.id, drive.generation):
                raise RuntimeError("the drive is not the worker's")
            tracks.save_track(session, drive.id, tracks.EncodedTrack.of(recorded.track, self.ids))
            provenance = slopes.RunProvenance("profile", {}, code_version(), version.id, None)
            marked = MarkedBy(drive.id, drive.generation)
            times = recorded.track.time_s
            slopes.append_result(session, marked, self.ids, [], provenance, recorded.factors, times)
            claims.mark_publishing(
                session, drive.id, report={}, bounds=_bounds(recorded), epochs=len(times), distance_m=None,
                drive_time=None,
            )  # fmt: skip
        return drive.id

    def solve(self) -> None:
        """Publish all that was stored: drives are done."""
        solve_all_marked(self.sessions)
        publishing.finish(self.sessions, BlobStore(self.settings.blob_store_url))

    def remove(self, owner: int) -> None:
        """Take back all drives of an owner, on the owner's request."""
        with as_caller(Caller("own", owner)), self.owned() as session:
            mine = drives.list_drives(session, limit=1000)
        for drive in mine:
            intake.remove_drive(self.sessions, drive.id)

    def release(self, week: int, **settings: object) -> None:
        """Make the edition at the end of a week."""
        day = datetime.fromtimestamp(MONDAY_S + (week + 1) * WEEK_S, UTC).date()
        released = self.settings.model_copy(update={"public_map": "releases", **settings})
        release(str(self.settings.database_url), released, day=day)

    @contextmanager
    def public(self, **settings: object) -> Iterator[httpx.Client]:
        """The service over HTTP, as a process of its own, as somebody without a key reaches it."""
        url = libpq_url(str(self.settings.database_url))
        process = Process(REPOSITORY, url, self.settings.data_dir, threads=1)
        asked = {f"VERSANT_{name.upper()}": str(value) for name, value in settings.items()}
        process.environment = {**process.environment, "VERSANT_ACCESS": "keys", **asked}
        with process.started("api", "--port", str(process.port)):
            process.await_ready()
            with httpx.Client(base_url=process.address, timeout=120, trust_env=False) as client:
                yield client


def _bounds(recorded: Recorded) -> tuple[float, float, float, float]:
    lon, lat = recorded.track.lon_deg, recorded.track.lat_deg
    return float(lon.min()), float(lat.min()), float(lon.max()), float(lat.max())


@dataclass(frozen=True)
class Server:
    """A server of databases that begin with the same roads and nothing else."""

    url: str
    folder: Path

    def import_roads(self, roads: Path) -> None:
        """Make the database that the others begin as."""
        databases.ensure_database(self.url, ROADS)
        migrate.upgrade(self._url_of(ROADS), finish=True)
        with sessions_of(self._url_of(ROADS)) as sessions:
            import_roads(sessions, roads, self._settings(ROADS).dem_dir)

    def roads(self) -> tuple[RoadTable, Ints]:
        """All roads, and the service's number of each."""
        with sessions_of(self._url_of(ROADS)) as sessions, sessions() as session:
            return extracts.all_roads(session)

    @contextmanager
    def service(self, name: str, ids: Ints) -> Iterator[Service]:
        """A service that nobody has driven for yet."""
        with psycopg.connect(libpq_url(self.url), autocommit=True) as connection:
            make = sql.SQL("CREATE DATABASE {} TEMPLATE {}")
            connection.execute(make.format(sql.Identifier(name), sql.Identifier(ROADS)))
        settings = self._settings(name)
        engine, own = make_engine(self._url_of(name)), guard(make_engine(self._url_of(name)))
        try:
            yield Service(settings, session_factory(engine), session_factory(own), ids)
        finally:
            engine.dispose()
            own.dispose()

    def _url_of(self, name: str) -> str:
        return make_url(self.url).set(database=name).render_as_string(hide_password=False)

    def _settings(self, name: str) -> Settings:
        return Settings(
            database_url=self._url_of(name), data_dir=self.folder / name, access="keys", public_map="live"
        )
