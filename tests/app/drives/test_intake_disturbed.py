"""Uploads whose commit is not answered, whose file is lost, or that come in several forms; sweeps after a restore."""

from __future__ import annotations

import gzip
import logging
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text
from sqlalchemy.exc import OperationalError

from app.core.blobs import BlobStore
from app.core.db import Sessions, make_engine, session_factory
from app.core.errors import kind_of
from app.drives import claims, intake
from app.drives import store as drives
from app.drives.documents import Drive
from lossy_database import LossyWay, lossy_way
from processing_support import accept_upload, put_blob, remove_drive

Lossy = Callable[..., Any]
LOG = b"time_s,lat_deg,lon_deg\n1700000000,49.0,8.4\n"
WEEK = timedelta(days=7)


@pytest.fixture
def blobs(tmp_path: Path) -> BlobStore:
    return BlobStore(str(tmp_path / "blobs"))


@pytest.fixture
def lossy(database_url: str) -> Iterator[Lossy]:
    """``lossy(...)``: sessions over a way that loses the answer to the first COMMIT, and the way."""
    with tempfile.TemporaryDirectory(prefix="vs-") as folder:  # a socket's path is short

        class Opened:
            def __init__(self, **how: Any) -> None:
                self.manager = lossy_way(database_url, Path(folder), **how)

            def __enter__(self) -> tuple[Sessions, LossyWay]:
                url, way = self.manager.__enter__()
                self.engine = make_engine(url)
                return session_factory(self.engine), way

            def __exit__(self, *error: Any) -> None:
                self.engine.dispose()
                self.manager.__exit__(*error)

        yield Opened


def upload(
    sessions: Sessions, blobs: BlobStore, content: bytes = LOG, method: str = "raw"
) -> tuple[Drive, bool]:
    return accept_upload(sessions, blobs, [content], filename="log.csv", method=method)


def stored(sessions: Sessions) -> tuple[list[str], int]:
    """The blobs that drives refer to, and the number of jobs."""
    with sessions() as session:
        keys = session.execute(text("SELECT blob_key FROM drives ORDER BY created_at")).scalars().all()
        return list(keys), session.execute(text("SELECT count(*) FROM procrastinate_jobs")).scalar_one()


@pytest.mark.parametrize("how", [{}, {"late_s": 0.5}, {"arrives": False}])
def test_an_upload_whose_commit_is_not_answered_keeps_its_blob(
    sessions: Sessions, blobs: BlobStore, lossy: Lossy, how: dict[str, Any]
) -> None:
    """Whether the commit arrived, arrives while the database is asked again, or never: one drive, one job, its blob."""
    with lossy(**how) as (unsure, way):
        drive, created = upload(unsure, blobs)
        assert way.lost == 1
    assert created
    assert stored(sessions) == ([drive.blob_key], 1)
    assert blobs.keys() == [drive.blob_key]


def test_a_commit_that_was_lost_and_a_database_that_cannot_be_asked_leave_the_blob(
    sessions: Sessions, blobs: BlobStore, lossy: Lossy
) -> None:
    with lossy(for_good=True) as (unsure, way), pytest.raises(OperationalError):
        upload(unsure, blobs)
    assert way.lost == 1
    (key,), jobs = stored(sessions)
    assert jobs == 1
    assert blobs.keys() == [key]


def test_a_commit_that_the_database_still_waits_for_leaves_the_blob(
    sessions: Sessions, blobs: BlobStore, lossy: Lossy, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The connection broke and the database does not know: it holds on to the content until it finds out."""
    monkeypatch.setattr(intake, "LOST_COMMIT_WAIT_S", 0.2)
    with lossy(unnoticed=True) as (unsure, _), pytest.raises(OperationalError):
        upload(unsure, blobs)
    assert len(blobs.keys()) == 1
    assert stored(sessions)[0] in ([], blobs.keys())


def test_a_database_that_is_away_before_the_commit_leaves_no_blob(
    sessions: Sessions, blobs: BlobStore, tmp_path: Path
) -> None:
    engine = make_engine(f"postgresql://versant@/none?host={tmp_path}")
    with pytest.raises(OperationalError):
        upload(session_factory(engine), blobs)
    engine.dispose()
    assert blobs.keys() == []


def test_a_commit_that_the_database_refuses_leaves_no_blob(
    sessions: Sessions, blobs: BlobStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    with sessions.begin() as session:
        for statement in (
            "CREATE FUNCTION refuse() RETURNS trigger LANGUAGE plpgsql AS "
            "$$ BEGIN RAISE EXCEPTION USING ERRCODE = 'disk_full', MESSAGE = 'no room'; END $$",
            "CREATE CONSTRAINT TRIGGER late AFTER INSERT ON drives DEFERRABLE INITIALLY DEFERRED "
            "FOR EACH ROW EXECUTE FUNCTION refuse()",
        ):
            session.execute(text(statement))
    with pytest.raises(OperationalError, match="no room") as refused:
        upload(sessions, blobs)
    assert kind_of(refused.value).status == 507
    assert blobs.keys() == stored(sessions)[0] == []


def test_known_bytes_give_a_drive_the_file_that_it_lost(sessions: Sessions, blobs: BlobStore) -> None:
    drive, _ = upload(sessions, blobs)
    blobs.delete(drive.blob_key)
    healed, created = upload(sessions, blobs, method="dem")
    assert not created
    assert (healed.id, healed.status, healed.method, healed.generation) == (drive.id, "queued", "raw", 1)
    assert stored(sessions) == ([healed.blob_key], 1)
    with blobs.open(healed.blob_key) as file:
        assert file.read() == LOG
    assert blobs.keys() == [healed.blob_key]


def test_a_copy_in_another_form_heals_too_and_the_document_describes_what_is_stored(
    sessions: Sessions, blobs: BlobStore
) -> None:
    drive, _ = upload(sessions, blobs)
    blobs.delete(drive.blob_key)
    packed = gzip.compress(LOG)
    healed, _ = upload(sessions, blobs, packed)
    assert healed.id == drive.id
    assert (healed.sha256 != drive.sha256, healed.size_bytes) == (True, len(packed))
    assert [upload(sessions, blobs, content)[0] for content in (LOG, packed)] == [healed] * 2
    assert blobs.keys() == [healed.blob_key]


def test_a_drive_that_failed_without_its_file_is_computed_again(sessions: Sessions, blobs: BlobStore) -> None:
    drive, _ = upload(sessions, blobs)
    blobs.delete(drive.blob_key)
    with sessions.begin() as session:
        assert claims.mark_running(session, drive.id, 1)
        claims.mark_failed(session, drive.id, 1, kind="processing-failed", reason="gone", stage="reading")
    healed, created = upload(sessions, blobs)
    assert not created
    assert (healed.status, healed.generation, healed.failure) == ("queued", 2, None)
    assert stored(sessions) == ([healed.blob_key], 2)


def test_two_that_heal_at_the_same_moment_leave_one_blob(sessions: Sessions, blobs: BlobStore) -> None:
    drive, _ = upload(sessions, blobs)
    blobs.delete(drive.blob_key)
    found = at_once([LOG, gzip.compress(LOG), LOG, gzip.compress(LOG, 1)], sessions, blobs)
    assert {(healed.id, created) for healed, created in found} == {(drive.id, False)}
    assert blobs.keys() == stored(sessions)[0]


def at_once(contents: list[bytes], sessions: Sessions, blobs: BlobStore) -> list[tuple[Drive, bool]]:
    start = threading.Barrier(len(contents))

    def send(content: bytes) -> tuple[Drive, bool]:
        start.wait()
        return upload(sessions, blobs, content)

    with ThreadPoolExecutor(len(contents)) as pool:
        return list(pool.map(send, contents))


def test_forms_of_one_content_at_the_same_moment_are_one_drive(sessions: Sessions, blobs: BlobStore) -> None:
    forms = [LOG, gzip.compress(LOG, 1), gzip.compress(LOG, 9), LOG, gzip.compress(gzip.compress(LOG))]
    found = at_once(forms, sessions, blobs)
    assert sum(created for _, created in found) == 1
    assert len({drive.id for drive, _ in found}) == 1
    assert stored(sessions) == (blobs.keys(), 1)


@pytest.mark.parametrize(
    ("first", "second"),
    [(LOG, LOG), (LOG, gzip.compress(LOG)), (gzip.compress(LOG, mtime=0), gzip.compress(LOG, mtime=0))],
    ids=["plain", "then gzipped", "gzipped"],
)
def test_drives_from_before_contents_were_told_are_found_by_their_bytes(
    sessions: Sessions, blobs: BlobStore, first: bytes, second: bytes
) -> None:
    drive, _ = upload(sessions, blobs, first)
    with sessions.begin() as session:
        session.execute(text("UPDATE drives SET content_sha256 = NULL"))
    assert upload(sessions, blobs, second) == (drive, False)


def test_a_drive_that_is_deleted_while_its_content_comes_again_is_made_anew(
    sessions: Sessions, blobs: BlobStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive, _ = upload(sessions, blobs)
    blobs.delete(drive.blob_key)
    genuine = drives.give_blob

    def too_late(*args: Any, **kwargs: Any) -> bool:
        assert remove_drive(sessions, blobs, drive.id)
        return genuine(*args, **kwargs)

    monkeypatch.setattr(drives, "give_blob", too_late)
    again, created = upload(sessions, blobs)
    assert created
    assert again.id != drive.id
    assert stored(sessions)[0] == blobs.keys() == [again.blob_key]


def aged(blobs: BlobStore, monkeypatch: pytest.MonkeyPatch, days: float) -> None:
    """Let all that is stored by now look so old."""
    changed = time.time() - days * 86_400
    moment = time.strftime("%Y-%m-%dT%H:%M:%S+00:00", time.gmtime(changed))
    genuine = blobs._fs.__class__.modified

    def modified(fs: Any, path: str) -> Any:
        found = genuine(fs, path)
        return found.fromisoformat(moment) if path in known else found

    known = {f"{blobs._root}/{key}" for key in blobs.keys()}  # noqa: SIM118 - no dictionary
    monkeypatch.setattr(blobs._fs.__class__, "modified", modified)


def test_orphans_stay_as_long_as_a_backup_may_need_them(
    sessions: Sessions, blobs: BlobStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive, _ = upload(sessions, blobs)
    orphan = put_blob(blobs, [b"uploaded since the backup"])
    with monkeypatch.context() as patch:
        aged(blobs, patch, 6.9)
        assert intake.sweep_blobs(sessions, blobs, WEEK).removed == 0
    aged(blobs, monkeypatch, 7.1)
    found = intake.sweep_blobs(sessions, blobs, WEEK)
    assert (found.orphans, found.removed) == ((orphan.key,), 1)
    assert blobs.keys() == [drive.blob_key]


def test_after_a_restore_a_sweep_only_says_what_it_would_remove(
    sessions: Sessions, blobs: BlobStore, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A restored dump is another database: what its drives do not know may be what the next backup brings back."""
    blobs.register_database("6940000000000000000-16384")
    drive, _ = upload(sessions, blobs)
    orphan = put_blob(blobs, [b"of a drive that the backup does not have"])
    aged(blobs, monkeypatch, 100)
    with caplog.at_level(logging.WARNING):
        found = intake.sweep_blobs(sessions, blobs, WEEK)
    assert (found.orphans, found.removed) == ((orphan.key,), 0)
    assert found.strangers == ("6940000000000000000-16384",)
    assert blobs.keys() == sorted([drive.blob_key, orphan.key])
    for said in (orphan.key, found.strangers[0], "versant sweep --only-database"):
        assert said in caplog.text
    assert intake.sweep_blobs(sessions, blobs, WEEK, confirmed=True).removed == 1
    assert blobs.keys() == [drive.blob_key]
    assert intake.sweep_blobs(sessions, blobs, WEEK).strangers == ()


def test_blobs_of_nobody_known_are_left_alone(
    sessions: Sessions, blobs: BlobStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A store whose notes are lost, say a copy of the logs alone."""
    orphan = put_blob(blobs, [b"of an unknown database"])
    aged(blobs, monkeypatch, 100)
    drive, _ = upload(sessions, blobs)
    found = intake.sweep_blobs(sessions, blobs, WEEK)
    assert (found.orphans, found.removed, found.strangers) == ((orphan.key,), 0, ("unknown",))
    assert blobs.keys() == sorted([drive.blob_key, orphan.key])
