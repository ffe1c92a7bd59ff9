"""The drives of a batch in a service are those that uploads of its logs would have made."""

from __future__ import annotations

import gzip
import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import text
from typer.testing import CliRunner, Result

from app.access.store import create_owner
from app.batch import archive as archive_module
from app.batch.archive import Archive
from app.batch.bringing import (
    OTHER_CODE,
    OTHER_GROUND,
    OTHER_LAG,
    OTHER_ROADS,
    Asked,
    Brought,
    bring,
    take_back,
)
from app.batch.folder import BatchError, BatchFolder
from app.batch.run import Request, run
from app.cli import app
from app.core.db import Sessions
from app.drives import process, publishing, writing
from app.drives import store as drives
from app.drives.batches import importing
from app.drives.documents import Drive
from app.drives.queue import drives_wait
from app.jobs.context import JobContext
from fusion.pipeline import parse_options
from fusion.types import Progress, no_progress
from processing_support import (
    accept_upload,
    carry_out_removals,
    publish_all,
    remove_drive,
    state,
)


class Unseen:
    """Nobody looks."""

    def work(self, name: str) -> Progress:
        return no_progress

    def count(self, name: str, total: int) -> Callable[[int], None]:
        return lambda more: None


class Here:
    """Work is done in this process, one piece after the other."""

    count = 1

    def __init__(self, executor: Executor) -> None:
        self.executor = executor

    def done(self, jobs: Sequence[Any]) -> Iterator[Any]:
        for job in jobs:
            job.work()
            yield job

    def results(
        self, items: Sequence[Any], call: Callable[[Any], tuple[Any, ...]]
    ) -> Iterator[tuple[Any, Any]]:
        for item in items:
            function, *arguments = call(item)
            yield item, function(*arguments)


@pytest.fixture(scope="module")
def made(files: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A batch in ``out`` of four logs in ``logs``: two as they are, one gzipped, and one that is broken."""
    place = tmp_path_factory.mktemp("batch")
    logs = place / "logs"
    logs.mkdir()
    for name in ("0.csv", "1.csv"):
        shutil.copy(files / name, logs)
    (logs / "2.csv.gz").write_bytes(gzip.compress((files / "2.csv").read_bytes(), mtime=0))
    (logs / "broken.csv").write_text("time_s,speed_mps\n1,2\n")
    asked = Request(
        logs=(str(logs),),
        roads=files / "town.osm",
        rasters=(files / "town.tif",),
        method="profile",
        options=parse_options("profile").model_dump(mode="json"),
        control=None,
        gaps=False,
        formats=("csv",),
    )
    with ThreadPoolExecutor(1) as executor:
        run(asked, BatchFolder(place / "out"), Here(executor), Unseen())  # type: ignore[arg-type]
    return place


@pytest.fixture
def archive(made: Path) -> Archive:
    return Archive.read(BatchFolder(made / "out"))


def brought(context: JobContext, archive: Archive, **asked: Any) -> Brought:
    """Bring them in and publish them."""
    found = bring(context, archive, Asked(**asked), Unseen())
    publish_all(context.sessions, context.blobs)
    return found


def listed(sessions: Sessions) -> list[Drive]:
    with sessions() as session:
        return sorted(drives.list_drives(session), key=lambda one: one.filename)


OF_EACH = {"id", "created_at", "queued_at", "started_at", "finished_at", "report", "links"}
"""Members of a drive's document that differ between two that are the same, or are compared by themselves."""


def documents(sessions: Sessions) -> list[dict[str, Any]]:
    return [one.model_dump(mode="json", exclude=OF_EACH) for one in listed(sessions)]


def assert_same(found: Sequence[tuple[Any, ...]], wanted: Sequence[tuple[Any, ...]]) -> None:
    """Two ``state``s: slopes to a millionth of a sigma."""
    assert [(*row[:4], *row[6:8], *row[9:]) for row in found] == [
        (*row[:4], *row[6:8], *row[9:]) for row in wanted
    ]
    numbers = [np.array([[row[k] for k in (4, 5, 8)] for row in rows], float) for rows in (found, wanted)]
    sigma = numbers[1][:, 1:2]
    assert np.max(np.abs(numbers[0] - numbers[1]) / sigma) < 1e-6


def test_they_are_what_uploads_would_have_made(context: JobContext, archive: Archive, made: Path) -> None:
    """And removing the import leaves no trace: the same logs are uploaded into the same service then."""
    found = brought(context, archive)
    assert (found.as_computed, found.there, found.failed, found.left_out) == (3, 0, 1, {})
    assert not found.to_compute
    slopes, told, reports = (
        state(context),
        documents(context.sessions),
        [d.report for d in listed(context.sessions)],
    )
    assert [one["status"] for one in told] == ["done"] * 3
    assert len(slopes) > 10
    tracks = profile_bytes(context)

    assert take_back(context, archive) == 3
    carry_out_removals(context.sessions, context.blobs)
    assert not state(context)
    assert not listed(context.sessions)
    assert not context.blobs.keys()

    for path in sorted((made / "logs").iterdir()):
        if path.name != "broken.csv":
            one, _ = accept_upload(
                context.sessions, context.blobs, [path.read_bytes()], filename=path.name, method="profile"
            )
            process.process_drive(context, one.id, one.generation)
    publish_all(context.sessions, context.blobs)
    assert_same(slopes, state(context))
    assert told == documents(context.sessions)
    for mine, theirs in zip(reports, (d.report for d in listed(context.sessions)), strict=True):
        assert mine == theirs
    assert tracks == profile_bytes(context)


def profile_bytes(context: JobContext) -> list[tuple[Any, ...]]:
    """Tracks and what sensors said, by log."""
    query = text(
        "SELECT sha256, track, measurements FROM drive_tracks JOIN drives ON id = drive_id ORDER BY sha256"
    )
    with context.sessions() as session:
        return [tuple(row) for row in session.execute(query)]


def test_twice_and_cut_off(context: JobContext, archive: Archive, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is there stays, what is missing comes; one that was removed is brought again, by the same import."""
    real, calls = importing.note_imported, list[Any]()

    def cut(*arguments: Any) -> None:
        calls.append(arguments)
        if len(calls) == 2:
            raise KeyboardInterrupt
        real(*arguments)

    monkeypatch.setattr(importing, "note_imported", cut)
    with pytest.raises(KeyboardInterrupt):
        bring(context, archive, Asked(), Unseen())
    monkeypatch.undo()
    publish_all(context.sessions, context.blobs)
    first = listed(context.sessions)
    assert [one.status for one in first] == ["done"]

    found = brought(context, archive)
    assert (found.as_computed, found.there) == (2, 1)
    again = brought(context, archive)
    assert (again.as_computed, again.there, again.number) == (0, 3, None)
    assert {one.status for one in listed(context.sessions)} == {"done"}
    assert {one.blob_key for one in listed(context.sessions)} <= {*context.blobs.keys()}

    whole = state(context)
    assert remove_drive(context.sessions, context.blobs, first[0].id)
    assert {row[0] for row in state(context)} == {row[0] for row in whole} - {first[0].sha256}
    third = brought(context, archive)
    assert (third.as_computed, third.there, third.number) == (1, 2, found.number)
    assert_same(state(context), whole)


def test_what_was_uploaded_stays(context: JobContext, archive: Archive, made: Path) -> None:
    """The same content in other packing is the drive that it is; taking the import back leaves it."""
    packed = gzip.compress((made / "logs" / "0.csv").read_bytes(), mtime=0)
    one, _ = accept_upload(context.sessions, context.blobs, [packed], filename="mine", method="raw")
    found = brought(context, archive)
    assert (found.as_computed, found.there) == (2, 1)
    take_back(context, archive)
    carry_out_removals(context.sessions, context.blobs)
    assert [each.id for each in listed(context.sessions)] == [one.id]


@pytest.mark.parametrize("other", [OTHER_CODE, OTHER_ROADS, OTHER_GROUND, OTHER_LAG])
def test_what_rests_on_something_else_is_computed(
    context: JobContext, archive: Archive, files: Path, monkeypatch: pytest.MonkeyPatch, other: str
) -> None:
    """Behind uploads, by the ordinary way."""
    if other == OTHER_CODE:
        monkeypatch.setattr("app.batch.bringing.code_version", lambda: "another")
    elif other == OTHER_ROADS:
        with context.sessions.begin() as session:
            session.execute(text("UPDATE segments SET oneway = -oneway"))
    elif other == OTHER_GROUND:
        with context.sessions.begin() as session:
            session.execute(text("UPDATE dem_versions SET active = false"))
    else:
        read = archive_module.read_kept
        monkeypatch.setattr(
            archive_module, "read_kept", lambda *of: (replace(one, lag_s=0.0) for one in read(*of))
        )
        monkeypatch.setattr("app.batch.bringing.lag_among_all", lambda *_: 4.0)
    assert bring(context, archive, Asked(dry_run=True), Unseen()).to_compute == {other: 3}
    assert not listed(context.sessions)
    found = brought(context, archive)
    assert (found.as_computed, dict(found.to_compute)) == (0, {other: 3})
    assert {one.status for one in listed(context.sessions)} == {"queued"}
    with context.sessions() as session:
        assert drives_wait(session, behind=True)
        assert not drives_wait(session, behind=False)


def test_roads_that_change_meanwhile_are_seen(
    context: JobContext, archive: Archive, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As workers see it: the drive is there, and waits for one of them."""
    monkeypatch.setattr(writing, "road_states", lambda *_: {})
    assert dict(brought(context, archive).to_compute) == {OTHER_ROADS: 3}
    assert {one.status for one in listed(context.sessions)} == {"queued"}


def test_logs_that_are_not_reached_are_told_first(context: JobContext, made: Path, tmp_path: Path) -> None:
    """Without them drives keep what they say, and cannot be computed again; other bytes are not the batch's."""
    shutil.copytree(made / "out", tmp_path / "out")
    hidden = made / "hidden"
    (made / "logs").rename(hidden)
    archive = Archive.read(BatchFolder(tmp_path / "out"))
    try:
        with pytest.raises(BatchError, match="3 of 3 logs are not where the batch read them"):
            bring(context, archive, Asked(), Unseen())
        assert not listed(context.sessions)
        (made / "logs").mkdir()
        (made / "logs" / "0.csv").write_text("other bytes")
        found = brought(context, archive, without_logs=True)
    finally:
        shutil.rmtree(made / "logs", ignore_errors=True)
        hidden.rename(made / "logs")
    assert (found.as_computed, found.without_log) == (2, 2)
    assert [name.rsplit("/", 1)[-1] for name in found.left_out] == ["0.csv"]
    assert all(one.log_deleted_at is not None and one.status == "done" for one in listed(context.sessions))
    assert not context.blobs.keys()


def test_solvers_wait_while_drives_come(context: JobContext) -> None:
    """One import at a time, which counts as drives that wait."""
    with importing.import_claim(context.sessions) as claim:
        assert claim.take()
        with context.sessions() as session:
            assert drives_wait(session, behind=True)
            assert publishing.patience_s(session, 5.0, behind=True) >= 5.0
    with context.sessions() as session:
        assert not drives_wait(session, behind=True)


def test_the_command_brings_them_in_for_an_owner(
    context: JobContext, database_url: str, made: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("VERSANT_DATABASE_URL", database_url)
    monkeypatch.setenv("VERSANT_DATA_DIR", str(context.settings.data_dir))
    with context.sessions.begin() as session:
        fleet = create_owner(session, "fleet")

    def invoke(*arguments: str | Path, status: int = 0) -> Result:
        found = CliRunner().invoke(app, ["import-batch", *map(str, arguments)])
        assert found.exit_code == status, found.output
        return found

    out, figures = made / "out", tmp_path / "figures.json"
    assert "There is no owner nobody" in invoke(out, "--owner", "nobody", status=1).stderr
    assert "holds no batch" in invoke(tmp_path, "--owner", "fleet", status=1).stderr
    assert "3 drives would come in" in invoke(out, "--owner", "fleet", "--dry-run").stdout
    said = invoke(out, "--owner", "fleet", "--json", figures).stdout
    assert "3 drives came in as the batch computed them" in said
    told = json.loads(figures.read_text())
    assert (told["as_computed"], told["there"], told["failed"]) == (3, 0, 1)
    with context.sessions() as session:
        owners = session.execute(text("SELECT owner_id, import_id FROM drives")).all()
        audited = session.execute(text("SELECT owner_id, action, subject FROM audit_log")).all()
    assert {tuple(row) for row in owners} == {(fleet.id, told["number"])}
    assert [tuple(row) for row in audited] == [(fleet.id, "drives imported", f"import {told['number']}")]
    assert "3 drives are removed" in invoke(out, "--owner", "fleet", "--undo").stdout
    assert not listed(context.sessions)
