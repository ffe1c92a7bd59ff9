"""Every reader with mutated files: a result or one of the library's errors, in bounded time and memory.

A failure names the seed: ``PYTHONPATH=.:tests/support python -m reader_fuzz READER SEED 0.01`` repeats it.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

from fuzz_support import FUZZ_SECONDS, fuzz_s
from reader_fuzz import READERS, mutated

ROOT = Path(__file__).parents[2]
SHARE = 1 / len(READERS)


@pytest.mark.parametrize("reader", READERS)
def test_whatever_a_file_holds_the_reader_answers(reader: str) -> None:
    # The same inputs in each run of the suite, others whenever somebody asks for more.
    seed = random.SystemRandom().randrange(2**32) if FUZZ_SECONDS in os.environ else 1
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{ROOT / 'tests' / 'support'}", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "reader_fuzz", reader, str(seed), str(SHARE * fuzz_s())]
    ended = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
    seeds = ended.stdout.split()
    assert ended.returncode == 0, (
        f"{reader} ended with {ended.returncode} at seed {seeds[-1:]}\n{ended.stderr[-3000:]}"
    )
    assert len(seeds) > 10


def test_mutations_are_those_of_their_seed() -> None:
    sample = bytes(range(256)) * 8
    seeds = [*range(50), *range(50)]
    made = [mutated(random.Random(seed), sample, [sample]) for seed in seeds]  # noqa: S311 - not for secrets
    assert made[:50] == made[50:]
    assert len(set(made[:50])) > 40
