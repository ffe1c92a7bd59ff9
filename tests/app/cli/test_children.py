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
from pydantic import SecretStr

from app.cli import children
from app.cli.children import (
    STOP_MARGIN_S,
    Child,
    Children,
    child_environment,
    lane_count,
    sensible_lanes,
    stop_signals,
    stop_timeout_s,
    workers,
)
from app.cli.console import Console, LogConsole
from app.core.settings import Settings

REPOSITORY = Path(__file__).resolve().parents[3]
PATIENCE_S = 60.0


def compose_worker() -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load((REPOSITORY / "docker-compose.yml").read_text())
    return dict(found["services"]["worker"])


def test_a_child_reads_the_settings_of_its_parent_but_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    secret = SecretStr("of the proxy")
    settings = Settings(proxy_secret=secret, trusted_proxies="10.0.0.1", access="keys", key=SecretStr("mine"))
    for name, value in child_environment(settings).items():
        monkeypatch.setenv(name, value)
    assert Settings() == settings.model_copy(update={"key": None})


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
    assert lane_count(Settings()) == expected
    assert lane_count(Settings(worker_concurrency=3)) == 3


def test_lanes_share_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(children, "_cores", lambda: 8)
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv("NUMBA_NUM_THREADS", "7")
    of_two, alone = workers(Settings(worker_concurrency=2)), workers(Settings(worker_concurrency=1))
    assert of_two.environment["OMP_NUM_THREADS"] == "4"
    assert of_two.environment["NUMBA_NUM_THREADS"] == "7"
    assert "OMP_NUM_THREADS" not in alone.environment


def test_a_child_that_wants_to_be_begun_anew_is_at_once_and_without_a_word(
    caplog: pytest.LogCaptureFixture,
) -> None:
    ends = [sys.executable, "-c", f"raise SystemExit({children.BEGIN_ANEW})"]
    child = Child("worker 2", ends, {})
    child.start()
    assert child.process is not None
    child.process.wait(PATIENCE_S)
    child.command = [sys.executable, "-c", ""]
    with caplog.at_level(logging.INFO):
        child.look_after(LogConsole())
    assert child.process is not None
    assert child.process.wait(PATIENCE_S) == 0
    child.let_go()
    assert not caplog.records


def test_whoever_looks_after_lanes_speaks_json_where_the_lanes_do(caplog: pytest.LogCaptureFixture) -> None:
    ended = Child("worker 2", [sys.executable, "-c", "raise SystemExit(3)"], {})
    ended.start()
    assert ended.process is not None
    ended.process.wait(PATIENCE_S)
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
