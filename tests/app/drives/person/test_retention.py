"""Logs are deleted when a drive is done, or so many days after; what was computed stays, and everybody says so."""

from __future__ import annotations

import uuid
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from access_support import Keyed
from app.core.blobs import BlobStore
from app.drives.batches.touched import queue_touched
from app.drives.intake import sweep_blobs
from app.drives.person import retention
from app.drives.process import Outcome
from app.drives.worker import run_worker
from app.upkeep import store as upkeep
from app.upkeep.backup import back_up
from app.upkeep.doctor import Patient, examine
from many_drives import execute, make_drives, rows
from person_support import Anna
from problem_support import check
from processing_support import process_drive


def keep(keyed: Keyed, days: int | None) -> dict[str, Any]:
    answer = keyed.a.own.client.patch("/v1/owner", json={"keep_logs_days": days})
    assert answer.status_code == 200, answer.text
    document: dict[str, Any] = answer.json()
    return document


def look(keyed: Keyed, of_all: int | None = None) -> None:
    while retention.delete_due(keyed.web.sessions, keyed.web.blobs, of_all):
        pass


def drive_of(keyed: Keyed, drive: str) -> dict[str, Any]:
    document: dict[str, Any] = keyed.a.own.get(f"/v1/drives/{drive}").json()
    return document


def older(keyed: Keyed, days: float) -> None:
    """Let all that has ended have ended so long ago."""
    statement = (
        "UPDATE drives SET finished_at = now() - make_interval(secs => :s) WHERE finished_at IS NOT NULL"
    )
    execute(keyed.web.sessions, statement, s=days * 86_400)


@pytest.fixture
def without(anna: Anna) -> Anna:
    """The drive that is done has no log any more; the other one waits with its own."""
    keep(anna.keyed, 0)
    look(anna.keyed)
    return anna


def test_results_stay_and_the_rest_says_why_not(without: Anna) -> None:
    keyed, drive = without.keyed, without.done
    document = drive_of(keyed, drive)
    assert document["log_deleted_at"] is not None
    assert document["status"] == "done"
    rels = {one["rel"] for one in document["links"]}
    assert "track" in rels
    assert not rels & {"enclosure", "reprocess"}
    own = keyed.a.own
    for part in ("track", "profile", "segments", "measurements"):
        assert own.get(f"/v1/drives/{drive}/{part}").status_code == 200
    for problem in (
        check(own.get(f"/v1/drives/{drive}/log"), 410),
        check(own.post(f"/v1/drives/{drive}/reprocess"), 410),
        check(own.post(f"/v1/drives/{drive}/trials?method=raw"), 410),
    ):
        assert problem["type"] == "/problems/log-deleted"
    waiting = drive_of(keyed, without.waiting)
    assert waiting["log_deleted_at"] is None
    assert own.get(f"/v1/drives/{without.waiting}/log").content == without.logs[without.waiting]
    assert len(keyed.web.blobs.keys()) == 1


def test_one_that_waits_is_computed_and_then_has_none(without: Anna) -> None:
    keyed = without.keyed
    assert process_drive(keyed.web.context, uuid.UUID(without.waiting), 1) is Outcome.DONE
    look(keyed)
    assert drive_of(keyed, without.waiting)["log_deleted_at"] is not None
    assert keyed.web.blobs.keys() == []


def test_the_same_log_again_is_the_same_drive_and_is_not_kept(without: Anna) -> None:
    keyed = without.keyed
    sent = {"file": ("again.csv", without.logs[without.done])}
    answer = keyed.a.own.post("/v1/drives", files=sent)
    assert (answer.status_code, answer.json()["id"]) == (200, without.done)
    assert drive_of(keyed, without.done)["status"] == "done"
    assert len(keyed.web.blobs.keys()) == 1


def test_batches_leave_it_out_and_count_it(without: Anna) -> None:
    own = without.keyed.a.own
    counted = own.post("/v1/drives/reprocess?which=all&dry_run=true").json()
    assert counted["queued"] == 0
    assert counted["skipped"] == {"log-deleted": 1}
    assert "1 drive is left out, because the log was deleted" in counted["note"]
    assert "Nothing was chosen" not in counted["note"]
    asked = own.post("/v1/drives/reprocess?which=all").json()
    assert (asked["queued"], asked["skipped"]) == (0, {"log-deleted": 1})
    assert drive_of(without.keyed, without.done)["status"] == "done"
    removed = own.post("/v1/drives/remove?which=all&dry_run=true").json()
    assert removed["drives"] == 1


def test_changed_roads_leave_it_as_it_is(without: Anna) -> None:
    sessions = without.keyed.web.sessions
    for drive, state in ((without.done, 1 << 40), (without.waiting, 0)):
        statement = "INSERT INTO touched_drives (drive_id, road_state) VALUES (:id, :state)"
        execute(sessions, statement, id=drive, state=state)
    assert queue_touched(sessions) == 0
    assert drive_of(without.keyed, without.done)["status"] == "done"
    left = rows(sessions, "SELECT CAST(drive_id AS text) FROM touched_drives")
    assert left == [(without.waiting,)]


def test_upkeep_does_not_miss_it(without: Anna, tmp_path: Path) -> None:
    web = without.keyed.web
    manifest = back_up(web.settings, web.sessions, tmp_path / "backup")
    assert (manifest.missing, manifest.damaged) == ((), ())
    findings = {one.subject: one for one in examine(Patient(web.settings, web.sessions))}
    assert findings["logs"].state == "ok"
    with web.sessions() as session:
        assert upkeep.drive_blobs(session).keys() == {without.waiting}


def test_a_log_goes_so_many_days_after(anna: Anna) -> None:
    keyed = anna.keyed
    assert keep(keyed, 3)["logs_kept_days"] == 3
    older(keyed, 2.9)
    look(keyed)
    assert drive_of(keyed, anna.done)["log_deleted_at"] is None
    older(keyed, 3.1)
    look(keyed)
    assert drive_of(keyed, anna.done)["log_deleted_at"] is not None


def test_what_holds_for_all_holds_for_who_says_nothing(anna: Anna) -> None:
    keyed = anna.keyed
    older(keyed, 10)
    keep(keyed, 20)
    look(keyed, of_all=5)
    assert drive_of(keyed, anna.done)["log_deleted_at"] is None
    assert keep(keyed, None)["logs_kept_days"] is None  # this service keeps them for good
    look(keyed, of_all=None)
    assert drive_of(keyed, anna.done)["log_deleted_at"] is None
    look(keyed, of_all=5)
    assert drive_of(keyed, anna.done)["log_deleted_at"] is not None


def test_a_failed_drives_log_stays_for_a_day(keyed: Keyed) -> None:
    make_drives(keyed.web.sessions, 4)  # the last one failed
    execute(keyed.web.sessions, "UPDATE drives SET owner_id = :a", a=keyed.a.id)
    keep(keyed, 0)
    left = "SELECT status FROM drives WHERE log_deleted_at IS NULL"
    older(keyed, 0.9)
    look(keyed)
    assert rows(keyed.web.sessions, left) == [("failed",)]
    older(keyed, 1.1)
    look(keyed)
    assert rows(keyed.web.sessions, left) == []


def test_a_trial_that_waits_keeps_the_log(anna: Anna) -> None:
    keyed = anna.keyed
    assert keyed.a.own.post(f"/v1/drives/{anna.done}/trials?method=raw").status_code == 202
    keep(keyed, 0)
    look(keyed)
    assert drive_of(keyed, anna.done)["log_deleted_at"] is None
    execute(keyed.web.sessions, "UPDATE drive_trials SET status = 'done'")
    look(keyed)
    assert drive_of(keyed, anna.done)["log_deleted_at"] is not None
    again = keyed.a.own.post(f"/v1/drives/{anna.done}/trials?method=raw")
    assert again.status_code == 200  # what was tried is shown
    keyed.a.own.delete("/v1/owner?name=anna")


def test_whoever_is_cut_off_between_file_and_note_does_it_again(
    anna: Anna, monkeypatch: pytest.MonkeyPatch
) -> None:
    keyed = anna.keyed
    keep(keyed, 0)

    def cut_off(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(retention.store, "note_deleted", cut_off)
        with pytest.raises(KeyboardInterrupt):
            look(keyed)
    assert len(keyed.web.blobs.keys()) == 1
    look(keyed)
    assert drive_of(keyed, anna.done)["log_deleted_at"] is not None


def test_one_whose_deletion_failed_is_swept_as_nobodys(without: Anna) -> None:
    """A bucket that brings a file back, a backup that was put in again."""
    web = without.keyed.web
    with web.sessions() as session:
        key = session.execute(
            text("SELECT blob_key FROM drives WHERE id = :id"), {"id": without.done}
        ).scalar()
    (web.settings.data_dir / "blobs" / str(key)).write_bytes(b"x")
    assert sweep_blobs(web.sessions, web.blobs, timedelta(0)).orphans == (key,)
    assert not BlobStore(web.settings.blob_store_url).exists(str(key))


def test_a_worker_sees_to_it(anna: Anna) -> None:
    keyed = anna.keyed
    keep(keyed, 0)
    run_worker(keyed.web.settings, wait=False)
    look(keyed)  # what became done with the last job
    assert {drive_of(keyed, one)["log_deleted_at"] is None for one in anna.logs} == {False}


@pytest.mark.parametrize("days", [-1, 36_501, "x", 1.5])
def test_what_is_no_number_of_days(keyed: Keyed, days: Any) -> None:
    check(keyed.a.own.client.patch("/v1/owner", json={"keep_logs_days": days}), 422)
    check(keyed.a.own.client.patch("/v1/owner", json={"quota_drives": 5}), 422)


def test_an_operator_sets_it_for_others(keyed: Keyed) -> None:
    path = f"/v1/owners/{keyed.a.id}"
    changed = keyed.operator.client.patch(path, json={"keep_logs_days": 7, "quota_drives": 5}).json()
    assert (changed["keep_logs_days"], changed["quota_drives"]) == (7, 5)
    assert keyed.operator.client.patch(path, json={"quota_drives": None}).json()["keep_logs_days"] == 7
    assert keyed.a.own.get("/v1/owner").json()["logs_kept_days"] == 7
    assert keyed.b.own.get("/v1/owner").json()["keep_logs_days"] is None
