"""Records of logs: counted by the worker that reads a log, once for its owner, and refused when they are used up."""

from __future__ import annotations

import gzip
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, date
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from access_support import Keyed
from app.access.store import create_owner
from app.drives import claims, computing, intake
from app.drives.documents import Drive
from app.drives.log_facts import records_of
from app.drives.process import Outcome
from app.jobs.context import JobContext
from fusion.formats import read_log
from fusion.pipeline import run_drive
from fusion.signals import RawGnss
from fusion.types import DeviceMotion, DriveLog, GnssFix, Pressure, ThreeAxes
from gnss_tables import some_signals
from log_samples import csv
from many_drives import execute, rows
from problem_support import check
from processing_support import HEADER, Send, process_drive

FAR_AWAY = HEADER + b"".join(b"13173768%02d,-10,-20\n" % k for k in range(9))


def counted(context: JobContext) -> list[tuple[Any, ...]]:
    """What is counted for each owner and day: drives, bytes and records."""
    query = "SELECT owner_id, day, drives, bytes, records FROM owner_use ORDER BY 1, 2"
    return rows(context.sessions, query)


def in_log(files: Path, log: int) -> int:
    return records_of(read_log(files / f"{log}.csv"))


def day_of(drive: Drive) -> date:
    return drive.created_at.astimezone(UTC).date()


def times(n: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.arange(n, dtype=float)


FIX = GnssFix.assemble(times(5), lat_deg=times(5), lon_deg=times(5))


@pytest.mark.parametrize(
    ("log", "records"),
    [
        (DriveLog("x", GnssFix.empty()), 0),
        (DriveLog("x", FIX), 5),
        (DriveLog("x", FIX, pressure=Pressure.assemble(times(70), pressure_pa=times(70))), 70),
        (DriveLog("x", GnssFix.empty(), raw=RawGnss(some_signals(1, 6))), 6),
        (DriveLog("x", FIX, device=DeviceMotion(force=ThreeAxes.assemble(times(40), x=times(40)))), 40),
        (read_log(csv(20)), 20),
    ],
)
def test_records_are_the_epochs_of_the_sensor_with_most(log: DriveLog, records: int) -> None:
    assert records_of(log) == records


def test_a_drive_is_counted_once_and_before_it_is_estimated(
    context: JobContext, send: Send, files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []

    def estimate(*arguments: Any, **options: Any) -> Any:
        seen.append(counted(context))
        return run_drive(*arguments, **options)

    monkeypatch.setattr(computing, "run_drive", estimate)
    drive, records = send(0), in_log(files, 0)
    once = [(1, day_of(drive), 0, 0, records)]
    assert process_drive(context, drive.id, 1) is Outcome.DONE
    intake.reprocess(context.sessions, drive.id, "dem")
    assert process_drive(context, drive.id, 2) is Outcome.DONE
    assert seen == [once, once]
    assert rows(context.sessions, "SELECT records FROM drives") == [(records,)]
    other = send(1)
    assert process_drive(context, other.id, 1) is Outcome.DONE
    assert counted(context) == [(1, day_of(drive), 0, 0, records + in_log(files, 1))]


def test_it_counts_for_its_owner_and_the_day_of_its_upload(context: JobContext, send: Send) -> None:
    drive = send(FAR_AWAY)
    with context.sessions.begin() as session:
        owner = create_owner(session, "A").id
    execute(context.sessions, "UPDATE drives SET owner_id = :owner", owner=owner)
    execute(context.sessions, "UPDATE drives SET created_at = '2026-11-20 01:30:00+02'")
    process_drive(context, drive.id, 1)
    assert counted(context) == [(owner, date(2026, 11, 19), 0, 0, 9)]


def test_a_drive_that_fails_is_counted_and_what_cannot_be_read_is_not(
    context: JobContext, send: Send
) -> None:
    drive, broken = send(FAR_AWAY), send(b"\x89PNG\r\n\x1a\n" + bytes(100))
    for one in (drive, broken):
        assert process_drive(context, one.id, 1) is Outcome.FAILED
    assert counted(context) == [(1, day_of(drive), 0, 0, 9)]
    assert rows(context.sessions, "SELECT id FROM drives WHERE records IS NULL") == [(broken.id,)]


def test_runs_at_once_count_one_time_and_those_that_are_over_not_at_all(
    context: JobContext, send: Send
) -> None:
    drive = send(FAR_AWAY)
    with context.sessions.begin() as session:
        assert claims.mark_running(session, drive.id, 1) is not None

    def note(generation: int) -> None:
        with context.sessions.begin() as session:
            claims.note_records(session, drive.id, generation, 9)

    note(7)
    assert counted(context) == []
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(note, [1] * 8))
    assert counted(context) == [(1, day_of(drive), 0, 0, 9)]


def test_who_has_used_up_records_sends_no_more_until_they_begin_anew(
    context: JobContext, keyed: Keyed, files: Path
) -> None:
    path, sent = f"/v1/owners/{keyed.a.id}", keyed.a.upload
    logs = [gzip.compress((files / f"{log}.csv").read_bytes()) for log in (0, 1)]
    assert keyed.operator.client.patch(path, json={"quota_records": 10}).status_code == 200
    answer = sent.post("/v1/drives?method=raw", content=logs[0])
    assert answer.status_code == 202, answer.text
    assert answer.headers["ratelimit-policy"] == '"records";q=10;qu="records";w=86400'
    process_drive(context, answer.json()["id"], 1)
    today = keyed.a.own.get("/v1/owner").json()["today"]
    assert (today["records"], today["quota_records"]) == (in_log(files, 0), 10), "it is taken whole"
    refused = check(sent.post("/v1/drives?method=raw", content=logs[1]), 429)
    assert f"10 records a day: {today['records']} were uploaded today. " in refused["detail"]
    assert keyed.b.own.post("/v1/drives?method=raw", content=logs[1]).status_code == 202
    assert keyed.b.own.get("/v1/owner").json()["today"]["records"] == 0, "nobody has read it"
    keyed.operator.client.patch(path, json={"quota_records": None})
    assert sent.post("/v1/drives?method=raw", content=logs[1]).status_code == 202
