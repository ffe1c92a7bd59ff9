"""A log that is computed for seconds: what is left is told, and a removal stops the lane."""

from __future__ import annotations

import csv
import io
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import text

from app.cli.children import child_environment
from app.core.settings import Settings
from app.drives import intake
from app.drives.documents import Drive
from app.drives.remaining import remaining_s
from app.jobs.context import JobContext
from processing_support import Send, drive_now

REPOSITORY = Path(__file__).resolve().parents[3]
PATIENCE_S = 120.0
SOON_S = 2.0
TIMES = 500
PROGRAM = (
    "from app.core.settings import Settings; from app.drives.worker import run_worker; run_worker(Settings())"
)
_AT_IT = text("""
    SELECT count(*) FROM procrastinate_jobs
    WHERE status = 'doing' AND task_name = 'process_drive' AND args ->> 'drive_id' = :id
""")


def there_and_back(log: bytes, times: int) -> bytes:
    """Positions and heights of a log, driven to and fro so often."""
    rows = list(csv.DictReader(io.StringIO(log.decode())))
    places = [(row["lat_deg"], row["lon_deg"], row["alt_msl_m"]) for row in rows if row["lat_deg"]]
    lines, begin_s = ["time_s,lat_deg,lon_deg,alt_msl_m"], float(rows[0]["time_s"])
    for number in range(times):
        for lat, lon, height in places[:: 1 if number % 2 == 0 else -1]:
            lines.append(f"{begin_s + len(lines):.0f},{lat},{lon},{height}")
    return "\n".join(lines).encode()


def wait_for(holds: Callable[[], bool]) -> float:
    """Seconds until it holds."""
    begin = time.monotonic()
    while not holds():
        assert time.monotonic() - begin < PATIENCE_S
        time.sleep(0.02)
    return time.monotonic() - begin


@pytest.mark.long("a log of a hundred thousand positions is computed for some seconds")
@pytest.mark.parametrize("stage", ["match", "smooth", "slopes"])
def test_a_long_drive_that_is_removed_leaves_its_lane_within_two_seconds(
    context: JobContext, send: Send, files: Path, database_url: str, stage: str
) -> None:
    drive = send(there_and_back((files / "0.csv").read_bytes(), TIMES), "profile")
    settings = Settings(database_url=database_url, data_dir=context.settings.data_dir)
    environment = os.environ | child_environment(settings)

    def now() -> Drive:
        found = drive_now(context, drive.id)
        assert found.status in ("queued", "running"), found.failure
        return found

    def is_left() -> bool:
        with context.sessions() as session:
            return not session.execute(_AT_IT, {"id": str(drive.id)}).scalar_one()

    with subprocess.Popen([sys.executable, "-c", PROGRAM], cwd=REPOSITORY, env=environment) as process:
        try:
            wait_for(lambda: now().stage == stage)
            assert not is_left()
            assert intake.remove_drive(context.sessions, drive.id)
            assert wait_for(is_left) < SOON_S
            assert process.poll() is None
        finally:
            process.kill()


@pytest.mark.parametrize(
    ("ran_s", "share", "stage", "left_s"),
    [
        (10.0, 0.5, "smooth", 10.0),
        (61.0, 0.5, "smooth", 60.0),
        (100.0, 0.25, "match", 300.0),
        (1000.0, 0.2, "match", 4200.0),
        (100.0, 0.999, "saving", 5.0),
        (None, 0.5, "smooth", None),
        (1.0, 0.5, "smooth", None),
        (60.0, 0.01, "reading", None),
        (60.0, 0.97, "publishing", None),
    ],
)
def test_what_is_left_follows_from_time_and_share(
    ran_s: float | None, share: float, stage: str, left_s: float | None
) -> None:
    assert remaining_s(ran_s, share, stage) == left_s


def test_a_drive_that_runs_says_how_long_it_will(context: JobContext, send: Send) -> None:
    drive = send(0)
    assert drive_now(context, drive.id).remaining_s is None
    running = text(
        "UPDATE drives SET status = 'running', progress = 0.5, stage = 'smooth', "
        "started_at = clock_timestamp() - make_interval(secs => 40) WHERE id = :id"
    )
    with context.sessions.begin() as session:
        session.execute(running, {"id": drive.id})
    assert drive_now(context, drive.id).remaining_s == 40.0
