"""One drive through the library and into the database, undisturbed."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.core.db import Sessions
from app.core.settings import Settings
from app.drives import computing, intake, tracks
from app.drives.documents import Drive
from app.drives.log_facts import drive_time
from app.drives.process import Outcome
from app.jobs.context import JobContext
from app.map import store as slopes
from app.roads import imports as road_imports
from fusion.catalogue import METHODS
from fusion.formats import read_log
from fusion.gnss.positioning import Positioned
from fusion.methods.base import Options
from fusion.network.combine import combine
from fusion.pipeline import run_drive
from fusion.roads.osm import read_roads
from fusion.signals import RawGnss, Signals
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, GnssFix, GnssVelocity, Progress, Track
from processing_support import accept_upload, drive_now, process_drive, state

Send = Callable[..., Drive]


@pytest.mark.parametrize(
    ("method", "options"), [("profile", {}), ("raw", {}), ("dem", {}), ("particle", {"particles": 300})]
)
def test_the_service_stores_the_numbers_of_the_library(
    context: JobContext, send: Send, files: Path, method: str, options: dict[str, Any]
) -> None:
    drive = send(1, method, options)
    assert process_drive(context, drive.id, 1) is Outcome.DONE

    log = read_log(files / "1.csv")
    with Dem.open([files / "town.tif"]) as dem:
        network, result = run_drive(log, read_roads(files / "town.osm"), dem, method=method, options=options)
    with context.sessions() as session:
        stored = {
            (row.segment.osm_way_id, row.segment.from_node, row.segment.to_node): row
            for row in slopes.drive_segment_rows(session, drive.id)
        }
        track = tracks.read_track(session, drive.id)
        measured = tracks.read_measurements(session, drive.id)
        segment_of = {row.id: row for row in slopes.all_segments(session)}
    table = network.table
    assert len(stored) == len(result.slopes) > 5
    for estimate in result.slopes:
        k = estimate.segment
        row = stored[(int(table.osm_way_id[k]), int(table.from_node[k]), int(table.to_node[k]))]
        assert (row.slope_percent, row.slope_sigma_percent, row.observations, row.passes) == (
            estimate.slope_percent, estimate.slope_sigma_percent, estimate.observations, estimate.passes
        )  # fmt: skip
        assert row.first_at.timestamp() == pytest.approx(estimate.first_time_s, abs=1e-5)
    assert track is not None
    for spec in fields(Track):
        if spec.name != "segment":
            assert np.array_equal(getattr(track, spec.name), getattr(result.track, spec.name), equal_nan=True)
    assert (measured is None) == (result.measurements is None) == (method != "profile")
    if measured is not None and result.measurements is not None:
        assert measured.time_s.tolist() == result.measurements.time_s.tolist()
        np.testing.assert_allclose(measured.value, result.measurements.value, rtol=1e-6)
    for index, segment_id in zip(result.track.segment.tolist(), track.segment.tolist(), strict=True):
        assert (segment_id == -1) == (index == -1)
        if index >= 0:
            assert segment_of[segment_id].from_node == table.from_node[index]


def test_a_done_drive_says_what_was_done(context: JobContext, send: Send, files: Path) -> None:
    drive = send(0)
    process_drive(context, drive.id, 1)
    done = drive_now(context, drive.id)
    log = read_log(files / "0.csv")
    assert (done.status, done.progress, done.stage, done.failure) == ("done", 1.0, None, None)
    assert done.bbox == pytest.approx(log.bounds_deg())
    assert done.epochs == 150
    assert done.distance_m is not None
    assert 300 < done.distance_m < 5000
    assert done.drive_time is not None
    assert done.drive_time.timestamp() == pytest.approx(log.fix.time_s[0], abs=1e-5)
    assert done.report is not None
    assert done.report["method"] == "raw"
    assert {"code_version", "road_version", "dem_version", "matched_share", "warnings"} <= set(done.report)
    with context.sessions() as session:
        (first, *_) = slopes.all_segments(session, driven=True)
        (behind,) = slopes.segment_observations(session, first.id)
    assert behind.method == "raw"
    assert set(behind.options) == set(METHODS["raw"].options_model.model_fields) - {"columns", "heights"}
    assert behind.dem_version_id is not None


def test_positions_are_computed_before_roads_are_chosen(
    context: JobContext, send: Send, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A log of raw signals has no position; those that are computed lead to roads, and the report tells of them."""

    def read(*arguments: Any, **options: Any) -> DriveLog:
        nothing = {"fix": GnssFix.empty(), "velocity": GnssVelocity.empty(), "raw": RawGnss(Signals.empty())}
        return replace(read_log(*arguments, **options), **nothing)

    def solve(log: DriveLog, options: Options, progress: Progress) -> Positioned:
        assert (len(log.fix), options.gnss) == (0, "receiver")
        progress("positioning", 0.5)
        return Positioned(
            whole, "solver", report={"positioning": "solver", "solved": 150, "counts": {"jumps": 3}}
        )

    drive = send(0, "raw", {"gnss": "receiver"})
    with context.blobs.open(drive.blob_key) as file:
        whole = read_log(file)
    monkeypatch.setattr(computing, "read_log", read)
    assert process_drive(context, drive.id, 1) is Outcome.FAILED
    failure = drive_now(context, drive.id).failure
    assert failure is not None
    assert (failure.kind, failure.stage) == ("empty-log", "positioning")
    monkeypatch.setattr(computing, "positions_of", solve)
    intake.reprocess(context.sessions, drive.id)
    assert process_drive(context, drive.id, 2) is Outcome.DONE
    done = drive_now(context, drive.id)
    assert done.report is not None
    assert done.report["gnss"] == {"positioning": "solver", "solved": 150, "counts": {"jumps": 3}}
    assert done.bbox == pytest.approx(whole.bounds_deg())
    assert done.drive_time is not None


def test_without_elevation_a_drive_is_done_all_the_same(
    sessions: Sessions, files: Path, tmp_path: Path
) -> None:
    road_imports.import_roads(sessions, files / "town.osm", tmp_path / "dem")
    context = JobContext(Settings(data_dir=tmp_path), sessions)
    drive, _ = accept_upload(
        sessions, context.blobs, [(files / "0.csv").read_bytes()], filename="x", method="particle",
        options={"particles": 300},
    )  # fmt: skip
    assert process_drive(context, drive.id, 1) is Outcome.DONE
    assert len(state(context)) > 5


def test_drives_combine(context: JobContext, send: Send) -> None:
    for seed, method in ((0, "raw"), (1, "dem"), (2, "raw")):
        assert process_drive(context, send(seed, method).id, 1) is Outcome.DONE
    with context.sessions() as session:
        shared = 0
        for row in slopes.all_segments(session, driven=True):
            behind = slopes.segment_observations(session, row.id)
            whole = combine(
                np.array([b.slope_percent for b in behind]),
                np.array([b.slope_sigma_percent for b in behind]),
                np.array([b.observations for b in behind]),
            )
            assert (row.slope_percent, row.slope_sigma_percent) == (
                whole.slope_percent, whole.slope_sigma_percent
            )  # fmt: skip
            assert (row.drives, row.observations) == (len(behind), sum(b.observations for b in behind))
            shared += len(behind) > 1
    assert shared > 0


def test_a_drive_may_run_again(context: JobContext, send: Send) -> None:
    drive = send(0)
    process_drive(context, drive.id, 1)
    before = state(context)
    assert (
        process_drive(context, drive.id, 1) is Outcome.DISCARDED
    )  # the job of a finished drive, taken up again
    intake.reprocess(context.sessions, drive.id)
    assert process_drive(context, drive.id, 1) is Outcome.DISCARDED
    assert process_drive(context, drive.id, 2) is Outcome.DONE
    assert state(context) == before


def test_one_drive_uploaded_twice_at_once_is_stored_once(context: JobContext, send: Send) -> None:
    drive = send(0)
    process_drive(context, drive.id, 1)
    alone = state(context)
    intake.reprocess(context.sessions, drive.id)
    with ThreadPoolExecutor(2) as pool:
        outcomes = list(pool.map(lambda _: process_drive(context, drive.id, 2), range(2)))
    assert Outcome.DONE in outcomes
    assert drive_now(context, drive.id).status == "done"
    assert state(context) == alone


def test_another_method_replaces_the_estimates(context: JobContext, send: Send) -> None:
    drive = send(0)
    process_drive(context, drive.id, 1)
    raw = state(context)
    intake.reprocess(context.sessions, drive.id, "dem")
    process_drive(context, drive.id, 2)
    dem = state(context)
    assert dem != raw
    intake.reprocess(context.sessions, drive.id, "raw")
    process_drive(context, drive.id, 3)
    assert state(context) == raw


BAD = {
    "empty": b"",
    "png": b"\x89PNG\r\n\x1a\n" + bytes(100),
    "csv without columns": b"time_s,speed_mps\n1,2\n",
    "latitude 91": b"time_s,lat_deg,lon_deg\n1317376800,91,8\n1317376801,91,8\n",
    "impossible time": b"time_s,lat_deg,lon_deg\n1e300,49,8\nnan,49,8\n",
    "three epochs": b"time_s,lat_deg,lon_deg\n" + b"".join(b"13173768%02d,49,8\n" % k for k in range(3)),
    "far away": b"time_s,lat_deg,lon_deg\n" + b"".join(b"13173768%02d,-10,-20\n" % k for k in range(9)),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_log_fails_with_a_sentence(context: JobContext, send: Send, name: str) -> None:
    drive = send(BAD[name])
    assert process_drive(context, drive.id, 1) is Outcome.FAILED
    failed = drive_now(context, drive.id)
    assert failed.status == "failed"
    assert failed.failure is not None
    assert failed.failure.kind not in ("unknown", "internal")
    assert failed.failure.reason.endswith((".", ")", "?"))
    assert " " in failed.failure.reason
    assert failed.stage
    assert failed.finished_at is not None
    assert state(context) == []


def test_without_roads_a_drive_fails_and_says_so(sessions: Sessions, files: Path, tmp_path: Path) -> None:
    context = JobContext(Settings(data_dir=tmp_path), sessions)
    content = (files / "0.csv").read_bytes()
    drive, _ = accept_upload(sessions, context.blobs, [content], filename="x", method="raw")
    assert process_drive(context, drive.id, 1) is Outcome.FAILED
    assert "import-roads" in str(drive_now(context, drive.id).failure)


def test_a_lost_blob_fails_and_says_so(context: JobContext, send: Send) -> None:
    drive = send(0)
    context.blobs.delete(drive.blob_key)
    assert process_drive(context, drive.id, 1) is Outcome.FAILED
    assert "upload it again" in str(drive_now(context, drive.id).failure)


def test_a_failed_rerun_leaves_what_was_published(context: JobContext, send: Send) -> None:
    drive = send(0)
    process_drive(context, drive.id, 1)
    before = state(context)
    intake.reprocess(context.sessions, drive.id)
    context.blobs.delete(drive.blob_key)
    assert process_drive(context, drive.id, 2) is Outcome.FAILED
    assert state(context) == before


@pytest.mark.parametrize(
    ("error", "kind"), [(ZeroDivisionError("secret detail"), "internal"), (MemoryError(), "out-of-memory")]
)
def test_a_fault_of_ours_is_logged_and_told_plainly(
    context: JobContext,
    send: Send,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    error: Exception,
    kind: str,
) -> None:
    def fail(*args: Any, **kwargs: Any) -> None:
        raise error

    monkeypatch.setattr(computing, "run_drive", fail)
    drive = send(0)
    assert process_drive(context, drive.id, 1) is Outcome.FAILED
    failed = drive_now(context, drive.id)
    assert failed.failure is not None
    assert failed.failure.kind == kind
    assert "secret" not in failed.failure.reason
    assert str(drive.id) in caplog.text


def test_a_log_without_a_date_has_no_drive_time() -> None:
    """Its times are placed in January 1980 to be worked with; nobody drove then."""
    nmea = "\n".join(
        _sentence(f"GPGGA,1200{second:02d}.00,4800.{second:04d},N,00751.0000,E,1,08,1.0,300.0,M,48.0,M,,")
        for second in range(5)
    )
    undated = read_log(nmea.encode())
    assert drive_time(undated) is None
    dated = read_log(b"time_s,lat_deg,lon_deg\n1700000000,48,7.85\n")
    assert drive_time(dated) == datetime(2023, 11, 14, 22, 13, 20, tzinfo=UTC)


def _sentence(body: str) -> str:
    checksum = 0
    for character in body:
        checksum ^= ord(character)
    return f"${body}*{checksum:02X}"
