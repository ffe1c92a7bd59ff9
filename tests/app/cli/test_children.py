"""Lanes of a worker, and the times that stopping takes, from the inside out."""

from __future__ import annotations

import logging
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import yaml

from app.cli import children
from app.cli.children import (
    STOP_MARGIN_S,
    Child,
    Children,
    lanes,
    sensible_lanes,
    stop_signals,
    stop_timeout_s,
)
from app.cli.console import Console, LogConsole
from app.core.settings import Settings

REPOSITORY = Path(__file__).resolve().parents[3]
PATIENCE_S = 60.0


def compose_worker() -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load((REPOSITORY / "docker-compose.yml").read_text())
    return dict(found["services"]["worker"])


def test_whoever_stops_a_worker_waits_for_longer_than_it_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    for grace_s in (Settings().grace_s, 0.5, 600.0):
        assert stop_timeout_s(Settings(grace_s=grace_s)) == grace_s + STOP_MARGIN_S
    worker = compose_worker()
    monkeypatch.setenv("VERSANT_GRACE_S", worker["environment"]["VERSANT_GRACE_S"])
    patience = re.fullmatch(r"(\d+)s", worker["stop_grace_period"])
    assert patience is not None
    assert float(patience[1]) >= stop_timeout_s(Settings()) + STOP_MARGIN_S


@pytest.mark.parametrize(
    ("cores", "memory_gib", "expected"), [(1, 64, 1), (4, 64, 4), (4, 2, 2), (4, 0.5, 1), (128, 512, 8)]
)
def test_as_many_lanes_as_make_sense(
    monkeypatch: pytest.MonkeyPatch, cores: int, memory_gib: float, expected: int
) -> None:
    monkeypatch.setattr(children, "_cores", lambda: cores)
    monkeypatch.setattr(children, "_memory_bytes", lambda: int(memory_gib * 2**30))
    assert sensible_lanes() == expected
    assert len(lanes(Settings())) == expected
    assert len(lanes(Settings(worker_concurrency=3))) == 3


def test_lanes_share_the_cores_and_one_does_the_chores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(children, "_cores", lambda: 8)
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv("NUMBA_NUM_THREADS", "7")
    made = lanes(Settings(worker_concurrency=2))
    assert [child.name for child in made] == ["worker 1", "worker 2"]
    assert [child.environment["OMP_NUM_THREADS"] for child in made] == ["4", "4"]
    assert [child.environment["NUMBA_NUM_THREADS"] for child in made] == ["7", "7"]
    assert ["--without-chores" in child.command for child in made] == [False, True]
    (alone,) = lanes(Settings(worker_concurrency=1))
    assert alone.name == "worker"
    assert "OMP_NUM_THREADS" not in alone.environment


def test_whoever_looks_after_lanes_speaks_json_where_the_lanes_do(caplog: pytest.LogCaptureFixture) -> None:
    ended = Child("worker 2", [sys.executable, "-c", "raise SystemExit(3)"], {})
    ended.start()
    assert ended.process is not None and ended.process.stdin is not None
    ended.process.wait(PATIENCE_S)
    ended.process.stdin.close()
    with caplog.at_level(logging.INFO):
        ended.look_after(LogConsole())
        LogConsole().note("Stopped.")
    assert [(one.levelname, one.getMessage()) for one in caplog.records] == [
        ("WARNING", "the worker 2 ended with status 3; starting it again in 2 s."),
        ("INFO", "Stopped."),
    ]


def sleeper(*, deaf: bool) -> Child:
    """A process that ends by SIGTERM, or does not."""
    hear = "signal.signal(signal.SIGTERM, signal.SIG_IGN); " if deaf else ""
    program = f"import signal, time, sys; {hear}print('ready', file=sys.stderr, flush=True); time.sleep(600)"
    return Child("sleeper", [sys.executable, "-c", program], {})


@pytest.mark.slow
@pytest.mark.parametrize("deaf", [False, True])
def test_children_end_with_their_block(deaf: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(children, "STOP_MARGIN_S", 0.5)
    child = sleeper(deaf=deaf)
    with Children(Settings(grace_s=0.5), Console(), [child]):
        process = child.process
        assert process is not None
        time.sleep(0.5 if deaf else 0.0)  # until it is deaf
    assert process.returncode is not None
    assert child.process is None


def test_a_signal_while_a_child_starts_loses_no_child(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[subprocess.Popen[bytes]] = []

    class Interrupted(subprocess.Popen):  # type: ignore[type-arg]
        """Is there, as a process, when the signal comes, and not yet as an object."""

        def __init__(self, *args: Any, **options: Any) -> None:
            super().__init__(*args, **options)
            made.append(self)
            signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(subprocess, "Popen", Interrupted)
    reached = False
    with stop_signals(), Children(Settings(grace_s=5.0), Console(), [sleeper(deaf=False)]):
        reached = True
    assert not reached
    (process,) = made
    assert process.returncode is not None


@pytest.mark.slow
def test_a_lane_that_ends_is_started_again_and_all_end_with_the_worker(
    database_url: str, tmp_path: Path
) -> None:
    environment = children.child_environment(
        Settings(database_url=database_url, data_dir=tmp_path, worker_concurrency=2, grace_s=2.0)
    )
    command = [sys.executable, "-m", "app.cli", "worker"]

    def lanes_of(parent: int) -> set[int]:
        listed = Path(f"/proc/{parent}/task/{parent}/children").read_text()
        return {int(number) for number in listed.split()}

    with subprocess.Popen(
        command, cwd=REPOSITORY, env=environment, stderr=subprocess.PIPE, text=True
    ) as parent:
        try:
            first = await_lanes(lambda: lanes_of(parent.pid), set())
            assert len(first) == 2
            subprocess.run(["kill", "-9", str(max(first))], check=True)
            second = await_lanes(lambda: lanes_of(parent.pid), first)
            assert len(second & first) == 1
            parent.terminate()
            _, said = parent.communicate(timeout=PATIENCE_S)
        finally:
            parent.kill()
    assert parent.returncode == 0
    assert re.search(r"the worker [12] ended with status -9", said)
    assert not [number for number in second if Path(f"/proc/{number}").exists()]


def await_lanes(look: Any, former: set[int]) -> set[int]:
    """Two that are not the former two."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        found: set[int] = look()
        if len(found) == 2 and found != former:
            return found
        assert time.monotonic() < deadline
        time.sleep(0.05)
