"""One drive into the database while others delete, import, stop and fail."""

from __future__ import annotations

import threading
import time
import uuid
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import psycopg
import pytest
from sqlalchemy import text
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.drives import claims, computing, intake, process, writing
from app.drives.documents import Drive
from app.drives.process import Outcome
from app.jobs.context import JobContext
from app.jobs.requests import run as machine
from app.jobs.task import Interrupted
from app.network import results as slopes
from app.network.locks import give_way, own_network, share_network
from app.roads import imports as road_imports
from app.roads.documents import Wishes
from fusion.pipeline import run_drive
from fusion.profile import levels, noise
from fusion.profile.model import Noise
from fusion.simulate.scene.town import Town
from fusion.types import Progress
from processing_support import carry_out_removals, drive_now, process_drive, remove_drive, state

Send = Callable[..., Drive]


class Disturbed:
    """``run_drive`` with something happening in the middle, the first time only."""

    def __init__(self, disturb: Callable[[], object]) -> None:
        self.disturb = disturb
        self.runs = 0

    def __call__(self, *args: Any, progress: Progress, **kwargs: Any) -> Any:
        self.runs += 1
        if self.runs == 1:
            progress("filter", 0.4)
            self.disturb()
        return run_drive(*args, progress=progress, **kwargs)


def test_a_drive_deleted_while_it_runs_is_discarded(
    context: JobContext, send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = send(0)
    remove = Disturbed(lambda: intake.remove_drive(context.sessions, drive.id))
    monkeypatch.setattr(computing, "run_drive", remove)
    assert process_drive(context, drive.id, 1) is Outcome.DISCARDED
    assert remove.runs == 1
    carry_out_removals(context.sessions, context.blobs)
    assert state(context) == []
    with context.sessions() as session:
        for table in ("drives", "drive_tracks", "provenances", "segment_slopes"):
            assert session.execute(text(f"SELECT count(*) FROM {table}")).scalar_one() == 0


def test_a_drive_deleted_while_its_noise_is_learned_ends_there(
    context: JobContext, send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A long drive is gone through for a minute in that stage alone."""
    drive = send(0, "profile")
    learned = []

    def most_likely(*arguments: Any) -> Noise:
        learned.append(1)
        intake.remove_drive(context.sessions, drive.id)
        return levels.most_likely(*arguments)

    monkeypatch.setattr(machine, "LOOK_EVERY_S", 0.0)
    monkeypatch.setattr(noise, "most_likely", most_likely)
    assert process_drive(context, drive.id, 1) is Outcome.DISCARDED
    assert len(learned) == 1


def test_a_drive_asked_for_anew_while_it_runs_is_discarded(
    context: JobContext, send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = send(0)
    again = Disturbed(lambda: intake.reprocess(context.sessions, drive.id, "dem"))
    monkeypatch.setattr(computing, "run_drive", again)
    assert process_drive(context, drive.id, 1) is Outcome.DISCARDED
    assert drive_now(context, drive.id).status == "queued"
    assert process_drive(context, drive.id, 2) is Outcome.DONE
    assert drive_now(context, drive.id).method == "dem"


def test_roads_imported_while_a_drive_runs_are_the_ones_it_ends_with(
    context: JobContext, send: Send, files: Path, town: Town, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = send(0)
    process_drive(context, drive.id, 1)
    (driven,) = {row[1] for row in state(context)[:1]}
    # The same map with one driven way taken out: its segments' ids are gone when the result is written.
    whole = (files / "town.osm").read_text()
    begin = whole.index(f'<way id="{driven}"')
    end = whole.index("</way>", begin) + len("</way>")
    (tmp_path / "less.osm").write_text(whole[:begin] + whole[end:])
    intake.reprocess(context.sessions, drive.id)
    reimport = Disturbed(
        lambda: road_imports.import_roads(
            context.sessions,
            tmp_path / "less.osm",
            context.dem_dir,
            region="town",
            wishes=Wishes(accept_losses=True),
        )
    )
    monkeypatch.setattr(computing, "run_drive", reimport)
    assert process_drive(context, drive.id, 2) is Outcome.DONE
    assert reimport.runs == 2
    disturbed = state(context)
    assert driven not in {row[1] for row in disturbed}
    intake.reprocess(context.sessions, drive.id)
    process_drive(context, drive.id, 3)
    assert state(context) == disturbed


class Wanted:
    """``give_way`` with somebody who wants the drive's row, from the first look at a run that holds it."""

    def __init__(self, want: Callable[[], object], pool: ThreadPoolExecutor) -> None:
        self._want, self._pool = want, pool
        self.looks = 0
        self.answer: Future[object] | None = None

    def __call__(self, session: Session) -> None:
        self.looks += 1
        if self.looks == 1:
            self.answer = self._pool.submit(self._want)
            waits = text("SELECT count(*) FROM pg_locks WHERE NOT granted")
            while not session.execute(waits).scalar_one():
                time.sleep(0.01)
        give_way(session)


def test_a_removal_does_not_wait_for_a_result_to_be_written(
    context: JobContext, send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive = send(0)
    with ThreadPoolExecutor(1) as pool:
        wanted = Wanted(lambda: intake.remove_drive(context.sessions, drive.id), pool)
        monkeypatch.setattr(writing, "give_way", wanted)
        assert process_drive(context, drive.id, 1) is Outcome.DISCARDED
        assert wanted.answer is not None and wanted.answer.result(10)
    assert wanted.looks == 1
    assert state(context) == []
    carry_out_removals(context.sessions, context.blobs)
    with context.sessions() as session:
        assert session.execute(text("SELECT count(*) FROM drives")).scalar_one() == 0


def test_a_result_gives_way_once(context: JobContext, send: Send, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who wants the row for something else keeps no drive from its end."""
    drive = send(0)

    def rename() -> None:
        with context.sessions.begin() as session:
            session.execute(text("UPDATE drives SET filename = 'other.gpx' WHERE id = :id"), {"id": drive.id})

    with ThreadPoolExecutor(1) as pool:
        wanted = Wanted(rename, pool)
        monkeypatch.setattr(writing, "give_way", wanted)
        assert process_drive(context, drive.id, 1) is Outcome.DONE
        assert wanted.answer is not None
        wanted.answer.result(10)
    assert wanted.looks == 1
    assert state(context) and drive_now(context, drive.id).filename == "other.gpx"


def test_who_waits_for_a_lock_by_name_is_not_let_in(sessions: Sessions) -> None:
    """An import waits for all who share the network: it would never be its turn to be let in."""

    def own() -> None:
        with sessions.begin() as session:
            own_network(session)

    with ThreadPoolExecutor(1) as pool:
        with sessions.begin() as session:
            share_network(session)
            waiting = pool.submit(own)
            while not session.execute(text("SELECT count(*) FROM pg_locks WHERE NOT granted")).scalar_one():
                time.sleep(0.01)
            give_way(session)
        waiting.result(10)


def test_a_worker_that_stops_puts_its_drive_back(context: JobContext, send: Send) -> None:
    drive = send(0)
    with pytest.raises(Interrupted):
        process_drive(context, drive.id, 1, should_stop=lambda: True)
    assert drive_now(context, drive.id).status == "queued"
    assert process_drive(context, drive.id, 1) is Outcome.DONE


def test_a_lost_connection_is_no_failure_of_the_drive(
    context: JobContext, send: Send, monkeypatch: pytest.MonkeyPatch, database_url: str
) -> None:
    def cut() -> None:
        with context.sessions() as session:
            session.execute(
                text("SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid() "
                     "AND datname = current_database()")
            )  # fmt: skip

    drive = send(0)
    genuine = slopes.append_result

    def save(session: Any, *args: Any, **options: Any) -> list[int]:
        cut()
        return genuine(session, *args, **options)

    with monkeypatch.context() as patch:
        patch.setattr(slopes, "append_result", save)
        with pytest.raises(OperationalError) as caught:
            process_drive(context, drive.id, 1)
    assert process.is_connection_loss(caught.value)
    assert drive_now(context, drive.id).status == "running"
    assert state(context) == []
    assert process_drive(context, drive.id, 1) is Outcome.DONE


def test_a_mistake_in_sql_is_no_connection_loss(sessions: Sessions) -> None:
    with pytest.raises(Exception, match="nonsense") as caught, sessions() as session:
        session.execute(text("SELECT nonsense"))
    assert not process.is_connection_loss(caught.value)
    assert not process.is_connection_loss(psycopg.DataError())


def test_progress_grows_and_is_written_at_intervals(
    context: JobContext, send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[str, float]] = []
    genuine = claims.set_progress

    def note(session: Any, drive_id: uuid.UUID, generation: int, stage: str, progress: float) -> bool:
        seen.append((stage, progress))
        return genuine(session, drive_id, generation, stage, progress)

    monkeypatch.setattr(claims, "set_progress", note)
    process_drive(context, send(0, "particle", {"particles": 300}).id, 1)
    throttled = list(seen)
    seen.clear()
    monkeypatch.setattr(machine, "LOOK_EVERY_S", 0.0)
    process_drive(context, send(1, "particle", {"particles": 300}).id, 1)
    assert len(seen) > 20
    assert len(throttled) < len(seen)
    shares = [share for _, share in seen]
    assert shares == sorted(shares)
    assert 0 <= shares[0] <= shares[-1] <= 1
    assert len({stage for stage, _ in seen}) >= 3


def test_two_drives_of_the_same_roads_at_once(context: JobContext, send: Send, files: Path) -> None:
    made = [send(seed, "raw") for seed in range(3)]
    start = threading.Barrier(3)

    def run(drive: Drive) -> Outcome:
        start.wait()
        return process_drive(context, drive.id, 1)

    with ThreadPoolExecutor(3) as pool:
        assert set(pool.map(run, made)) == {Outcome.DONE}
    at_once = state(context)
    for drive in made:
        assert remove_drive(context.sessions, context.blobs, drive.id)
    assert state(context) == []
    for seed in (2, 0, 1):
        process_drive(context, send(seed, "raw").id, 1)
    assert state(context) == at_once
