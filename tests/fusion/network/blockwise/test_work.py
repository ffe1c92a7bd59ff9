"""Work is done in order, and each result is handed over once."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from threading import Lock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.network.blockwise.work import EACH_WAITING, done


class Watch:
    """Takes down what began after what, and how many jobs run at once."""

    def __init__(self) -> None:
        self.over: set[int] = set()
        self.before: dict[int, set[int]] = {}
        self.lock = Lock()

    def work(self, number: int) -> int:
        """A job."""
        with self.lock:
            self.before[number] = set(self.over)
        with self.lock:
            self.over.add(number)
        return number**2


@given(count=st.integers(0, 60), hands=st.integers(0, 3), run=st.integers(1, 5), data=st.data())
def test_jobs_begin_after_those_before_them(count: int, hands: int, run: int, data: st.DataObject) -> None:
    """One by one, or so many together."""
    before = {
        n: sorted(data.draw(st.sets(st.integers(0, n - 1), max_size=3))) if n else [] for n in range(count)
    }
    watch = Watch()
    if hands:
        with ThreadPoolExecutor(hands) as executor:
            found = list(
                done(
                    executor, range(count), before, lambda n: (watch.work, n), hands, np.arange(count) // run
                )
            )
    else:
        found = list(done(None, range(count), before, lambda n: (watch.work, n)))
    assert sorted(found) == [(n, n**2) for n in range(count)]
    assert all(set(former) <= watch.before[n] for n, former in before.items())


def test_jobs_are_made_when_their_turn_comes() -> None:
    """What is sent and what has not been taken never piles up."""
    made = []

    def job(number: int) -> tuple[object, int]:
        made.append(number)
        return abs, number

    with ThreadPoolExecutor(2) as executor:
        results = done(executor, range(100), {}, job, hands=3)
        next(results)
        assert len(made) == 3 * EACH_WAITING
        assert len(list(results)) == 99


def fail(number: int) -> int:
    """A job that fails."""
    raise ValueError(f"not {number}")


@pytest.mark.parametrize("hands", [0, 2])
def test_the_error_of_a_job_is_raised(hands: int) -> None:
    with ThreadPoolExecutor(hands or 1) as executor, pytest.raises(ValueError, match="not 0"):
        list(done(executor if hands else None, range(1), {}, lambda n: (fail, n)))
