"""What a process may ask for: so much beyond what it has by then."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from app.jobs.runs import Runs

ASKING = """
import numpy as np
from app.jobs.memory import limit_growth
MIB = 2**17  # float64
held = []
for _ in range(3):
    limit_growth(200 * 2**20)
    held.append(np.ones(150 * MIB))
    try:
        np.ones(150 * MIB)
    except MemoryError:
        print("no more")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone limits what a process asks for")
def test_each_run_may_ask_for_so_much_anew() -> None:
    done = subprocess.run([sys.executable, "-c", ASKING], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n") == ["no more"] * 3 + [""]


def test_a_run_begins_with_what_is_to_be_done_before_each() -> None:
    """The limit is set there: once for a process it held for all its drives together."""
    alive: Any = SimpleNamespace(deaths=lambda _: 0, forget=lambda _: None)
    job: Any = SimpleNamespace(job=SimpleNamespace(id=1, queueing_lock=None, worker_id=1, priority=0))
    told: list[str] = []

    def run(_work: object) -> str:
        told.append("run")
        return "done"

    task: Any = SimpleNamespace(run=run)
    runs = Runs(alive, 60.0)
    runs.before_each = lambda: told.append("before")
    assert [runs.perform(task, job, {}) for _ in range(2)] == ["done", "done"]
    assert told == ["before", "run", "before", "run"]
