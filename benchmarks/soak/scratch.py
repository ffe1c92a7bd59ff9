"""The same drives and roads in a database of their own, computed one after the other and undisturbed."""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path

from app.core.blobs import BlobStore
from app.core.db import Sessions
from app.core.settings import Settings
from app.core.settings.places import libpq_url
from app.drives import intake, publishing
from app.drives import store as drives_of
from app.drives.worker import run_worker
from app.network.settle import settle_network
from app.network.swap import solve_all_marked
from app.roads.imports import import_roads
from app.terrain.imports import import_dem
from service.databases import new_database
from soak.disturbed import Disturbed
from soak.judging import Slopes, Surviving, slopes_of
from soak.material import Material

DATABASE = "scratch"


def from_scratch(
    service: Disturbed,
    folder: Path,
    material: Material,
    roads: str,
    drives: Sequence[Surviving],
    rng: random.Random,
) -> Slopes:
    """What is published of these drives on these roads when nothing ever goes wrong, settled."""
    settings = Settings(database_url=service.cluster.url_of(DATABASE), data_dir=folder)
    with new_database(service.cluster, DATABASE) as sessions:
        blobs = BlobStore(settings.blob_store_url)
        import_dem(sessions, [material.dem], settings.dem_dir)
        import_roads(sessions, material.maps[roads], settings.dem_dir)
        for drive in rng.sample(list(drives), len(drives)):
            _upload(sessions, blobs, material.logs[drive.log], drive.method)
        run_worker(settings, wait=False)
        solve_all_marked(sessions)
        publishing.finish(sessions, blobs)
        _require_done(sessions, len(drives))
        settle_network(sessions)
        return slopes_of(libpq_url(str(settings.database_url)))


def _require_done(sessions: Sessions, count: int) -> None:
    """What fails undisturbed is no log for a soak."""
    with sessions() as session:
        drives = drives_of.list_drives(session, status="done", limit=count + 1)
    if len(drives) != count:
        raise RuntimeError(f"{len(drives)} of {count} drives are done where nothing is disturbed")


def _upload(sessions: Sessions, blobs: BlobStore, log: bytes, method: str) -> None:
    with blobs.writer() as writer:
        writer.write(log)
        blob = writer.finish()
    intake.register_upload(sessions, blobs, blob, filename="log.csv", method=method)
