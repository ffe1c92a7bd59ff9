"""A short soak: the service is used and killed at random for a while, and is right when it rests."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.end_to_end.conftest import REPOSITORY, environment

SECONDS, LOGS, SEED = 30, 12, 3

pytestmark = [
    pytest.mark.slow,
    pytest.mark.long("half a minute of kills and rest; what each kill does is tested beside its subject"),
]


def test_nothing_is_lost_stuck_or_doubled_when_everything_is_killed_at_random(tmp_path: Path) -> None:
    report = tmp_path / "soak.json"
    options = ["--seconds", str(SECONDS), "--logs", str(LOGS), "--seed", str(SEED), "--json", str(report)]
    done = subprocess.run(
        [sys.executable, "-m", "soak", *options, "--keep", str(tmp_path / "soak")],
        cwd=REPOSITORY,
        env=environment(PYTHONPATH=f"{REPOSITORY}:{REPOSITORY / 'benchmarks'}"),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads(report.read_text())
    assert result["good"]
    kills = {act for act, ends in result["acts"].items() if act.startswith("kill, ") and "done" in ends}
    assert kills == {"kill, API", "kill, worker", "kill, postmaster", "kill, backend"}
    assert result["acts"]["upload"]["202"] > 3
