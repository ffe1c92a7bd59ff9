"""Drives with factors from upload to map, and the same logs without a service."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.cli.logs.fusing import Fusion
from app.core.db import Sessions
from app.drives import intake, process, queue
from app.drives.documents import Drive
from app.drives.process import Outcome
from app.jobs.context import JobContext
from app.map import store as segments
from app.network import extracts as roads
from app.network import swap
from app.network.settle import settle_network
from fusion.formats import read_log
from fusion.pipeline import parse_options, run_drive
from fusion.report import with_contradiction
from fusion.roads.osm import read_roads
from fusion.roads.table import rows_of as table_rows
from fusion.terrain.dem import Dem
from network_support import Rows, assert_same, rows_of
from processing_support import drive_now, process_drive, remove_drive

Send = Callable[..., Drive]
Key = tuple[int, int, int]


def done(context: JobContext, send: Send, log: int, method: str = "profile") -> Drive:
    drive = send(log, method)
    assert process_drive(context, drive.id, drive.generation) is Outcome.DONE
    return drive


def fused(files: Path, logs: list[int], method: str) -> dict[Key, tuple[float, float, int, int]]:
    """What ``versant fuse --gaps`` makes of the logs."""
    with Dem.open([files / "town.tif"]) as dem:
        fusion = Fusion(method, parse_options(method), read_roads(files / "town.osm"), dem)
        for log in logs:
            fusion.add(files / f"{log}.csv")
        return {
            (f.osm_way_id, f.from_node, f.to_node): (
                float(f.slope_percent or 0), float(f.slope_sigma_percent or 0), f.drives, f.observations
            )
            for f in fusion.features(gaps=True)
        }  # fmt: skip


def served(context: JobContext) -> dict[Key, tuple[float, float, int, int]]:
    """What the service publishes, gaps included."""
    with context.sessions() as session:
        return {
            (row.osm_way_id, row.from_node, row.to_node): (
                row.slope_percent, row.slope_sigma_percent or 0, row.drives, row.observations
            )
            for row in segments.all_segments(session, gaps=True)
            if row.slope_percent is not None
        }  # fmt: skip


def numbered(found: dict[Key, tuple[float, float, int, int]]) -> Rows:
    return {hash(key): values for key, values in found.items()}


@pytest.mark.parametrize("method", ["profile", "raw"])
def test_one_log_gives_the_same_numbers_with_and_without_a_service(
    context: JobContext, send: Send, files: Path, method: str
) -> None:
    done(context, send, 0, method)
    expected = fused(files, [0], method)
    found = served(context)
    assert len(found) > 10
    assert found.keys() == expected.keys()
    for key, values in expected.items():
        assert found[key] == pytest.approx(values, rel=1e-6, abs=1e-6)


def test_several_logs_give_the_same_numbers_but_for_what_windows_leave(
    context: JobContext, send: Send, files: Path
) -> None:
    for log in (2, 0, 1):
        done(context, send, log)
    found = served(context)
    assert max(row[2] for row in found.values()) >= 2
    assert_same(numbered(found), numbered(fused(files, [0, 1, 2], "profile")))
    settle_network(context.sessions)
    assert_same(numbered(found), numbered(served(context)))


def test_a_drive_shows_its_own_estimate_beside_the_networks(
    context: JobContext, send: Send, files: Path
) -> None:
    drive = done(context, send, 0)
    report = drive_now(context, drive.id).report
    assert report is not None
    assert (report["method"], report["rejected_segments"]) == ("profile", 0)
    with context.sessions() as session:
        own = segments.drive_segment_rows(session, drive.id)
        table, ids = roads.all_roads(session)
    with Dem.open([files / "town.tif"]) as dem:
        network, result = run_drive(read_log(files / "0.csv"), table, dem, method="profile")
    rows = ids[table_rows(table, network.table)]
    assert {row.segment.id: row.slope_percent for row in own} == {
        int(rows[s.segment]): s.slope_percent for s in result.slopes
    }
    assert all(row.in_network and row.accepted and row.segment.drives == 1 for row in own)


def test_another_method_takes_the_factors_back(context: JobContext, send: Send) -> None:
    one, two = done(context, send, 0), done(context, send, 1)
    both = rows_of(context.sessions)
    intake.reprocess(context.sessions, one.id, "raw")
    assert process_drive(context, one.id, 2) is Outcome.DONE
    with context.sessions() as session:
        left = session.execute(text("SELECT DISTINCT drive_id FROM drive_passes")).scalars().all()
    assert left == [two.id]
    assert rows_of(context.sessions) != both
    intake.reprocess(context.sessions, one.id, "profile")
    assert process_drive(context, one.id, 3) is Outcome.DONE
    assert_same(both, rows_of(context.sessions))


def test_workers_at_once_end_where_one_after_the_other_does(context: JobContext, send: Send) -> None:
    made = [send(log, "profile") for log in range(3)]
    with ThreadPoolExecutor(3) as pool:
        assert set(pool.map(lambda drive: process_drive(context, drive.id, 1), made)) == {Outcome.DONE}
    at_once = rows_of(context.sessions)
    for drive in made:
        assert remove_drive(context.sessions, context.blobs, drive.id)
    assert rows_of(context.sessions) == {}
    for log in (1, 2, 0):
        done(context, send, log)
    assert_same(at_once, rows_of(context.sessions))


@pytest.mark.parametrize(("module", "last"), [(queue, "enqueue_solve"), (swap, "delete_marks")])
def test_a_killed_transaction_leaves_nothing_and_the_next_run_all(
    context: JobContext,
    send: Send,
    sessions: Sessions,
    monkeypatch: pytest.MonkeyPatch,
    module: object,
    last: str,
) -> None:
    """The server process dies when all that the drive says is written, or all that was solved."""
    done(context, send, 1)
    before = rows_of(sessions), rows_of(sessions, "network_slopes")
    drive = send(0, "profile")

    def die(session: Session, *_: object) -> None:
        session.execute(text("SELECT pg_terminate_backend(pg_backend_pid())"))

    with monkeypatch.context() as patch:
        patch.setattr(module, last, die)
        with pytest.raises(Exception, match="terminat") as caught:
            process_drive(context, drive.id, 1)
    assert process.is_connection_loss(caught.value)
    assert (rows_of(sessions), rows_of(sessions, "network_slopes")) == before
    with sessions() as session:
        assert bool(segments.drive_segment_rows(session, drive.id)) == (last == "delete_marks")
    process_drive(context, drive.id, 1)
    assert drive_now(context, drive.id).status == "done"
    assert rows_of(sessions) != before[0]


@pytest.mark.parametrize(("rejected", "warned"), [(0, False), (3, False), (4, True), (9, True)])
def test_a_drive_that_contradicts_the_others_on_a_third_is_warned(rejected: int, warned: bool) -> None:
    said = with_contradiction(["one"], rejected, 9)
    assert said[0] == "one"
    assert (len(said) == 2) == warned
    if warned:
        assert f"contradicts other drives on {rejected} of 9 segments ({rejected / 9:.0%})" in said[1]
    assert with_contradiction(said, rejected, 9) == said, "what an earlier look said is not said twice"
    assert with_contradiction(said, 0, 9) == ["one"]
