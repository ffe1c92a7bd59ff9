"""Drives whose roads change: what holds is carried over, what does not is computed again by itself."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import text

from app.core.db import Sessions
from app.drives import computing, intake, process, publishing
from app.drives import store as drives
from app.drives.batches.documents import Selection, Which
from app.drives.batches.store import batch_progress, count_selected
from app.drives.batches.touched import queue_touched
from app.drives.documents import Drive
from app.drives.process import Outcome
from app.jobs.context import JobContext
from app.network.extracts import all_roads
from app.network.settle import settle_network
from app.roads import retired
from app.roads.documents import ImportCounts
from fusion.roads.table import RoadTable
from network_support import assert_same, rows_of
from processing_support import process_drive, remove_drive
from region_support import bring, ids_of, moved

Send = Callable[..., Drive]
Chain = Callable[..., RoadTable]


def roads_of(context: JobContext) -> RoadTable:
    with context.sessions() as session:
        return all_roads(session)[0]


def driven_nodes(context: JobContext, every: int) -> list[int]:
    """Each so-and-so-many-th node between driven segments."""
    query = text(
        "SELECT DISTINCT from_node FROM segments WHERE id IN (SELECT segment_id FROM drive_passes) ORDER BY 1"
    )
    with context.sessions() as session:
        return list(session.execute(query).scalars())[::every]


def brought(context: JobContext, table: RoadTable, region: str, **more: bool) -> ImportCounts:
    return bring(context.sessions, table, region, dem_dir=context.dem_dir, **more)


def drive_now(context: JobContext, drive_id: uuid.UUID) -> Drive:
    with context.sessions() as session:
        drive = drives.get_drive(session, drive_id)
    assert drive is not None
    return drive


def count(sessions: Sessions, what: str) -> int:
    with sessions() as session:
        return int(session.execute(text(f"SELECT count(*) FROM {what}")).scalar_one())


def generation(context: JobContext, drive_id: uuid.UUID) -> int:
    return drive_now(context, drive_id).generation


def test_slopes_on_nodes_that_moved_a_little_are_as_if_driven_again(context: JobContext, send: Send) -> None:
    for log in (0, 1):
        process_drive(context, send(log, "profile").id, 1)
    before, nodes = rows_of(context.sessions), driven_nodes(context, 4)
    other = moved(roads_of(context), nodes, 0.9, -0.8)
    counts = brought(context, other, "town", yes=False)
    assert counts.moved >= len(nodes)
    assert (counts.measured_lost, counts.drives_again) == (0, 0)
    assert queue_touched(context.sessions) == 0
    carried = rows_of(context.sessions)
    assert carried.keys() == before.keys()
    settle_network(context.sessions)
    carried = rows_of(context.sessions)
    with context.sessions() as session:
        ids = session.execute(text("SELECT id FROM drives")).scalars().all()
    for drive in ids:
        intake.reprocess(context.sessions, drive)
        process_drive(context, drive, 2)
    settle_network(context.sessions)
    again = rows_of(context.sessions)
    off = np.array([(carried[k][0] - again[k][0]) / again[k][1] for k in carried.keys() & again.keys()])
    assert len(off) > 0.95 * len(carried)
    assert np.quantile(np.abs(off), 0.95) < 0.1


def test_drives_on_roads_that_went_elsewhere_are_queued_behind_uploads(
    context: JobContext, send: Send
) -> None:
    drive = send(0, "profile")
    process_drive(context, drive.id, 1)
    table = roads_of(context)
    other = moved(table, driven_nodes(context, 12)[:2], 12.0)
    counts = brought(context, other, "town")
    assert counts.far >= 2
    assert counts.measured_lost >= 2
    assert counts.drives_again == 1
    assert queue_touched(context.sessions) == 1
    assert queue_touched(context.sessions) == 0
    waiting = drive_now(context, drive.id)
    assert (waiting.status, waiting.generation) == ("queued", 2)
    with context.sessions() as session:
        batch = session.execute(text("SELECT max(id) FROM batches")).scalar_one()
        progress = batch_progress(session, batch)
        priority = session.execute(text("SELECT min(priority) FROM procrastinate_jobs")).scalar_one()
    assert progress is not None
    assert (progress.selection, progress.queued, priority) == ({"which": "roads"}, 1, -100)
    assert process_drive(context, drive.id, 2) is Outcome.DONE
    settle_network(context.sessions)
    found = rows_of(context.sessions)
    brought(context, table, "town")  # back where they lay, but it was computed anew since
    assert queue_touched(context.sessions) == 1
    assert process_drive(context, drive.id, 3) is Outcome.DONE
    assert set(rows_of(context.sessions)) == set(found)


def test_what_a_mistaken_import_took_is_back_at_once_with_the_right_one(
    context: JobContext, send: Send, chain: Chain
) -> None:
    drive = send(0, "profile")
    process_drive(context, drive.id, 1)
    settle_network(context.sessions)
    table, before, passes = (
        roads_of(context),
        rows_of(context.sessions),
        count(context.sessions, "drive_passes"),
    )
    ids = ids_of(context.sessions, table)
    assert brought(context, chain(3, lon=20.0), "town").measured_lost == len(before)
    assert (count(context.sessions, "drive_passes"), count(context.sessions, "retired_passes")) == (0, passes)
    assert drive_now(context, drive.id).status == "done"
    counts = brought(context, table, "town")
    assert counts.restored >= len({*before}) - 2  # but for gaps, which nobody drove
    assert np.array_equal(
        ids[np.isin(ids, list(before))], ids_of(context.sessions, table)[np.isin(ids, list(before))]
    )
    settle_network(context.sessions)
    assert_same(before, rows_of(context.sessions))
    assert (count(context.sessions, "drive_passes"), count(context.sessions, "retired_passes")) == (passes, 0)


def test_what_is_kept_goes_with_its_time_and_with_its_drive(
    context: JobContext, send: Send, chain: Chain
) -> None:
    first, second = send(0, "profile"), send(1, "profile")
    for drive in (first, second):
        process_drive(context, drive.id, 1)
    table = roads_of(context)
    brought(context, chain(3, lon=20.0), "town")
    assert retired.prune(context.sessions, 1.0) == 0
    remove_drive(context.sessions, context.blobs, first.id)
    with context.sessions() as session:
        kept = set(session.execute(text("SELECT DISTINCT drive_id FROM retired_passes")).scalars())
    assert kept == {second.id}
    with context.sessions.begin() as session:
        session.execute(text("UPDATE retired_segments SET retired_at = retired_at - interval '30 hours'"))
    assert retired.prune(context.sessions, 1.0) > 0
    assert count(context.sessions, "retired_passes") == 0
    assert brought(context, table, "town").restored == 0
    assert queue_touched(context.sessions) == 1  # whose roads had gone, by what the import before noted
    assert process_drive(context, second.id, 2) is Outcome.DONE


def test_drives_that_found_no_roads_are_computed_when_these_come(
    sessions: Sessions, files: Path, chain: Chain, context: JobContext, send: Send
) -> None:
    table = roads_of(context)
    brought(context, chain(3, lon=20.0), "town")
    drive = send(0, "raw")
    assert process_drive(context, drive.id, 1) is Outcome.FAILED
    assert drive_now(context, drive.id).failure is not None
    assert brought(context, chain(3, lon=21.0, way=9), "elsewhere").drives_again == 0
    assert brought(context, table, "here", dry_run=True).drives_again == 1
    assert brought(context, table, "here").drives_again == 1
    assert queue_touched(sessions) == 1
    assert process_drive(context, drive.id, 2) is Outcome.DONE


def test_an_import_elsewhere_does_not_repeat_a_drive(
    context: JobContext, send: Send, chain: Chain, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive, genuine, runs = send(0), computing.run_drive, []

    def run(*args: object, **options: object) -> object:
        runs.append(brought(context, chain(3, lon=20.0 + len(runs)), "elsewhere").added)
        return genuine(*args, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(computing, "run_drive", run)
    assert process_drive(context, drive.id, 1) is Outcome.DONE
    assert runs == [3]


def test_stale_drives_are_those_whose_own_roads_changed(
    context: JobContext, send: Send, chain: Chain
) -> None:
    def stale(**more: str) -> int:
        with context.sessions() as session:
            return count_selected(session, Selection(which=Which.STALE, **more), None)

    drive = send(0, "profile")
    process_drive(context, drive.id, 1)
    table = roads_of(context)
    brought(context, chain(3, lon=20.0), "elsewhere")
    brought(context, moved(table, driven_nodes(context, 4), 1.0), "town")
    assert stale() == 0
    assert [stale(region=name) for name in ("town", "elsewhere")] == [0, 0]
    brought(context, moved(table, driven_nodes(context, 12)[:1], 9.0), "town")
    assert [stale(), stale(region="town"), stale(region="elsewhere")] == [1, 1, 0]
    queue_touched(context.sessions)
    process_drive(context, drive.id, 2)
    assert stale() == 0


def test_drives_beside_an_import_end_on_the_roads_that_stand(context: JobContext, send: Send) -> None:
    """Whatever of the two is first, step by step: what no longer holds is computed again, nothing is lost."""
    first = send(0, "profile")
    process_drive(context, first.id, 1)
    nodes, table = driven_nodes(context, 3), roads_of(context)
    others = [moved(moved(table, nodes[::2], 1.0 + k), nodes[1::4], 10.0 + 5 * k) for k in range(3)]
    second = send(1, "profile")
    with ThreadPoolExecutor(2) as pool:
        imports = pool.submit(lambda: [brought(context, one, "town") for one in others])
        beside = pool.submit(process.process_drive, context, second.id, 1)
        assert beside.result(60) is Outcome.DONE
        imports.result(60)
    publishing.finish(context.sessions, context.blobs)
    queue_touched(context.sessions)
    for drive in (first, second):
        if drive_now(context, drive.id).status == "queued":
            assert process_drive(context, drive.id, generation(context, drive.id)) is Outcome.DONE
    assert count(context.sessions, "touched_drives") == 0
    settle_network(context.sessions)
    found = rows_of(context.sessions)
    for drive in (first, second):
        intake.reprocess(context.sessions, drive.id)
        process_drive(context, drive.id, generation(context, drive.id))
    settle_network(context.sessions)
    again = rows_of(context.sessions)
    common = found.keys() & again.keys()
    assert len(common) > 0.95 * max(len(found), len(again))
    off = np.array([(found[k][0] - again[k][0]) / again[k][1] for k in common])
    assert np.quantile(np.abs(off), 0.95) < 0.15
