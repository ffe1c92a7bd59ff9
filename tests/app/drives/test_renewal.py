"""What an update leaves to be done: drives computed again, heights filled in, remains cleared away."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from sqlalchemy import text

from app.core.db import Sessions
from app.drives import intake
from app.drives.batches.enqueuing import give_jobs
from app.drives.batches.store import batch_progress
from app.drives.documents import Drive
from app.drives.process import Outcome
from app.drives.worker import HeightFiller, clear_remains, renew
from app.jobs.context import JobContext
from network_support import rows_of
from processing_support import drive_now, process_drive, publish_all

Send = Callable[..., Drive]

# What the migration does to a database of the former model.
_AS_MIGRATED = """
    UPDATE drives SET status = 'queued', progress = 0, generation = generation + 1, queued_at = now();
    DELETE FROM network_slopes; DELETE FROM drive_passes; UPDATE segments SET dem_heights_m = NULL;
"""


def heights(sessions: Sessions) -> list[list[float] | None]:
    """Of the segments that lie on the raster with both ends."""
    query = "SELECT dem_heights_m FROM segments WHERE dem_slope_percent IS NOT NULL ORDER BY id"
    with sessions() as session:
        return list(session.execute(text(query)).scalars())


@pytest.fixture
def migrated(context: JobContext, send: Send) -> list[Drive]:
    """Two drives that are to be computed again."""
    made = [send(log, "profile") for log in (0, 1)]
    for drive in made:
        assert process_drive(context, drive.id, drive.generation) is Outcome.DONE
    with context.sessions.begin() as session:
        session.execute(text("DELETE FROM procrastinate_jobs"))
        for statement in _AS_MIGRATED.split(";")[:-1]:
            session.execute(text(statement))
    return made


def test_drives_of_a_former_model_are_computed_again_and_shown_meanwhile(
    context: JobContext, migrated: list[Drive], sessions: Sessions
) -> None:
    before = {i: row for i, row in rows_of(sessions).items() if row[2]}
    with sessions() as session:
        under_way = batch_progress(session)
    assert (under_way.drives, under_way.queued, under_way.progress) == (2, 2, 0.0)
    renew(sessions)
    assert rows_of(sessions) == before
    query = text(
        "SELECT args->>'drive_id', priority < 0 FROM procrastinate_jobs WHERE status = 'todo' ORDER BY id"
    )
    with sessions() as session:
        assert [tuple(row) for row in session.execute(query)] == [(str(d.id), True) for d in migrated]
    assert give_jobs(sessions) == 0
    for number, drive in enumerate(migrated):
        assert process_drive(context, drive.id, drive.generation + 1) is Outcome.DONE
        with sessions() as session:
            assert batch_progress(session).done == (1 if number == 0 else 0)
    assert {drive_now(context, drive.id).status for drive in migrated} == {"done"}
    after = {i: row for i, row in rows_of(sessions).items() if row[2]}
    assert after.keys() == before.keys()
    assert [after[i] for i in after] == [pytest.approx(before[i], rel=0.1, abs=0.1) for i in after]


def test_heights_are_filled_in_piece_by_piece(
    context: JobContext, sessions: Sessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = heights(sessions)
    assert all(one is not None and np.isfinite(one).all() for one in wanted)
    with sessions.begin() as session:
        session.execute(text("UPDATE segments SET dem_heights_m = NULL WHERE id % 3 > 0"))
    filler = HeightFiller(sessions, context.dem_dir)
    assert [filler.piece(), filler.piece()] == [True, False]
    assert heights(sessions) == wanted
    monkeypatch.setattr("app.terrain.heights.SEGMENTS_PER_FILL", 50)
    with sessions.begin() as session:
        session.execute(text("UPDATE segments SET dem_heights_m = NULL"))
    left = [len(wanted)]
    while filler.piece():
        left.append(heights(sessions).count(None))
        assert left[-2] - left[-1] == min(50, left[-2])
    assert heights(sessions) == wanted
    assert filler.piece() is False


def test_a_drive_does_not_wait_for_the_heights_of_the_whole_map(
    context: JobContext, send: Send, sessions: Sessions
) -> None:
    """Its own roads are filled in before it is solved: what is published of it is as if all were."""
    drive = send(0, "profile")
    assert process_drive(context, drive.id, drive.generation) is Outcome.DONE
    wanted, all_heights = rows_of(sessions), heights(sessions)
    with sessions.begin() as session:
        session.execute(text("UPDATE segments SET dem_heights_m = NULL"))
    intake.reprocess(sessions, drive.id, "profile")
    assert process_drive(context, drive.id, drive.generation + 1) is Outcome.DONE
    assert 0 < heights(sessions).count(None) < len(all_heights)
    assert rows_of(sessions).keys() == wanted.keys()
    assert [rows_of(sessions)[i] for i in wanted] == [pytest.approx(wanted[i], rel=1e-9) for i in wanted]
    query = text(
        "SELECT count(*) FROM network_slopes JOIN segments ON id = segment_id "
        "WHERE dem_slope_percent IS NOT NULL AND dem_heights_m IS NULL"
    )
    with sessions() as session:
        assert session.execute(query).scalar_one() == 0


def test_what_no_drive_says_again_goes_when_all_are_done(
    context: JobContext, migrated: list[Drive], sessions: Sessions
) -> None:
    one, other = migrated
    clear_remains(sessions)  # gaps, which no drive says
    publish_all(sessions, context.blobs)
    assert clear_remains(sessions) == 0
    context.blobs.delete(other.blob_key)
    assert process_drive(context, one.id, one.generation + 1) is Outcome.DONE
    assert process_drive(context, other.id, other.generation + 1) is Outcome.FAILED
    stale = rows_of(sessions).keys() - rows_of(sessions, "network_slopes").keys()
    assert stale
    assert clear_remains(sessions) == len(stale)
    publish_all(sessions, context.blobs)
    assert rows_of(sessions).keys() == rows_of(sessions, "network_slopes").keys()
    assert clear_remains(sessions) == 0
