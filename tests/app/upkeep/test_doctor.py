"""What the doctor finds, and that it changes nothing."""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from affine import Affine
from sqlalchemy import text
from typer.testing import CliRunner

from app.cli import app
from app.core.blobs import BlobStore
from app.core.db import Sessions
from app.core.settings import Settings
from app.drives.documents import Drive
from app.jobs.computations import SIGNS, Signs
from app.terrain.imports import import_dem
from app.upkeep import doctor, store
from app.upkeep.doctor import Finding, Patient, examine
from processing_support import accept_upload, put_blob

runner = CliRunner()


@pytest.fixture
def settings(database_url: str, tmp_path: Path) -> Settings:
    return Settings(database_url=database_url, data_dir=tmp_path, min_free_bytes=0)


@pytest.fixture
def blobs(tmp_path: Path) -> BlobStore:
    return BlobStore(str(tmp_path / "blobs"))


@pytest.fixture
def upload(sessions: Sessions, blobs: BlobStore) -> Callable[[bytes], Drive]:
    return lambda content: accept_upload(sessions, blobs, [content], filename="log", method="raw")[0]


def found(settings: Settings, sessions: Sessions | None, **changes: Any) -> dict[str, Finding]:
    findings = examine(Patient(settings.model_copy(update=changes), sessions, "It is away."))
    assert all(one.advice for one in findings if one.state != "ok")
    return {one.subject: one for one in findings}


def execute(sessions: Sessions, statement: str, **values: Any) -> None:
    with sessions.begin() as session:
        session.execute(text(statement), values)


def raster(path: Path) -> Path:
    with rasterio.open(
        path, "w", driver="GTiff", width=8, height=8, count=1, dtype="float32", crs="EPSG:4326",
        transform=Affine(0.01, 0, 8, 0, -0.01, 49),
    ) as dataset:  # fmt: skip
        dataset.write(np.full((8, 8), 100, np.float32), 1)
    return path


def test_a_sound_service(
    settings: Settings, sessions: Sessions, upload: Callable[[bytes], Drive], tmp_path: Path
) -> None:
    import_dem(sessions, [raster(tmp_path / "a.tif")], settings.dem_dir)
    upload(b"log")
    execute(sessions, "INSERT INTO procrastinate_workers DEFAULT VALUES")
    findings = found(settings, sessions)
    assert {subject: one.state for subject, one in findings.items() if one.state != "ok"} == {}
    assert {"programs", "access", "room of logs", "database", "schema", "clocks", "queue", "cells", "logs",
            "elevation"} <= findings.keys()  # fmt: skip
    for word in ("Versant", "Python", "GDAL", "PROJ"):
        assert word in findings["programs"].found
    assert "PostGIS 3" in findings["database"].found


def test_a_database_that_is_away_ends_no_other_look(settings: Settings) -> None:
    findings = found(settings, None)
    assert (findings["database"].state, findings["database"].found) == ("fail", "It is away.")
    assert findings["room of logs"].state == "ok"


def test_a_queue_in_trouble(settings: Settings, sessions: Sessions, upload: Callable[[bytes], Drive]) -> None:
    drives = [upload(content) for content in (b"a", b"b", b"c")]
    assert found(settings, sessions)["queue"].found.startswith("3 drives wait, the first for 0 s; 0 lanes")
    assert found(settings, sessions)["queue"].state == "warn"
    execute(sessions, "INSERT INTO procrastinate_workers DEFAULT VALUES")
    assert found(settings, sessions)["queue"].state == "ok"
    execute(sessions, "UPDATE drives SET queued_at = queued_at - interval '2 hours'")
    assert found(settings, sessions)["queue"].state == "warn"
    execute(
        sessions,
        "UPDATE procrastinate_jobs SET status = 'doing', worker_id = (SELECT max(id) FROM procrastinate_workers) "
        "WHERE args ->> 'drive_id' = :id",
        id=str(drives[0].id),
    )
    assert "stuck jobs" not in found(settings, sessions)
    execute(sessions, "UPDATE procrastinate_workers SET last_heartbeat = now() - interval '1 minute'")
    assert found(settings, sessions)["stuck jobs"].found.startswith("1 jobs")
    execute(
        sessions, "UPDATE drives SET status = 'running', stage = 'reading' WHERE id = :id", id=drives[1].id
    )
    assert "drives nobody computes" not in found(settings, sessions)
    execute(sessions, "DELETE FROM procrastinate_jobs WHERE status = 'todo'")
    findings = found(settings, sessions)
    assert (findings["drives nobody computes"].state, findings["drives without a job"].state) == (
        "fail",
        "warn",
    )
    execute(sessions, "UPDATE drives SET stage = 'publishing' WHERE status = 'running'")
    assert "drives nobody computes" not in found(settings, sessions)


def test_lanes_of_this_machine_and_of_others(settings: Settings, sessions: Sessions) -> None:
    """Two rows of the queue's table: one lane here, and one of another machine, or one that was just killed."""
    signs = Signs(settings.data_dir / SIGNS)
    signs.begin()
    (own,) = (settings.data_dir / SIGNS).iterdir()
    own.with_name(f"other-{own.name}").touch()  # of a process that died
    try:
        for _ in range(2):
            execute(sessions, "INSERT INTO procrastinate_workers DEFAULT VALUES")
        told = found(settings, sessions)["queue"].found
        assert "2 lanes of workers alive, 1 of them on this machine. The others gave a sign" in told
        execute(sessions, "UPDATE procrastinate_workers SET last_heartbeat = now() - interval '1 hour'")
        told = found(settings, sessions)["queue"].found
        assert told.endswith("1 lane of workers alive, 1 of them on this machine."), "this machine slept"
    finally:
        signs.end()
    assert "0 lanes of workers alive" in found(settings, sessions)["queue"].found


def test_logs_and_rasters_that_are_lost(
    settings: Settings, sessions: Sessions, upload: Callable[[bytes], Drive], blobs: BlobStore, tmp_path: Path
) -> None:
    assert found(settings, sessions)["elevation"].state == "warn"
    lost, kept = upload(b"a"), upload(b"b")
    for content in (b"c", b"d", b"e"):
        put_blob(blobs, [content])
    blobs.delete(lost.blob_key)
    findings = found(settings, sessions)
    assert (findings["logs"].state, findings["logs without a drive"].state) == ("fail", "warn")
    assert str(lost.id) in findings["logs"].found
    assert str(kept.id) not in findings["logs"].found
    assert findings["logs without a drive"].found.startswith("3 logs")
    (path,) = import_dem(sessions, [raster(tmp_path / "a.tif")], settings.dem_dir).paths
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    assert "a.tif is not as it was" in found(settings, sessions)["elevation"].found
    path.unlink()
    assert found(settings, sessions)["elevation"].state == "fail"
    execute(sessions, """UPDATE dem_versions SET pending = '{"boxes_deg": [], "after_id": 0}'""")
    assert found(settings, sessions)["heights"].state == "warn"


def test_what_is_derived_and_far_behind(settings: Settings, sessions: Sessions) -> None:
    execute(sessions, "INSERT INTO cells_to_draw (level, cell) VALUES (12, 5)")
    waits = found(settings, sessions)["ways and low zooms"]
    assert (waits.state, waits.found) == (
        "ok",
        "They are 0 s behind the segments; 1 cells wait to be drawn.",
    )
    execute(sessions, "UPDATE cells_to_draw SET since = since - interval '1 hour'")
    assert found(settings, sessions)["ways and low zooms"].state == "warn"


def test_room_and_access(settings: Settings) -> None:
    assert found(settings, None, min_free_bytes=2**60)["room of logs"].state == "fail"
    assert found(settings, None, blob_url="memory://logs")["room of logs"].state == "ok"
    assert found(settings, None, host="0.0.0.0")["access"].state == "warn"  # noqa: S104 - that is what is found
    assert found(settings, None, host="0.0.0.0", access="keys")["access"].state == "ok"  # noqa: S104 - as above
    assert found(settings, None, host="::1")["access"].state == "ok"
    assert found(settings, None, allowed_hosts="*")["access"].state == "warn"


def test_clocks_and_schemas_that_are_apart(
    settings: Settings, sessions: Sessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = store.server_clock
    for off_s, state in ((0.0, "ok"), (5.0, "warn"), (-5.0, "warn"), (90.0, "fail"), (-90.0, "fail")):
        monkeypatch.setattr(
            doctor.store, "server_clock", lambda s, off=off_s: clock(s) + timedelta(seconds=off)
        )
        assert found(settings, sessions)["clocks"].state == state
    execute(sessions, "UPDATE alembic_version SET version_num = '0012'")
    assert found(settings, sessions)["schema"].state == "fail"


def test_the_command(
    database_url: str, tmp_path: Path, sessions: Sessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VERSANT_DATABASE_URL", database_url)
    monkeypatch.setenv("VERSANT_DATA_DIR", str(tmp_path / "data"))
    figures = tmp_path / "figures.json"
    done = runner.invoke(app, ["doctor", "--json", str(figures)])
    assert done.exit_code == 0, done.output
    said = json.loads(figures.read_text())
    assert said["state"] == "warn"
    assert len(done.stdout.splitlines()) == len(said["findings"]) + 1
    assert not (tmp_path / "data").exists(), "it only looks"
    execute(sessions, "DROP TABLE network_marks CASCADE")
    done = runner.invoke(app, ["doctor"])
    assert done.exit_code == 1
    assert done.stderr == "versant: Something is wrong: cells.\n"
    assert "network_marks" in done.stdout
    monkeypatch.setenv("VERSANT_DATABASE_URL", "postgresql://nobody@127.0.0.1:1/none")
    done = runner.invoke(app, ["doctor"])
    assert done.exit_code == 1
    assert done.stderr == "versant: Something is wrong: database.\n"
