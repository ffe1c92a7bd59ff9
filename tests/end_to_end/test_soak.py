"""A short soak: the service is used and killed at random for a while, and is right when it rests."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from soak.servers import find_pgbouncer
from tests.end_to_end.conftest import REPOSITORY, environment

SECONDS, LOGS, SEED = 30, 12, 3
ON_ONE = {"kill, API", "kill, worker", "kill, postmaster", "kill, backend"}

pytestmark = [
    pytest.mark.slow,
    pytest.mark.long("half a minute of kills and rest; what each kill does is tested beside its subject"),
]


def soaked(folder: Path, seconds: float, machines: int) -> dict[str, Any]:
    """What a soak reports, which finds nothing wrong; what was killed is in ``killed``."""
    report = folder / "soak.json"
    options = [
        "--seconds",
        str(seconds),
        "--logs",
        str(LOGS),
        "--seed",
        str(SEED),
        "--machines",
        str(machines),
    ]
    done = subprocess.run(
        [sys.executable, "-m", "soak", *options, "--json", str(report), "--keep", str(folder / "soak")],
        cwd=REPOSITORY,
        env=environment(PYTHONPATH=f"{REPOSITORY}:{REPOSITORY / 'benchmarks'}"),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    result: dict[str, Any] = json.loads(report.read_text())
    assert result["good"]
    result["killed"] = {
        act for act, ends in result["acts"].items() if "done" in ends and act.startswith("kill, ")
    }
    return result


def test_nothing_is_lost_stuck_or_doubled_when_everything_is_killed_at_random(tmp_path: Path) -> None:
    result = soaked(tmp_path, SECONDS, 1)
    assert result["killed"] == ON_ONE
    assert result["acts"]["upload"]["202"] > 3


@pytest.mark.skipif(
    find_pgbouncer() is None, reason="PgBouncer is missing (Debian: apt-get install pgbouncer)"
)
def test_nor_on_two_machines_with_a_pooler_and_a_standby(tmp_path: Path) -> None:
    result = soaked(tmp_path, 2 * SECONDS, 2)
    assert result["killed"] == ON_ONE | {"kill, PgBouncer", "kill, standby"}
    assert result["acts"]["look at the map"]["200"] > 3
    assert {row["what"] for row in result["connections"]} >= {"PgBouncer, servers", "standby, versant"}
