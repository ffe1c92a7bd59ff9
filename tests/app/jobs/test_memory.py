"""What a process may ask for: so much beyond what it has by then."""

from __future__ import annotations

import subprocess
import sys

import pytest

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
