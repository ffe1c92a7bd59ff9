"""``versant drives`` against a service of a few lines, and against a real one."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
from typer.testing import CliRunner, Result

from app.cli import app
from app.cli.client import Client
from processing_support import carry_out_removals

SERVER = "http://service.example"
FAILURE = {"kind": "no-match", "reason": "No road is near."}

Answer = Callable[[httpx.Request], httpx.Response]
Run = Callable[..., Result]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    """``run(answer, arguments)``: the command with a service that answers so."""
    monkeypatch.setattr("app.cli.drives.time.sleep", lambda seconds: None)
    monkeypatch.setattr("app.cli.client.time.sleep", lambda seconds: None)

    def invoke(answer: Answer, *arguments: str) -> Result:
        made = lambda server: Client(SERVER, transport=httpx.MockTransport(answer))  # noqa: E731
        monkeypatch.setattr("app.cli.drives.service_client", made)
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
    result = run(answer, "list", "--status", "done", "--limit", "3", "--json", str(figures))
    assert result.exit_code == 0, result.output
    assert asked == [{"limit": "3", "status": "done"}, {"after": "2"}]
    assert [one["id"] for one in json.loads(figures.read_text())["drives"]] == ["0", "1", "2"]
    assert "No road is near." in result.stdout


def test_a_drive_is_shown_with_its_failure_and_its_warnings(run: Run) -> None:
    one = drive(7, "failed", failure=FAILURE, report={"warnings": ["Odd."]})
    result = run(lambda request: httpx.Response(200, json=one), "show", "7")
    assert result.exit_code == 0, result.output
    for said in ("no-match", "No road is near.", "Odd.", "7.csv"):
        assert said in result.stdout


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
    assert "1 drive(s) are processed again so far; a worker puts the rest into the queue." in result.stdout
    assert f"{2 - failed} done, {failed} failed." in result.stdout
    counts = {"drives": 2, "running": 0, "done": 2 - failed, "failed": failed}
    assert json.loads(figures.read_text()) == {"server": SERVER, "number": "7", **counts}


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--all"], {"which": "all"}),
        (["--stale", "--bbox", "1,2,3,4"], {"which": "stale", "bbox": "1,2,3,4"}),
        (["--failed"], {"which": "failed"}),
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
            return httpx.Response(200, json=drive(7, "done" if request.url.path.endswith("7") else "failed"))
        asked = [("gnss", "pf"), ("gnss_option", "n:9"), ("gnss_option", 'kind:"fpll"'), ("method", "raw")]
        assert request.url.params.multi_items() == asked
        return httpx.Response(202, json={})

    positioning = ["--gnss", "pf", "--gnss-option", "n=9", "--gnss-option", "kind=fpll"]
    drives = ["--drive", "7", "--drive", "8"]
    result = run(answer, "reprocess", *drives, "--method", "raw", *positioning, "--wait")
    assert result.exit_code == 1
    assert "1 done, 1 failed." in result.stdout


def test_the_real_service_counts_takes_on_and_calls_off(web: Any) -> None:
    drives = [
        web.client.post("/v1/drives?method=raw", content=b"no log %d" % k).json()["id"] for k in range(2)
    ]
    server = ["--server", web.base]

    def command(*arguments: str) -> str:
        result = CliRunner().invoke(app, ["drives", *arguments, *server])
        assert result.exit_code == 0, result.output
        return result.stdout

    listed = command("list")
    assert all(one in listed for one in drives)
    assert "0 drive(s) would be processed again." in command("reprocess", "--all", "--dry-run")
    assert "0 drive(s) are processed again. Batch 1." in command("reprocess", "--failed", "--wait")
    assert "Batch 1: 0 drive(s) still run, 0 done, 0 failed." in command("reprocess", "--cancel", "1")
    assert "2 drive(s) are processed again." in command(
        "reprocess", *(x for d in drives for x in ("--drive", d))
    )
    assert "queued" in command("show", drives[0])
    command("delete", *drives)
    assert command("list").count("cancelled") == 2
    carry_out_removals(web.sessions, web.blobs)
    assert drives[0] not in command("list")
