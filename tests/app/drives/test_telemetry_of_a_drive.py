"""What operators are told of a whole drive: lines of the log, figures of workers, one trace. And what they are not."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from opentelemetry.sdk.trace import ReadableSpan
from opentelemetry.sdk.trace.export import SimpleSpanProcessor
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter
from prometheus_client.parser import text_string_to_metric_families
from typer.testing import CliRunner

from app.cli import app
from app.core.telemetry import tracing
from app.drives.worker import run_worker
from app.roads import imports as road_imports
from log_lines import Lines, logged
from processing_support import HEADER

COORDINATE = re.compile(r"\d{1,3}\.\d{4,}")
STAGES = {"reading", "positioning", "roads", "estimating", "saving"}


@pytest.fixture
def roads(web: Any, files: Path) -> Any:
    """A service that knows the town's roads."""
    road_imports.import_roads(web.sessions, files / "town.osm", web.settings.dem_dir)
    return web


def upload(service: Any, content: bytes, name: str = "max.mustermann.csv") -> str:
    answer = service.client.post("/v1/drives?method=raw", files={"file": (name, content)})
    assert answer.status_code == 202, answer.text
    return str(answer.json()["id"])


def of_drive(lines: Lines, drive: str) -> list[dict[str, Any]]:
    return [line for line in lines.all() if line.get("drive") == drive]


def test_the_lines_of_a_whole_drive_hold_ids_and_no_place(roads: Any, files: Path) -> None:
    log = (files / "0.csv").read_bytes()
    with logged() as lines:
        drive = upload(roads, log)
        run_worker(roads.settings, wait=False)
        run_worker(roads.settings, wait=False)  # what was asked for last
        roads.client.get(f"/v1/drives/{drive}/track")
        assert roads.client.delete(f"/v1/drives/{drive}").status_code == 202
        run_worker(roads.settings, wait=False)
        run_worker(roads.settings, wait=False)
    told = [line for line in of_drive(lines, drive) if line["event"] != "request"]
    assert [line["event"] for line in told] == [
        "drive uploaded",
        "drive started",
        "drive computed",
        "drive done",
        "drive cancelled",
        "drive deleted",
    ]
    uploaded, started, computed, done, cancelled, _ = told
    assert uploaded["request"] and cancelled["request"] != uploaded["request"]
    assert started["job"] == computed["job"] and started["waited_s"] >= 0
    assert {f"{stage}_s" for stage in STAGES} <= computed.keys()
    assert done["km"] > 0.5 and done["segments"] == computed["segments"] > 5 and done["warnings"] >= 0
    solved = [line for line in lines.all("cells solved") if line["kind"] == "marked"]
    assert sum(line["cells"] for line in solved) >= 1
    assert COORDINATE.search(lines.text) is None
    assert "mustermann" not in lines.text
    some = re.search(rb"\n[^,]+,(\d+\.\d+),(\d+\.\d+)", log)
    assert some is not None
    assert not any(place.decode()[:7] in lines.text for place in some.groups())


def test_the_name_of_a_file_is_told_at_debug(roads: Any, files: Path) -> None:
    with logged(logging.DEBUG) as lines:
        upload(roads, (files / "0.csv").read_bytes())
    assert lines.one("drive's file")["filename"] == "max.mustermann.csv"


def test_a_failure_is_told_with_its_kind_and_reason(roads: Any) -> None:
    with logged() as lines:
        drive = upload(roads, HEADER + b"nonsense")
        run_worker(roads.settings, wait=False)
    failed = lines.one("drive failed")
    assert (failed["drive"], failed["kind"], failed["stage"]) == (drive, "empty-log", "read rows")
    assert failed["level"] == "INFO"
    assert len(failed["reason"]) > 20


def figures(service: Any) -> dict[tuple[str, frozenset[tuple[str, str]]], float]:
    families = text_string_to_metric_families(service.client.get("/metrics").text)
    return {(s.name, frozenset(s.labels.items())): s.value for family in families for s in family.samples}


def test_what_workers_count_is_exposed_by_the_api_and_never_falls(roads: Any, files: Path) -> None:
    def value(name: str, **labels: str) -> float:
        return seen.get((name, frozenset(labels.items())), 0.0)

    upload(roads, (files / "0.csv").read_bytes())
    upload(roads, HEADER + b"nonsense")
    run_worker(roads.settings, wait=False)
    run_worker(roads.settings, wait=False)
    seen = figures(roads)
    assert value("versant_drives_done_total", method="raw") == 1
    assert value("versant_drives_failed_total", method="raw", kind="empty-log") == 1
    assert value("versant_failures", kind="empty-log") == 1
    for stage in STAGES | {"publishing"}:
        runs = 2 if stage == "reading" else 1
        assert value("versant_drive_stage_seconds_count", stage=stage, method="raw") == runs
        assert value("versant_drive_stage_seconds_bucket", stage=stage, method="raw", le="+Inf") == runs
    assert value("versant_drive_queued_seconds_count") == 2
    assert value("versant_solve_seconds_count", kind="marked") >= 1
    assert value("versant_cells_solved_total", kind="marked") >= 1
    assert value("versant_lock_wait_seconds_count", lock="share_network") >= 1
    assert value("versant_lock_wait_seconds_count", lock="own_hours") >= 1
    before = seen
    upload(roads, (files / "1.csv").read_bytes())
    run_worker(roads.settings, wait=False)  # another worker, which has counted nothing yet
    seen = figures(roads)
    counters = [key for key in before if key[0].endswith(("_total", "_count", "_bucket", "_sum"))]
    assert all(seen[key] >= before[key] for key in counters)
    assert value("versant_drive_queued_seconds_count") == 3


def test_an_import_by_a_command_is_counted_and_told(
    web: Any, files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VERSANT_DATABASE_URL", web.settings.database_url)
    monkeypatch.setenv("VERSANT_DATA_DIR", str(tmp_path))
    monkeypatch.setattr("app.cli.database.lower_priority", lambda: None)
    (tmp_path / "no.osm").write_text("<osm version='0.6'></osm>")
    with logged() as lines:
        done = CliRunner().invoke(app, ["import-roads", str(files / "town.osm")])
        failed = CliRunner().invoke(app, ["import-roads", str(tmp_path / "no.osm")])
    assert (done.exit_code, failed.exit_code) == (0, 1)
    assert len(failed.stderr.splitlines()) == 1
    line = lines.one("roads imported")
    assert line["added"] > 100 and line["seconds"] > 0
    assert "no drivable way" in lines.one("import of roads failed")["reason"]
    seen = figures(web)
    for outcome in ("done", "failed"):
        labels = frozenset({("kind", "roads"), ("outcome", outcome)})
        assert seen["versant_imports_total", labels] == 1
    assert seen["versant_import_seconds_count", frozenset({("kind", "roads")})] == 1
    assert seen["versant_lock_wait_seconds_count", frozenset({("lock", "share_network")})] >= 1


@pytest.fixture
def traced() -> Iterator[Callable[[], tuple[ReadableSpan, ...]]]:
    """The spans that have ended, by a collector in memory: nothing is sent."""
    exporter = InMemorySpanExporter()
    tracing.begin_tracing_to(SimpleSpanProcessor(exporter), "test")
    yield exporter.get_finished_spans
    tracing.end_tracing()


def test_a_trace_goes_on_from_the_request_to_the_worker(
    roads: Any, files: Path, traced: Callable[[], tuple[ReadableSpan, ...]]
) -> None:
    outer = "0af7651916cd43dd8448eb211c80319c"
    headers = {"traceparent": f"00-{outer}-b7ad6b7169203331-01"}
    answer = roads.client.post(
        "/v1/drives?method=raw", files={"file": ("x.csv", (files / "0.csv").read_bytes())}, headers=headers
    )
    drive = answer.json()["id"]
    run_worker(roads.settings, wait=False)
    run_worker(roads.settings, wait=False)
    spans = {span.name: span for span in traced()}
    request, run = spans["POST /v1/drives"], spans["drive"]
    assert f"{request.context.trace_id:032x}" == outer
    assert run.context.trace_id == request.context.trace_id
    assert run.parent is not None and run.parent.span_id == request.context.span_id
    for stage in STAGES:
        of_stage = spans[f"drive {stage}"]
        assert of_stage.parent is not None and of_stage.parent.span_id == run.context.span_id
        assert (of_stage.attributes or {})["versant.drive"] == drive
    assert (run.attributes or {})["versant.outcome"] == "done"
    solves = [
        span for span in traced() if span.name == "solve"
    ]  # a solver that found nothing left is one too
    assert sum((span.attributes or {})["versant.cells"] for span in solves) >= 1
    said = " ".join(str(dict(span.attributes or {})) for span in traced())
    assert COORDINATE.search(said) is None and "x.csv" not in said


def test_a_failed_run_is_a_failed_span_without_words(
    roads: Any, traced: Callable[[], tuple[ReadableSpan, ...]]
) -> None:
    upload(roads, HEADER + b"nonsense")
    run_worker(roads.settings, wait=False)
    spans = {span.name: span for span in traced()}
    for name in ("drive", "drive reading"):
        assert not spans[name].status.is_ok
        assert spans[name].events == ()
    assert (spans["drive reading"].attributes or {})["versant.error"] == "EmptyLogError"
