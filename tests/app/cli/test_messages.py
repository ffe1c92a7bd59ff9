"""What commands tell of drives: a line each, warnings in any case, failures once, refusals by the option's name."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from signal import SIGINT
from typing import Any

import httpx
import pytest
from typer.testing import CliRunner, Result

from app.cli import app
from app.cli.client import Client
from app.cli.console import QUIET_S, Lines, part_of, whole_file
from app.cli.drives.look import drive_lines
from app.drives.outputs.ride import RIDE_EXAMPLE
from app.drives.outputs.summary import summary
from fusion.simulate.demonstration import Demonstration, write_all

SERVER = "http://service.example"
HERE = f"{SERVER}/v1/drives/7"
LINKS = [
    {"href": HERE, "rel": "self", "type": "application/json"},
    {"href": f"{HERE}/profile", "rel": "profile"},
    {"href": f"{HERE}/profile?f=png", "rel": "profile", "type": "image/png"},
]
REPORT = {
    "distance_m": 6240.3, "segments_estimated": 84, "median_slope_sigma_percent": 0.42, "dem_share": 1.0,
    "dem_only": False, "warnings": ["Odd."],
}  # fmt: skip

Upload = Callable[..., Result]


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    return write_all(tmp_path_factory.mktemp("town"), 3, seed=1, duration_s=60.0)


@pytest.fixture
def upload(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Upload:
    """``upload(status, arguments)``: the command with a service whose drive ends so; with ``waits_for``, for roads."""
    log = tmp_path / "monday.csv"
    log.write_bytes(b"x")

    def invoke(status: str, *arguments: str, waits_for: dict[str, Any] | None = None) -> Result:
        failure = {"kind": "no-match", "reason": "No road is near."} if status == "failed" else None
        report = REPORT if status == "done" else None
        document = {"id": "7", "status": status, "failure": failure, "report": report, "links": LINKS}
        document["waits_for"] = waits_for

        def answer(request: httpx.Request) -> httpx.Response:
            if request.url.path.endswith("/segments"):
                return httpx.Response(200, json={"features": [{}] * 84, "links": []})
            request.read()
            return httpx.Response(200, json=document)

        made = lambda *where: Client(SERVER, transport=httpx.MockTransport(answer))  # noqa: E731
        monkeypatch.setattr("app.cli.remote.service_client", made)
        return CliRunner().invoke(app, ["upload", str(log), *arguments])

    return invoke


@pytest.mark.parametrize(
    ("report", "said"),
    [
        (REPORT, "x: 6.2 km, 84 segments, median sigma 0.42 %."),
        (REPORT | {"dem_share": None}, "x: 6.2 km, 84 segments, median sigma 0.42 %, no elevation model."),
        (
            REPORT | {"dem_share": 0.0},
            "x: 6.2 km, 84 segments, median sigma 0.42 %, no elevation model there.",
        ),
        (
            REPORT | {"dem_only": True},
            "x: 6.2 km, 84 segments, median sigma 0.42 %, by the elevation model alone.",
        ),
        (
            {
                "distance_m": 512.0,
                "segments_estimated": 0,
                "median_slope_sigma_percent": None,
                "dem_share": 1.0,
            },
            "x: 512 m, no segment got a slope.",
        ),
        ({"segments_estimated": 1}, "x: 1 segment."),
        ({}, "x: processed."),
    ],
)
def test_a_drive_in_one_line(report: dict[str, Any], said: str) -> None:
    assert summary("x", report) == said


def test_upload_tells_what_came_of_a_drive_and_where_it_is(upload: Upload, tmp_path: Path) -> None:
    figures = tmp_path / "figures.json"
    result = upload("done", "--wait", "--json", str(figures))
    assert result.exit_code == 0, result.output
    name = tmp_path / "monday.csv"
    line = f"{name}: 6.2 km, 84 segments, median sigma 0.42 %."
    assert result.stderr.splitlines() == [
        line,
        f"{name}: Odd.",
        f"{name}: see {HERE} and its profile {HERE}/profile?f=png",
    ]
    (row,) = json.loads(figures.read_text())["uploads"]
    assert (row["summary"], row["warnings"], row["segments"]) == (line, ["Odd."], 84)
    assert (row["address"], row["profile"]) == (HERE, f"{HERE}/profile?f=png")
    quiet = upload("done", "--wait", "--quiet")
    assert quiet.stderr.splitlines() == [f"{name}: Odd."]
    assert "done" in quiet.stdout


@pytest.mark.parametrize("wait", [[], ["--wait"]], ids=str)
def test_upload_tells_a_failure_once(upload: Upload, wait: list[str], tmp_path: Path) -> None:
    result = upload("failed", *wait)
    assert result.exit_code == 1
    assert result.stderr == f"versant: {tmp_path / 'monday.csv'}: No road is near.\n"
    assert "failed" in result.stdout
    assert "No road" not in result.stdout


@pytest.mark.parametrize("wait", [[], ["--wait"]], ids=str)
def test_upload_tells_what_waits_for_roads_from_failures(
    upload: Upload, wait: list[str], tmp_path: Path
) -> None:
    waits_for = {"kind": "roads", "extract": "europe/malta", "extracts": ["europe/malta"]}
    figures = tmp_path / "figures.json"
    result = upload("failed", *wait, "--json", str(figures), waits_for=waits_for)
    assert result.exit_code == 1
    assert result.stderr == f"{tmp_path / 'monday.csv'}: waits for roads. No road is near.\n"
    assert "waits for roads" in result.stdout
    assert "failed" not in result.stdout
    [one] = json.loads(figures.read_text())["uploads"]
    assert (one["status"], one["waits_for"]) == ("failed", waits_for)


def test_fuse_keeps_its_voice_out_of_what_is_piped_on(bundle: Demonstration, tmp_path: Path) -> None:
    """GeoJSON alone on standard output; with --quiet only what a person must know."""
    poor = tmp_path / "poor.csv"
    rows = [line.split(",")[:4] for line in bundle.drives[0].read_text().splitlines()]
    poor.write_text("\n".join(map(",".join, rows)))
    command = ["fuse", str(poor), "--roads", str(bundle.osm)]
    loud, quiet = (CliRunner().invoke(app, command + more) for more in ([], ["--quiet"]))
    assert json.loads(loud.stdout)["features"]
    assert len(json.loads(quiet.stdout)["features"]) == len(json.loads(loud.stdout)["features"])
    line, *warnings = loud.stderr.splitlines()
    assert "median sigma" in line
    assert line.endswith("no elevation model.")
    assert quiet.stderr.splitlines() == warnings
    assert [w for w in warnings if "no vertical Doppler velocity" in w] == warnings


@pytest.mark.parametrize(
    ("arguments", "option", "said"),
    [
        (["--method", "nonsense"], "--method", "profile"),
        (["--option", "particles"], "--option", "NAME=VALUE"),
        (["--method", "particle", "--option", "particles=-1"], "--option", "greater than"),
        (["--option", "nothing=1"], "--option", "match_radius_m"),
        (["--gnss", "nonsense"], "--gnss", "one-sided"),
        (["--gnss-option", "x=1"], "--gnss-option", "Its options are"),
        (["-o", "out.xyz"], "--out", ".geojson"),
        (["--json", "none/x.json"], "--json", "there is no folder"),
    ],
    ids=str,
)
def test_a_refusal_names_the_option_and_what_it_may_be(
    arguments: list[str], option: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    command = ["fuse", "a.csv", "--roads", "r.osm", *arguments]
    result = CliRunner().invoke(app, command, env={"COLUMNS": "1000"})
    assert result.exit_code == 2
    assert f"for '{option}'" in result.stderr or f"for '-o' / '{option}'" in result.stderr, result.stderr
    assert said in result.stderr


def test_a_part_of_some_work_never_falls_back() -> None:
    seen: list[tuple[str, float]] = []
    part = part_of(lambda stage, share: seen.append((stage, share)), 0.4, 0.9)
    for stage, share in (("a", 0.0), ("a", 1.0), ("b", 0.0), ("b", 2.0)):
        part(stage, share)
    assert seen == [("a", 0.4), ("a", 0.9), ("b", 0.9), ("b", 0.9)]


def test_a_file_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    path.write_text("before")
    with pytest.raises(KeyboardInterrupt), whole_file(path) as partial:
        partial.write_text("ha")
        raise KeyboardInterrupt
    assert path.read_text() == "before"
    with whole_file(path) as partial:
        partial.write_text("after")
    assert path.read_text() == "after"
    assert [one.name for one in tmp_path.iterdir()] == ["x.txt"]
    with whole_file(Path("/dev/null")) as partial:
        partial.write_text("gone")


FUSE = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # children of what runs in the background ignore Ctrl-C
from app.cli.logs.fusing import Fusion
solve = Fusion.solve
def waiting(fusion, *arguments, **options):
    print("begun", flush=True)
    while True:
        solve(fusion, *arguments, **options)
Fusion.solve = waiting
from app.cli import main
main()
"""


def test_an_interrupt_ends_fuse_and_leaves_nothing_behind(bundle: Demonstration, tmp_path: Path) -> None:
    """In the midst of computing: without a traceback, as shells expect, and what was there before stays."""
    out = tmp_path / "out.geojson"
    out.write_text("before")
    files = ["-o", str(out), "--profile", str(tmp_path / "p.png"), "--json", str(tmp_path / "x.json")]
    command = ["fuse", *map(str, bundle.drives), "--roads", str(bundle.osm), *files]
    with subprocess.Popen(
        [sys.executable, "-c", FUSE, *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        try:
            assert running.stdout is not None
            assert running.stdout.readline() == "begun\n"
            running.send_signal(SIGINT)
            began = time.monotonic()
            _, said = running.communicate(timeout=60)
        finally:
            running.kill()  # or the block would wait for it
    assert running.returncode in (130, -SIGINT)
    assert time.monotonic() - began < 20  # 3 s where nothing else runs
    assert "Traceback" not in said
    assert [one.name for one in tmp_path.iterdir()] == ["out.geojson"]
    assert out.read_text() == "before"


def test_long_work_speaks_in_lines_where_nobody_sees_bars(capsys: pytest.CaptureFixture[str]) -> None:
    now_s = 0.0
    lines = Lines(lambda: now_s)
    fusing, sending = lines.work("fusing a.csv"), lines.count("sending b.csv", 200)
    fusing("reading", 0.1)
    assert capsys.readouterr().err == ""  # short work says nothing
    now_s = QUIET_S
    fusing("filter", 0.25)
    fusing("filter", 0.26)
    sending(50)
    now_s = 2 * QUIET_S
    sending(100)
    assert capsys.readouterr() == ("", "fusing a.csv: 25%, filter\nsending b.csv: 75%\n")


def test_a_ride_is_shown_by_its_ascent_and_its_climbs() -> None:
    drive = {"id": "7", "status": "done", "method": "raw", "filename": "7.csv", "report": {}}
    assert drive_lines(drive | {"ride": RIDE_EXAMPLE | {"descent_sigma_m": None}})[-5:] == [
        "Ride",
        "  ascent          131 ± 3 m",
        "  descent         98 m",
        "  steepest 100 m  9.3 ± 0.4 %, from km 0.81 (Talweg)",
        "  climb 1         km 0.42 to 1.83 (Talweg): 86 m up, 6.1 ± 0.1 %, at most 9.3 %, category 4",
    ]
    assert "Ride" not in drive_lines(drive | {"ride": None})
