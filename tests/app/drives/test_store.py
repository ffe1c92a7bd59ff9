"""The life of a drive."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest
from sqlalchemy import text

from app.core.blobs import BlobStore
from app.core.db import Sessions
from app.drives import claims
from app.drives import store as drives
from app.drives.documents import Drive, DrivePlace
from app.map import store as map_store
from app.network import cells
from fusion.types import Ints
from processing_support import remove_drive


def create(sessions: Sessions, sha256: str = "a" * 64, **values: object) -> tuple[Drive, bool]:
    row = {
        "filename": "log.csv", "size_bytes": 3, "blob_key": "drives/x", "method": "raw", "options": {}
    } | values  # fmt: skip
    with sessions.begin() as session:
        return drives.create_drive(session, sha256=sha256, **row)  # type: ignore[arg-type]


def test_a_new_drive_is_queued(sessions: Sessions) -> None:
    row, created = create(sessions, options={"min_epochs": 4})
    assert created
    assert (row.status, row.progress, row.generation, row.options) == ("queued", 0.0, 1, {"min_epochs": 4})
    assert row.created_at.utcoffset() is not None
    with sessions() as session:
        assert drives.get_drive(session, row.id) == row
        assert drives.get_drive(session, uuid.uuid4()) is None


def test_the_same_bytes_find_the_same_drive(sessions: Sessions) -> None:
    first, _ = create(sessions)
    second, created = create(sessions, filename="other.csv", blob_key="drives/y")
    assert second == first
    assert not created


def test_a_known_content_is_found_by_indexes(sessions: Sessions) -> None:
    many = """
        INSERT INTO drives (id, sha256, content_sha256, filename, size_bytes, blob_key, status, method, options)
        SELECT gen_random_uuid(), md5(k::text), CASE WHEN k % 2 = 0 THEN md5('c' || k) END, 'f', 1, 'k' || k, 'done',
               'raw', '{}' FROM generate_series(1, 20000) AS k
    """
    with sessions.begin() as session:
        session.execute(text(many))
        session.execute(text("ANALYZE drives"))
        asked = {"sha256": "a" * 64, "content_sha256": "b" * 64}
        plan = "\n".join(session.execute(text(f"EXPLAIN {drives._GET_BY_CONTENT}"), asked).scalars())
    assert "Seq Scan" not in plan, plan
    for index in (
        "uq_drives_owner_id_content_sha256",
        "uq_drives_owner_id_sha256",
        "ix_network_marks_drive_id",
    ):
        assert f"Index Scan on {index}" in plan, plan


def test_the_same_bytes_at_the_same_moment_make_one_drive(sessions: Sessions) -> None:
    start = threading.Barrier(4)

    def upload(_: int) -> tuple[Drive, bool]:
        start.wait()
        return create(sessions)

    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(upload, range(4)))
    assert sum(created for _, created in results) == 1
    assert len({row.id for row, _ in results}) == 1


def test_a_run_claims_shows_and_ends(sessions: Sessions) -> None:
    row, _ = create(sessions)
    with sessions.begin() as session:
        assert not claims.set_progress(session, row.id, 1, "early", 0.1)
        claimed = claims.mark_running(session, row.id, 1)
        assert claimed is not None
        assert claimed.status == "running"
        assert claims.set_progress(session, row.id, 1, "reading", 0.25)
        shown = drives.get_drive(session, row.id)
        assert shown is not None
        assert (shown.stage, shown.progress) == ("reading", 0.25)
        assert claims.mark_failed(session, row.id, 1, kind="bad-log", reason="No\x00.", stage="reading")
        failed = drives.get_drive(session, row.id)
        assert failed is not None
        assert failed.failure is not None
        assert (failed.status, failed.failure.reason, failed.stage) == ("failed", "No\ufffd.", "reading")
        assert failed.finished_at is not None
        assert claims.mark_running(session, row.id, 1) is None


def test_an_older_generation_has_no_say(sessions: Sessions) -> None:
    row, _ = create(sessions)
    with sessions.begin() as session:
        claims.mark_running(session, row.id, 1)
        again = drives.request_reprocess(session, row.id, "dem", {"height_sigma_m": 3.0})
        assert again is not None
        assert (again.status, again.generation, again.method) == ("queued", 2, "dem")
        assert claims.mark_running(session, row.id, 1) is None
        claims.mark_running(session, row.id, 2)
        assert not claims.set_progress(session, row.id, 1, "reading", 0.5)
        assert not claims.mark_failed(session, row.id, 1, kind="x", reason="y", stage=None)
        assert not claims.mark_queued(session, row.id, 1)
        assert not claims.lock_running(session, row.id, 1)
        assert claims.lock_running(session, row.id, 2)
        assert drives.request_reprocess(session, uuid.uuid4(), "dem", {}) is None


def test_a_report_may_hold_what_json_cannot(sessions: Sessions) -> None:
    row, _ = create(sessions)
    report = {"a": float("nan"), "b": [float("inf"), 1.5], "c": {"d": "x\x00y"}, "e": (1, None)}
    with sessions.begin() as session:
        claims.mark_publishing(
            session, row.id, report=report, bounds=(8, 49, 9, 50), epochs=2, distance_m=None, drive_time=None
        )
        claims.mark_done(session, row.id)
        done = drives.get_drive(session, row.id)
    assert done is not None
    assert done.report == {"a": None, "b": [None, 1.5], "c": {"d": "x\ufffdy"}, "e": [1, None]} | {
        "rejected_segments": 0,
        "warnings": [],
        "warnings_said": [],
    }
    assert done.bbox == (8.0, 49.0, 9.0, 50.0)
    assert (done.status, done.progress) == ("done", 1.0)


@pytest.mark.parametrize("status", [None, "queued"])
def test_the_list_goes_on_where_it_stopped(sessions: Sessions, status: str | None) -> None:
    made = [create(sessions, sha256=f"{k:064d}")[0].id for k in range(7)]
    with sessions.begin() as session:
        session.execute(
            text("UPDATE drives SET created_at = '2024-01-01Z' WHERE sha256 < :s"), {"s": f"{4:064d}"}
        )
    seen: list[uuid.UUID] = []
    place: DrivePlace | None = None
    with sessions() as session:
        while page := drives.list_drives(session, status=status, limit=2, after=place):
            seen += [row.id for row in page]
            place = DrivePlace(page[-1].created_at, page[-1].id)
        assert drives.list_drives(session, status="done") == []
    assert seen[:3] == made[:3:-1]
    assert sorted(seen) == sorted(made)


def test_blobs_that_no_drive_refers_to(sessions: Sessions) -> None:
    create(sessions, blob_key="drives/x")
    with sessions() as session:
        assert drives.unreferenced_blobs(session, ["drives/z", "drives/x", "drives/y"]) == [
            "drives/y",
            "drives/z",
        ]
        assert drives.unreferenced_blobs(session, []) == []


def test_a_deleted_drive_leaves_no_trace(
    sessions: Sessions, segment_ids: Ints, add_drive: Callable[..., uuid.UUID]
) -> None:
    stays = add_drive(segment_ids, {0: (1.0, 1.0)})
    with sessions() as session:
        before = map_store.get_segment(session, int(segment_ids[0]))
        version = cells.data_version(session)
    goes = add_drive(segment_ids, {0: (4.0, 0.1), 1: (2.0, 0.1)})
    blobs = BlobStore("memory://blobs")
    assert remove_drive(sessions, blobs, goes)
    assert not remove_drive(sessions, blobs, goes)
    with sessions() as session:
        after = map_store.get_segment(session, int(segment_ids[0]))
        assert before is not None
        assert after is not None
        assert (after.slope_percent, after.slope_sigma_percent, after.drives) == (
            before.slope_percent, before.slope_sigma_percent, 1
        )  # fmt: skip
        assert list(map_store.all_segments(session, driven=True)) == [after]
        assert cells.data_version(session) > version
        for table in ("drive_segments", "provenances"):
            owners = session.execute(text(f"SELECT DISTINCT drive_id FROM {table}")).scalars().all()
            assert owners == [stays]
