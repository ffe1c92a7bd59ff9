"""An archive of mixed files sent to a real service and killed on the way: each file accounted for, none twice."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text
from typer.testing import CliRunner, Result

from app.cli import app
from app.cli.uploads.choice import ONE_UPLOAD_FILES, is_archive
from app.cli.uploads.journal import Journal
from app.drives.receiving.zips import MAX_FILES
from ride_archive import RideArchive, make_archive


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(one) for one in arguments])


def lines_of(journal: Path) -> int:
    return journal.read_bytes().count(b"\n") if journal.exists() else 0


def killed_at(lines: int, command: list[str], journal: Path) -> None:
    """Run the command until its journal has so many lines, then kill it."""
    process = subprocess.Popen(
        [sys.executable, "-m", "app.cli", *command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    pause, ends_s = threading.Event(), time.monotonic() + 600
    while lines_of(journal) < lines and process.poll() is None:
        assert time.monotonic() < ends_s
        pause.wait(0.002)
    assert process.poll() is None, "it was done before it was killed"
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL


def drives_of(web: Any) -> list[dict[str, Any]]:
    found, address = list[dict[str, Any]](), "/v1/drives?limit=100"
    while address:
        page = web.client.get(address).json()
        found += page["drives"]
        address = next((one["href"] for one in page["links"] if one["rel"] == "next"), "")
    return found


def sent_through_kills(web: Any, made: RideArchive, tmp_path: Path) -> None:
    journal, figures = tmp_path / "journal.jsonl", tmp_path / "figures.json"
    command = ["upload", str(made.root), "--server", web.base, "--journal", str(journal)]
    for lines in (1, 1 + made.drives // 3, 1 + 2 * made.drives // 3):
        killed_at(lines, command, journal)
        with journal.open("ab") as file:  # as if it had been killed in the middle of a line
            file.write(b'{"content": "ab')
    result = run(*command, "--json", figures)
    assert result.exit_code == 0, result.output
    files = json.loads(figures.read_text())["files"]
    assert len(files) == len({one["file"] for one in files}) == made.files
    assert Counter(one["kind"] for one in files) == made.kinds
    assert all(one["reason"] for one in files if one["kind"] != "drive")
    there = drives_of(web)
    assert len(there) == made.drives
    sent = [one["drive"] for one in files if one["kind"] == "drive"]
    assert sorted(sent) == sorted(one["id"] for one in there)
    noted = [json.loads(line) for line in journal.read_text().splitlines()[1:]]
    assert sorted(one["drive"] for one in noted) == sorted(sent)
    assert {one["outcome"] for one in files} >= {"sent before", "left out"}
    again = run(*command, "--json", figures)
    assert again.exit_code == 0, again.output
    outcomes = Counter(one["outcome"] for one in json.loads(figures.read_text())["files"])
    assert outcomes == {"sent before": made.drives, "left out": made.files - made.drives}
    assert len(drives_of(web)) == made.drives


def test_an_archive_that_is_killed_three_times_is_accounted_for(web: Any, tmp_path: Path) -> None:
    sent_through_kills(web, make_archive(tmp_path / "years", 60), tmp_path)


@pytest.mark.long("three thousand uploads")
def test_three_thousand_files_that_are_killed_three_times_are_accounted_for(web: Any, tmp_path: Path) -> None:
    sent_through_kills(web, make_archive(tmp_path / "years", 3000), tmp_path)


def test_a_dry_run_tells_what_is_in_an_archive_and_asks_no_service(tmp_path: Path) -> None:
    made, table, figures = make_archive(tmp_path / "years", 20), tmp_path / "m.csv", tmp_path / "f.json"
    result = run("upload", made.root, "--dry-run", "--manifest", table, "--json", figures)
    assert result.exit_code == 0, result.output
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert Counter(row["kind"] for row in rows) == made.kinds
    by_name = {Path(row["file"]).name: row for row in rows}
    assert {
        "sport": "cycling",
        "start": "2015-03-02T08:00:00Z",
        "duration_s": "11.0",
        "km": "0.123",
    }.items() <= (by_name["1.fit.gz"].items())
    assert (
        by_name["5.fit"]["reason"] == "It was recorded as swimming, which does not count as driving on roads."
    )
    assert by_name["z8.csv.gz"]["kind"] == "repeated"
    assert len({row["drive"] for row in rows if row["kind"] == "drive"}) == made.drives
    assert {one["outcome"] for one in json.loads(figures.read_text())["files"]} == {"not sent", "left out"}
    assert f"{made.files} files, drives on roads: {made.drives}" in result.stderr


def test_sports_are_chosen(tmp_path: Path) -> None:
    made = make_archive(tmp_path / "years", 20)
    every = run("upload", made.root, "--dry-run", "--all")
    assert f"drives on roads: {made.drives + 4}" in every.stderr
    swims = run("upload", made.root, "--dry-run", "--sports", "Schwimmen")
    # Of some rides nobody tells the sport: they stay.
    assert f"drives on roads: {4 + 2}" in swims.stderr
    wrong = run("upload", made.root, "--dry-run", "--sports", "chess")
    assert wrong.exit_code == 2
    assert "'chess' is no sport" in wrong.stderr
    assert run("upload", made.root, "--dry-run", "--together").exit_code == 2


def test_what_one_upload_can_take_is_no_archive(tmp_path: Path) -> None:
    assert ONE_UPLOAD_FILES == MAX_FILES
    folder = tmp_path / "few"
    (folder / "deeper").mkdir(parents=True)
    for number in range(MAX_FILES):
        (folder / f"{number}.csv").write_text("x")
    assert not is_archive(folder)
    assert not is_archive(folder / "0.csv")
    assert not is_archive(tmp_path / "none")
    (folder / "deeper" / "one.csv").write_text("x")
    assert is_archive(folder)
    assert is_archive(make_archive(tmp_path / "years", 10).root)
    assert is_archive(tmp_path / "years" / "garmin.zip")
    assert is_archive(tmp_path)  # its folders alone have files


def test_a_journal_is_of_one_service_and_of_one_process(web: Any, tmp_path: Path) -> None:
    made, journal = make_archive(tmp_path / "years", 10), tmp_path / "journal.jsonl"
    with Journal(journal, web.base):
        busy = run("upload", made.root, "--server", web.base, "--journal", journal)
    assert busy.exit_code == 1
    assert "in use by another upload" in busy.stderr
    journal.write_text('{"versant upload": 1, "server": "http://elsewhere"}\n')
    other = run("upload", made.root, "--server", web.base, "--journal", journal)
    assert other.exit_code == 1
    assert "Name another file by --journal" in other.stderr
    assert drives_of(web) == []


def test_one_drive_that_is_refused_keeps_none_of_the_others(web: Any, tmp_path: Path) -> None:
    made = make_archive(tmp_path / "years", 10)
    (made.root / "recorder" / "bad.csv").write_text("time_s,lat_deg,lon_deg\nx,91,0\n" * 3)
    (made.root / "locked.zip").write_bytes(b"PK\x03\x04 and no more")
    figures = tmp_path / "figures.json"
    result = run("upload", made.root, "--server", web.base, "--json", figures)
    files = {Path(one["file"]).name: one for one in json.loads(figures.read_text())["files"]}
    assert result.exit_code == 0, result.output
    assert files["locked.zip"]["kind"] == "malformed-log"
    assert files["bad.csv"]["outcome"] == "left out"
    assert len(drives_of(web)) == made.drives


def test_a_quota_that_is_used_up_ends_it_for_the_day(web: Any, tmp_path: Path) -> None:
    made, figures = make_archive(tmp_path / "years", 20), tmp_path / "figures.json"
    command = (
        "upload",
        made.root,
        "--server",
        web.base,
        "--journal",
        tmp_path / "j.jsonl",
        "--json",
        figures,
    )

    def outcomes(quota: int | None) -> Counter[str]:
        with web.sessions.begin() as session:
            session.execute(text("UPDATE owners SET quota_drives = :quota"), {"quota": quota})
        assert run(*command).exit_code == (1 if quota else 0)
        return Counter(one["outcome"] for one in json.loads(figures.read_text())["files"])

    assert outcomes(3) == {"queued": 3, "not sent": made.drives - 3, "left out": made.files - made.drives}
    reasons = {
        one["reason"] for one in json.loads(figures.read_text())["files"] if one["outcome"] == "not sent"
    }
    assert all("You may upload 3 drives a day" in reason for reason in reasons)
    rest = {"sent before": 3, "queued": made.drives - 3, "left out": made.files - made.drives}
    assert outcomes(None) == rest
    assert len(drives_of(web)) == made.drives


def test_waiting_passes_over_what_was_removed_since(web: Any, tmp_path: Path) -> None:
    made, figures = make_archive(tmp_path / "years", 6), tmp_path / "figures.json"
    command = [
        "upload",
        made.root,
        "--server",
        web.base,
        "--journal",
        tmp_path / "j.jsonl",
        "--json",
        figures,
    ]
    assert run(*command).exit_code == 0
    with web.sessions.begin() as session:
        session.execute(
            text("UPDATE drives SET status = 'failed', failure_reason = 'No.', finished_at = now()")
        )
        session.execute(text("DELETE FROM drives WHERE filename LIKE '%.csv'"))
    result = run(*command, "--wait")
    assert result.exit_code == 1  # the others failed
    statuses = Counter(one["status"] for one in json.loads(figures.read_text())["uploads"])
    assert statuses == {"failed": made.drives - 1, "sent before": 1, "left out": made.files - made.drives}
