"""How long the fuzzers of ``tests/fuzz`` go on: seconds in ``make test``, a minute in ``make test-all``."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator

FUZZ_SECONDS = "FUZZ_SECONDS"
"""Environment variable: seconds for each fuzzer."""
SECONDS_IN_THE_SUITE = 6.0


def fuzz_s() -> float:
    """Seconds that each fuzzer may take."""
    return float(os.environ.get(FUZZ_SECONDS, SECONDS_IN_THE_SUITE))


def rounds(share: float = 1.0) -> Iterator[int]:
    """Numbers of rounds, from 0 on, until that share of the time is over; always at least one."""
    deadline = time.monotonic() + share * fuzz_s()
    number = 0
    while number == 0 or time.monotonic() < deadline:
        yield number
        number += 1


def first_seed() -> int:
    """The seed of the first round; others count on from it. The same in every run of the suite, random under ``make
    fuzz``; printed, so that a failure can be repeated.
    """
    seed = int.from_bytes(os.urandom(4)) if FUZZ_SECONDS in os.environ else 0
    print(f"first seed: {seed}")  # noqa: T201
    return seed
