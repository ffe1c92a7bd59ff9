"""``versant drives`` against a service of a few lines, and against a real one."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import httpx
import pytest
from sqlalchemy import text
from typer.testing import CliRunner, Result

from app.cli import app
from app.cli.client import Client
from app.cli.drives.look import Status
from app.core.tables import DRIVE_STATUSES
from app.core.version import code_version
from app.drives.worker import run_worker
from fusion.pipeline import parse_options
from processing_support import HEADER

SERVER = "http://service.example"
LOG = b"time_s,lat_deg,lon_deg\n" + b"".join(b"17000000%02d,49.0,8.4\n" % k for k in range(20))
FAILURE = {"kind": "no-match", "reason": "No road is near."}

Answer = Callable[[httpx.Request], httpx.Response]
Run = Callable[..., Result]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    """``run(answer, arguments)``: the command with a service that answers so."""
    monkeypatch.setattr("app.cli.drives.again.time.sleep", lambda seconds: None)
    monkeypatch.setattr("app.cli.client.time.sleep", lambda seconds: None)

    def invoke(answer: Answer, *arguments: str) -> Result:
        made = lambda *where: Client(SERVER, transport=httpx.MockTransport(answer))  # noqa: E731
        for part in ("look", "again"):
            monkeypatch.setattr(f"app.cli.drives.{part}.service_client", made)
        return CliRunner().invoke(app, ["drives", *arguments])

    return invoke


def drive(number: int, status: str = "done", **more: Any) -> dict[str, Any]:
    one = {"id": str(number), "status": status, "method": "raw", "filename": f"{number}.csv", "failure": None}
    return one | {"created_at": "2026-11-20T09:00:00Z", "report": None, "links": []} | more


def refuse(request: httpx.Request) -> httpx.Response:
    raise AssertionError(request.url)


def test_the_list_follows_pages_as_far_as_it_is_wanted(run: Run, tmp_path: Path) -> None:
    asked = []

    def answer(request: httpx.Request) -> httpx.Response:
        asked.append(dict(request.url.params))
        at = int(request.url.params.get("after", 0))
        links = [{"rel": "next", "href": f"{SERVER}/v1/drives?after={at + 2}"}]
        page = [drive(at), drive(at + 1, "failed", failure=FAILURE)]
        return httpx.Response(200, json={"drives": page, "links": links})

    figures = tmp_path / "figures.json"
    filters = ["--status", "failed", "--failure", "no-match", "--since", "2026-11-20", "--batch", "7"]
    result = run(answer, "list", *filters, "--limit", "3", "--json", str(figures))
    assert result.exit_code == 0, result.output
    first = {"status": "failed", "failure": "no-match", "created_after": "2026-11-20", "batch": "7"}
    assert asked == [{"limit": "3"} | first, {"after": "2"}]
    assert [one["id"] for one in json.loads(figures.read_text())["drives"]] == ["0", "1", "2"]
    assert "No road is near." in result.stdout


def test_the_list_tells_what_a_drive_is_and_cuts_long_reasons(run: Run) -> None:
    done = drive(1, filename="monday.ubx", distance_m=6240.3, report={"segments_estimated": 80})
    failed = drive(2, "failed", failure={"kind": "no-match", "reason": "No road. " * 40})
    page = {"drives": [done, failed], "links": []}
    result = run(lambda request: httpx.Response(200, json=page), "list")
    head, first, second = result.stdout.splitlines()
    assert head.split() == ["id", "status", "file", "km", "segments", "uploaded", "method", "reason"]
    assert first.split() == ["1", "done", "monday.ubx", "6.24", "80", "2026-11-20", "09:00:00Z", "raw"]
    assert second.endswith("No road. No ...") and len(second) < 200


def test_a_drive_is_shown_in_groups(run: Run) -> None:
    report = {
        "warnings": ["Odd.", "Very odd."],
        "segments_estimated": 80,
        "matched_share": 0.98,
        "code_version": "1.2",
    }
    more = {
        "distance_m": 6240.3,
        "size_bytes": 5_021_417,
        "options": {"gnss": "wls"},
        "bbox": [8, 48.5, 9, 49],
    }
    one = drive(7, "failed", failure=FAILURE | {"stage": "roads", "where": None}, report=report, **more)
    result = run(lambda request: httpx.Response(200, json=one), "show", "7")
    assert result.exit_code == 0, result.output
    assert result.stdout.splitlines() == [
        "Drive 7",
        "  file     7.csv",
        "  size     5.02 MB",
        "  status   failed",
        "  method   raw",
        "  options  gnss=wls",
        "",
        "Times",
        "  created  2026-11-20 09:00:00Z",
        "",
        "Failure",
        "  kind    no-match",
        "  stage   roads",
        "  reason  No road is near.",
        "",
        "Result of an earlier run",
        "  length                 6.24 km",
        "  segments               80",
        "  matched to roads       98 %",
        "  west,south,east,north  8.00000,48.50000,9.00000,49.00000",
        "  code version           1.2",
        "",
        "Warnings",
        "  Odd.",
        "  Very odd.",
    ]


@pytest.mark.parametrize(("status", "shown"), [(200, True), (403, False)])
def test_the_ride_is_asked_for_where_there_is_a_result(run: Run, status: int, shown: bool) -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        if request.url.path.endswith("/profile"):
            return httpx.Response(
                status, json={"ride": {"ascent_m": 131.4}, "detail": "No.", "type": "/forbidden"}
            )
        return httpx.Response(200, json=drive(7, report={}))

    result = run(answer, "show", "7")
    assert result.exit_code == 0, result.output
    assert ("Ride\n  ascent  131 m\n" in result.stdout) == shown


def test_a_drive_that_is_not_there_is_one_line_and_status_1(run: Run) -> None:
    gone = httpx.Response(404, json={"detail": "There is no drive 7. It may have been deleted."})
    result = run(lambda request: gone, "show", "7")
    assert (result.exit_code, result.stdout) == (1, "")
    assert result.stderr == "versant: There is no drive 7. It may have been deleted.\n"


@pytest.mark.parametrize(
    "arguments", [["--status", "lost"], ["--since", "yesterday"], ["--limit", "0"], ["--batch", "x"]], ids=str
)
def test_filters_that_cannot_be_are_wrong_usage(run: Run, arguments: list[str]) -> None:
    assert run(refuse, "list", *arguments).exit_code == 2


def test_the_command_knows_every_status() -> None:
    assert get_args(Status) == DRIVE_STATUSES


def test_deleting_goes_on_after_a_drive_that_is_not_there(run: Run) -> None:
    asked = []

    def answer(request: httpx.Request) -> httpx.Response:
        if request.method == "GET":
            return httpx.Response(200, json={"status": "ok"})
        asked.append((request.method, request.url.path))
        gone = request.url.path.endswith("/1")
        return httpx.Response(404, json={"detail": "There is no drive 1."}) if gone else httpx.Response(202)

    result = run(answer, "delete", "1", "2")
    assert result.exit_code == 1
    assert result.stderr == "versant: There is no drive 1.\n"
    assert asked == [("DELETE", "/v1/drives/1"), ("DELETE", "/v1/drives/2")]


def batch_service(failed: int, **expected: str) -> Answer:
    """A service that takes two drives on and has finished them at the second look."""
    looks = iter([("enqueuing", 1, 0, 0), ("running", 1, 0, 0), ("done", 0, 2 - failed, failed)])

    def answer(request: httpx.Request) -> httpx.Response:
        if request.method == "POST":
            assert dict(request.url.params) == expected
            place = {"Location": f"{SERVER}/v1/drives/reprocess?batch=7"}
            taken = {"queued": 1, "complete": False, "method": "raw", "links": []}
            return httpx.Response(202, json=taken, headers=place)
        assert request.url.params["batch"] == "7"
        if request.url.path == "/v1/drives":
            assert request.url.params["status"] == "failed"
            return httpx.Response(200, json={"drives": [drive(4, "failed", failure=FAILURE)], "links": []})
        state, running, done, bad = next(looks)
        counts = {"drives": 2, "running": running, "done": done, "failed": bad, "progress": 0.5}
        return httpx.Response(200, json={"state": state, **counts})

    return answer


@pytest.mark.parametrize("failed", [0, 1])
def test_reprocess_waits_for_the_whole_batch(run: Run, tmp_path: Path, failed: int) -> None:
    figures = tmp_path / "figures.json"
    command = ["--method", "raw", "--from-method", "dem", "--wait", "--json", str(figures)]
    result = run(batch_service(failed, method="raw", from_method="dem"), "reprocess", *command)
    assert result.exit_code == failed, result.output
    assert "1 drive is processed again so far; a worker puts the rest into the queue." in result.stdout
    assert f"{2 - failed} done, {failed} failed." in result.stdout
    counts = {"drives": 2, "running": 0, "done": 2 - failed, "failed": failed}
    written = json.loads(figures.read_text())
    assert [one["filename"] for one in written.pop("failures")] == ["4.csv"] * failed
    assert written == {"server": SERVER, "number": "7", **counts}
    assert [result.stdout.count(said) for said in ("4.csv", "No road is near.")] == [failed, failed]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--all"], {"which": "all"}),
        (["--stale", "--bbox", "1,2,3,4"], {"which": "stale", "bbox": "1,2,3,4"}),
        (["--failed"], {"which": "failed"}),
        (["--failed", "--force"], {"which": "failed", "force": "true"}),
        (["--failure", "no-match"], {"which": "failed", "failure": "no-match"}),
        (["--all", "--failure", "no-match"], {"which": "all", "failure": "no-match"}),
        (
            ["--code-version", "1", "--driven-before", "2026-01-01"],
            {"code_version": "1", "driven_before": "2026-01-01"},
        ),
    ],
    ids=str,
)
def test_reprocess_names_the_drives(run: Run, arguments: list[str], expected: dict[str, str]) -> None:
    result = run(batch_service(0, **expected), "reprocess", *arguments)
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--all", "--stale"], "Choose one of"),
        (["--drive", "7", "--failed"], "Choose one of"),
        (["--drive", "7", "--bbox", "1,2,3,4"], "Choose one of"),
        (["--cancel", "7", "--dry-run"], "Choose one of"),
        (["--drive", "7", "--force"], "Choose one of"),
        (["--all", "--gnss", "receiver"], "go with --drive"),
    ],
    ids=str,
)
def test_reprocess_refuses_what_contradicts_itself(run: Run, arguments: list[str], said: str) -> None:
    result = run(refuse, "reprocess", *arguments)
    assert result.exit_code == 2, result.output
    assert said in result.stderr


def test_reprocess_of_single_drives(run: Run) -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        if request.method == "GET":
            number = int(request.url.path[-1])
            failed = drive(number, "failed", failure=FAILURE)
            return httpx.Response(200, json=drive(7, "done") if number == 7 else failed)
        asked = [("gnss", "pf"), ("gnss_option", "n:9"), ("gnss_option", 'kind:"fpll"'), ("method", "raw")]
        assert request.url.params.multi_items() == asked
        return httpx.Response(202, json={})

    positioning = ["--gnss", "pf", "--gnss-option", "n=9", "--gnss-option", "kind=fpll"]
    drives = ["--drive", "7", "--drive", "8"]
    result = run(answer, "reprocess", *drives, "--method", "raw", *positioning, "--wait")
    assert result.exit_code == 1
    assert "1 done, 1 failed." in result.stdout
    assert result.stdout.count("8.csv") == result.stdout.count("No road is near.") == 1


def test_the_real_service_counts_takes_on_and_calls_off(web: Any) -> None:
    drives = [
        web.client.post("/v1/drives?method=raw", content=HEADER + b"no row %d" % k).json()["id"]
        for k in range(2)
    ]
    server = ["--server", web.base]

    def command(*arguments: str) -> str:
        result = CliRunner().invoke(app, ["drives", *arguments, *server])
        assert result.exit_code == 0, result.output
        return result.stdout

    listed = command("list")
    assert all(one in listed for one in drives)
    none = command("reprocess", "--all", "--dry-run")
    assert "0 drives would be processed again." in none
    assert "Nothing was chosen. No drive is done or failed. 2 drives are waiting or running already." in none
    assert "0 drives are processed again. Batch 1." in command("reprocess", "--failed", "--wait")
    assert "Batch 1: 0 still run, 0 done, 0 failed." in command("reprocess", "--cancel", "1")
    assert "2 drives are processed again." in command(
        "reprocess", *(x for d in drives for x in ("--drive", d))
    )
    assert "queued" in command("show", drives[0])
    command("delete", *drives)
    assert drives[0] not in command("list")


def test_reprocess_of_the_real_service_says_what_it_leaves_out_and_why(web: Any) -> None:
    """Without roads a log that can be read fails for the service's sake, nonsense for its own."""
    for k, content in enumerate((LOG, HEADER + b"nonsense", HEADER + b"more of it")):
        web.client.post("/v1/drives?method=raw", files={"file": (f"{k}.csv", content)})
    run_worker(web.settings, wait=False)

    def command(*arguments: str) -> str:
        result = CliRunner().invoke(app, ["drives", "reprocess", *arguments, "--server", web.base])
        assert result.exit_code == 0, result.output
        return " ".join(result.stdout.split())

    for which in ("--failed", "--all"):
        counted = command(which, "--dry-run")
        assert counted.startswith("1 drive would be processed again. 2 failed drives are left out, because")
        assert "2 empty-log" in counted
    assert "3 drives would" in command("--failed", "--force", "--dry-run")
    assert "2 drives would" in command("--failure", "empty-log", "--dry-run")
    assert command("--failed").startswith("1 drive is processed again. Batch 1. 2 failed drives are left out")
    with web.sessions.begin() as session:
        session.execute(text("UPDATE drives SET failure_version = '0.0.1'"))
    assert "2 drives would" in command("--failed", "--dry-run"), "another version may be able to read them"


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        ([], "every drive is of the method raw already. --all (which=all) chooses each of them"),
        (["--stale"], "no drive has estimates that are stale"),
        (["--failed"], "No drive is failed."),
        (["--all", "--from-method", "dem"], "no drive fits all that was asked for"),
    ],
    ids=str,
)
def test_reprocess_says_why_nothing_was_chosen(
    filled: Any, drive_maker: Callable[..., Any], arguments: list[str], why: str
) -> None:
    drive_maker(filled.sessions, [0, 1])
    with filled.sessions.begin() as session:
        values = {"version": code_version(), "options": parse_options("raw", {}).model_dump_json()}
        session.execute(
            text("UPDATE provenances SET code_version = :version, options = CAST(:options AS jsonb)"), values
        )
    for dry in (["--dry-run"], []):
        result = CliRunner().invoke(app, ["drives", "reprocess", *arguments, *dry, "--server", filled.base])
        assert result.exit_code == 0, result.output
        assert "Nothing was chosen." in result.stdout and why in " ".join(result.stdout.split())
