"""A backup of a service that goes on, and its return: the same slopes, and the queue goes on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text
from typer.testing import CliRunner

from app.changes import store as changes
from app.changes.webhooks.store import add_webhook, list_webhooks
from app.cli import app
from app.core import databases, migrate
from app.core.blobs import BlobStore
from app.core.db import Sessions, make_engine, session_factory
from app.core.errors import GoneError
from app.core.settings import Settings
from app.drives.documents import Drive
from app.drives.process import Outcome
from app.drives.worker import run_worker
from app.embedded.cluster import EmbeddedPostgres
from app.jobs.context import JobContext
from app.upkeep import restore as bringing_back
from app.upkeep.backup import back_up
from app.upkeep.dumps import BackupError
from app.upkeep.manifest import keep, read_manifest
from processing_support import accept_upload, process_drive, put_blob, remove_drive

Send = Callable[..., Any]
Upload = Callable[[bytes], Drive]
runner = CliRunner()


@pytest.fixture
def settings(database_url: str, tmp_path: Path) -> Settings:
    return Settings(database_url=database_url, data_dir=tmp_path)


@pytest.fixture
def blobs(tmp_path: Path) -> BlobStore:
    return BlobStore(str(tmp_path / "blobs"))


@pytest.fixture
def upload(sessions: Sessions, blobs: BlobStore) -> Upload:
    """``upload(bytes)``: a drive that waits, in a service without roads."""
    return lambda content: accept_upload(sessions, blobs, [content], filename="log", method="raw")[0]


@pytest.fixture
def empty(
    cluster: EmbeddedPostgres, new_database: Callable[[str], str], tmp_path: Path
) -> Iterator[tuple[Settings, Sessions]]:
    """Another database, without anything, and a data folder that is not there."""
    name = new_database("template0")
    settings = Settings(database_url=cluster.url_of(name), data_dir=tmp_path / "restored")
    engine = make_engine(cluster.url_of(name))
    yield settings, session_factory(engine)
    engine.dispose()
    databases.drop_database(cluster.url, name)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    return tmp_path / "copy"


def said_of(settings: Settings, out: Path, monkeypatch: pytest.MonkeyPatch) -> bytes:
    """What `versant export` writes."""
    monkeypatch.setenv("VERSANT_DATABASE_URL", str(settings.database_url))
    done = runner.invoke(app, ["export", "-o", str(out), "--gaps"])
    assert done.exit_code == 0, done.output
    return out.read_bytes()


def statuses(sessions: Sessions) -> list[str]:
    with sessions() as session:
        return list(session.execute(text("SELECT status FROM drives ORDER BY created_at")).scalars())


def begin(sessions: Sessions, drive_id: object) -> None:
    """Let it look as if a worker computed the drive just now."""
    drive = text("UPDATE drives SET status = 'running', stage = 'estimating' WHERE id = :id")
    job = text(
        "UPDATE procrastinate_jobs SET status = 'doing', worker_id = :worker WHERE args ->> 'drive_id' = :id"
    )
    with sessions.begin() as session:
        session.execute(drive, {"id": drive_id})
        worker = session.execute(
            text("INSERT INTO procrastinate_workers DEFAULT VALUES RETURNING id")
        ).scalar_one()
        session.execute(job, {"worker": worker, "id": str(drive_id)})


def test_the_same_slopes_come_back_and_the_queue_goes_on(
    context: JobContext, send: Send, sessions: Sessions, settings: Settings, empty: tuple[Settings, Sessions],
    copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """Byte for byte, after everything of the former service is gone."""
    drive = send(0, "raw")
    assert process_drive(context, drive.id, drive.generation) is Outcome.DONE
    running, waiting = send(1, "raw"), send(2, "raw")
    begin(sessions, running.id)
    before = said_of(settings, tmp_path / "before.geojson", monkeypatch)
    with sessions() as session:
        version = changes.version_text(session, changes.horizon(session))
    with sessions.begin() as session:
        add_webhook(session, "https://example.org/", "whsec_", ["drive.done"], None, None)
    manifest = back_up(settings, sessions, copy)
    assert (manifest.drives, len(manifest.files), manifest.missing, manifest.damaged) == (3, 5, (), ())
    assert manifest.versions["postgres_major"] >= 13
    (tmp_path / "blobs").rename(tmp_path / "gone-blobs")
    (tmp_path / "dem").rename(tmp_path / "gone-dem")

    where, there = empty
    found = bringing_back.restore(where, there, copy, bringing_back.checked(copy))
    assert (found.logs, found.waiting, found.other_databases) == (3, 2, ())
    assert not changes.begin_epoch(there), "the restored database's changes are numbered already"
    assert said_of(where, tmp_path / "after.geojson", monkeypatch) == before
    assert statuses(there) == ["done", "queued", "queued"]
    run_worker(where, wait=False)
    assert statuses(there) == ["done", "done", "done"], waiting.id
    with there() as session:
        (webhook,) = list_webhooks(session)
        assert not webhook.active, (
            "a copy tells nobody before it is said that it takes the former one's place"
        )
        with pytest.raises(GoneError):
            changes.parse_version(session, version)
        identity = databases.database_identity(session)
        (kept,) = session.execute(text("SELECT file_uri FROM regions")).scalars()
    assert (where.data_dir / "dem" / kept).is_file()
    assert [path.name for path in (where.data_dir / "blobs" / "databases").iterdir()] == [identity]


def test_a_second_backup_copies_what_is_new_and_forgets_what_is_gone(
    blobs: BlobStore,
    upload: Upload,
    sessions: Sessions,
    settings: Settings,
    copy: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drives = [upload(b"first"), upload(b"second")]
    copied: list[str] = []

    def watched(folder: Path, path: str, opened: Any) -> Any:
        copied.append(path)
        return keep(folder, path, opened)

    monkeypatch.setattr("app.upkeep.backup.keep", watched)
    first = back_up(settings, sessions, copy)
    assert len(copied) == 2
    copied.clear()
    put_blob(blobs, [b"no drive"])
    assert remove_drive(sessions, blobs, drives[0].id)
    upload(b"third")
    second = back_up(settings, sessions, copy)
    assert len(copied) == 1
    assert first.dump.path != second.dump.path
    named = {entry.path for entry in (second.dump, *second.files)}
    on_disk = {path.relative_to(copy).as_posix() for path in copy.rglob("*") if path.is_file()}
    assert on_disk == named | {"manifest.json", ".versant-backup.lock"}
    assert read_manifest(copy) == second
    for entry in second.files:
        assert hashlib.sha256((copy / entry.path).read_bytes()).hexdigest() == entry.sha256


def test_a_backup_that_is_broken_off_is_none_and_leaves_the_one_before(
    blobs: BlobStore,
    upload: Upload,
    sessions: Sessions,
    settings: Settings,
    copy: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    upload(b"first")

    def killed(*_: object) -> Any:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr("app.upkeep.backup.write_manifest", killed)
        back_up(settings, sessions, copy)
    with pytest.raises(BackupError, match="no complete backup"):
        bringing_back.checked(copy)
    whole = back_up(settings, sessions, copy)
    upload(b"second")
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr("app.upkeep.backup.keep", killed)
        back_up(settings, sessions, copy)
    assert bringing_back.checked(copy) == whole


def test_what_the_store_lost_or_spoiled_is_told(
    blobs: BlobStore, upload: Upload, sessions: Sessions, settings: Settings, copy: Path, tmp_path: Path
) -> None:
    lost, spoiled, leaving = upload(b"first"), upload(b"second"), upload(b"third")
    for drive in (lost, leaving):
        (tmp_path / "blobs" / drive.blob_key).unlink()
    (tmp_path / "blobs" / spoiled.blob_key).write_bytes(b"rot")
    with sessions.begin() as session:
        session.execute(text("UPDATE drives SET status = 'cancelled' WHERE id = :id"), {"id": leaving.id})
    manifest = back_up(settings, sessions, copy)
    assert (manifest.missing, manifest.damaged) == ((lost.blob_key,), (spoiled.blob_key,))
    assert bringing_back.checked(copy) == manifest


def test_a_raster_whose_file_is_gone_is_told_before_the_backup_takes_the_place_of_the_one_before(
    sessions: Sessions, settings: Settings, copy: Path
) -> None:
    whole = back_up(settings, sessions, copy)
    with sessions.begin() as session:
        rasters = json.dumps([{"name": "a.tif", "uri": "x/a.tif", "sha256": "0"}])
        session.execute(
            text("INSERT INTO dem_versions (sources, datum, active) VALUES (CAST(:s AS jsonb), '', true)"),
            {"s": rasters},
        )
    with pytest.raises(BackupError, match=r"raster a\.tif is not at"):
        back_up(settings, sessions, copy)
    assert read_manifest(copy) == whole


def test_nothing_is_overwritten(
    upload: Upload,
    sessions: Sessions,
    settings: Settings,
    empty: tuple[Settings, Sessions],
    copy: Path,
    tmp_path: Path,
) -> None:
    upload(b"first")
    manifest = back_up(settings, sessions, copy)
    with pytest.raises(BackupError, match="not empty"):
        bringing_back.restore(settings, sessions, copy, manifest)
    assert statuses(sessions) == ["queued"]
    with pytest.raises(BackupError, match="no backup"):
        back_up(settings, sessions, tmp_path / "blobs")
    where, there = empty
    with pytest.raises(BackupError, match="never migrated"):
        back_up(where, there, tmp_path / "other")
    bringing_back.restore(where, there, copy, manifest)
    with pytest.raises(BackupError, match="another database"):
        back_up(where, there, copy)
    assert read_manifest(copy) == manifest


def test_a_store_that_others_used_keeps_what_it_has(
    blobs: BlobStore,
    upload: Upload,
    sessions: Sessions,
    settings: Settings,
    empty: tuple[Settings, Sessions],
    copy: Path,
) -> None:
    """The restored dump is another database to it: sweeps remove nothing."""
    upload(b"first")
    manifest = back_up(settings, sessions, copy)
    former = blobs.databases()
    where = empty[0].model_copy(update={"blob_url": str(settings.data_dir / "blobs")})
    found = bringing_back.restore(where, empty[1], copy, manifest)
    assert (found.logs, found.other_databases) == (0, tuple(former))
    assert len(blobs.keys()) == 1


def test_a_restore_that_fails_leaves_an_empty_database(
    upload: Upload, sessions: Sessions, settings: Settings, empty: tuple[Settings, Sessions], copy: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    upload(b"first")
    manifest = back_up(settings, sessions, copy)
    whole = (copy / manifest.dump.path).read_bytes()
    (copy / manifest.dump.path).write_bytes(whole[: len(whole) // 2])
    where, there = empty
    with pytest.raises(BackupError, match="cannot be"):
        bringing_back.restore(where, there, copy, manifest)
    (copy / manifest.dump.path).write_bytes(whole)
    assert bringing_back.restore(where, there, copy, manifest).logs == 0
    assert statuses(there) == ["queued"]


def test_a_backup_of_the_schema_before_the_plain_names_is_migrated(
    upload: Upload, database_url: str, sessions: Sessions, settings: Settings, empty: tuple[Settings, Sessions],
    copy: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    first, second = upload(b"first"), upload(b"second")
    migrate.downgrade(database_url, "0027")
    with sessions.begin() as session:
        values = {"first": first.id, "second": second.id}
        session.execute(text("UPDATE drives SET same_as = :first WHERE id = :second"), values)
        session.execute(text("INSERT INTO squares_to_draw (level, square) VALUES (12, 5)"))
        session.execute(
            text(
                "INSERT INTO webhooks (id, url, secret, events, told) "
                "VALUES (gen_random_uuid(), 'https://example.org', 's', '{segments.changed}', 'v.7')"
            )
        )
    assert back_up(settings, sessions, copy).versions["revision"] == "0027"
    where, there = empty
    monkeypatch.setenv("VERSANT_DATABASE_URL", str(where.database_url))
    monkeypatch.setenv("VERSANT_DATA_DIR", str(where.data_dir))
    done = runner.invoke(app, ["restore", str(copy)])
    assert done.exit_code == 0, done.output
    migrate.upgrade(str(where.database_url))
    with there() as session:
        assert session.execute(text("SELECT id, duplicate_of FROM drives ORDER BY created_at")).all() == [
            (first.id, None),
            (second.id, first.id),
        ]
        waiting = session.execute(text("SELECT level, cell FROM cells_to_draw ORDER BY level DESC"))
        assert waiting.all() == [(12, 5), (10, 1)]  # with its block
        (webhook,) = list_webhooks(session)
    assert (webhook.reported_version, webhook.active) == ("v.7", False)
    migrate.check(str(where.database_url))


def test_the_commands(
    upload: Upload, database_url: str, empty: tuple[Settings, Sessions], copy: Path, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    upload(b"first")
    monkeypatch.setenv("VERSANT_DATABASE_URL", database_url)
    monkeypatch.setenv("VERSANT_DATA_DIR", str(tmp_path))
    figures = tmp_path / "figures.json"
    made = runner.invoke(app, ["backup", str(copy), "--json", str(figures)])
    assert made.exit_code == 0, made.output
    assert "1 drives, 1 logs, 0 files of rasters" in made.stdout
    assert json.loads(figures.read_text())["drives"] == 1
    assert copy.stat().st_mode & 0o077 == 0, "logs show where somebody lives"
    tried = runner.invoke(app, ["restore", str(copy), "--dry-run"])
    assert tried.exit_code == 0, tried.output
    assert "every file is as it was" in tried.stdout
    refused = runner.invoke(app, ["restore", str(copy)])
    assert refused.exit_code == 1
    assert "not empty" in refused.stderr
    monkeypatch.setenv("VERSANT_DATABASE_URL", str(empty[0].database_url))
    monkeypatch.setenv("VERSANT_DATA_DIR", str(empty[0].data_dir))
    back = runner.invoke(app, ["restore", str(copy)])
    assert back.exit_code == 0, back.output
    assert "1 drives wait to be processed." in back.stdout
    nothing = runner.invoke(app, ["restore", str(tmp_path / "none")])
    assert nothing.exit_code == 1
    assert "holds no complete backup" in nothing.stderr
