"""What the supervisor does about its database, told by a cluster that is none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from app.cli.console import Console
from app.cli.supervisor import LONGEST_PAUSE_S, DatabaseWatch
from app.embedded.errors import EmbeddedPostgresError


class Clock:
    """Stands for the module ``time``."""

    now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s


class Cluster:
    """Answers ``revive`` as it is told to."""

    log_path = Path("postgres.log")

    def __init__(self) -> None:
        self.asked = 0
        self.answer: bool | Exception = False

    def revive(self) -> bool:
        self.asked += 1
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr("app.cli.supervisor.time", clock)
    return clock


def watch_of(cluster: Any) -> DatabaseWatch:
    return DatabaseWatch(cluster)


def test_it_looks_once_a_second_and_speaks_only_when_it_did_something(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    cluster = Cluster()
    watch = watch_of(cluster)
    for _ in range(16):
        watch.look_after(Console())
        clock.now_s += 0.25
    assert cluster.asked == 4
    assert capsys.readouterr().err == ""
    cluster.answer = True
    watch.look_after(Console())
    (line,) = capsys.readouterr().err.splitlines()
    assert "was started again" in line
    assert "postgres.log" in line


def test_failures_are_told_in_one_line_with_growing_pauses(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    cluster = Cluster()
    watch = watch_of(cluster)
    cluster.answer = EmbeddedPostgresError("The disk is full.\nReally.")
    pauses = []
    for _ in range(8):
        watch.look_after(Console())
        pauses.append(watch.next_look_s - clock.now_s)
        clock.now_s = watch.next_look_s
    assert pauses == sorted(pauses)
    assert pauses[0] < pauses[-1] == LONGEST_PAUSE_S
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 8
    assert all("The disk is full. Really." in line for line in lines)
    cluster.answer = True
    watch.look_after(Console())
    assert watch.next_look_s - clock.now_s == pauses[0] / 2
