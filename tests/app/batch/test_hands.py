"""Who does the work: workers that die are replaced, and logs that kill are found and named."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cloudpickle
import pytest

from app.batch.folder import BatchError
from app.batch.hands import DEATHS, Hands, hands

cloudpickle.register_pickle_by_value(sys.modules[__name__])


@pytest.fixture(scope="module")
def two() -> Iterator[Hands]:
    with hands(None, 2, "2GB") as found:
        yield found


@dataclass(frozen=True)
class Deadly:
    """Work on logs that kill as often as they say; each death leaves a file."""

    folder: Path
    logs: tuple[int, ...]

    @property
    def is_done(self) -> bool:
        return False

    def work(self, without: frozenset[int] = frozenset()) -> None:
        for k in range(len(self.logs)):
            if k not in without:
                self.alone(k)
        (self.folder / "done").write_text(" ".join(map(str, sorted(without))))

    def alone(self, k: int) -> None:
        deaths = len(list(self.folder.glob(f"{k}-*")))
        if deaths < self.logs[k]:
            (self.folder / f"{k}-{deaths}").touch()
            os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.slow
def test_a_task_whose_worker_dies_is_done_again(two: Hands, tmp_path: Path) -> None:
    job = Deadly(tmp_path, (0, DEATHS - 1, 0))
    assert list(two.done([job])) == [job]
    assert (tmp_path / "done").read_text() == ""


@pytest.mark.slow
def test_a_log_that_kills_is_left_out_and_the_others_are_not(two: Hands, tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    deadly, harmless = Deadly(tmp_path / "a", (0, 1000, 0)), Deadly(tmp_path / "b", (0, 0))
    assert set(two.done([deadly, harmless])) == {deadly, harmless}
    assert (tmp_path / "a" / "done").read_text() == "1"
    assert (tmp_path / "b" / "done").read_text() == ""


@dataclass(frozen=True)
class Greedy(Deadly):
    """Work on logs that take so many MB."""

    def alone(self, k: int) -> None:
        held = bytearray(self.logs[k] << 20)
        for at in range(0, len(held), 4096):
            held[at] = 1
        time.sleep(1.0 if self.logs[k] else 0.0)


@pytest.mark.long("a worker is started seven times")
def test_a_log_that_takes_more_memory_than_a_worker_may_is_left_out(tmp_path: Path) -> None:
    with hands(None, 1, "700MB") as small:
        job = Greedy(tmp_path, (0, 800, 100))
        assert list(small.done([job])) == [job]
    assert (tmp_path / "done").read_text() == "1"


def test_an_error_of_a_task_is_raised(two: Hands) -> None:
    with pytest.raises(ZeroDivisionError):
        list(two.results([0], lambda k: (divmod, 1, k)))


def test_results_come_with_their_items_however_many_there_are(two: Hands) -> None:
    assert dict(two.results(range(50), lambda k: (pow, k, 2))) == {k: k * k for k in range(50)}


def test_workers_compute_by_one_thread_each(two: Hands) -> None:
    ((_, threads),) = two.results([0], lambda _: (os.environ.get, "OPENBLAS_NUM_THREADS"))
    assert threads == "1"


@pytest.mark.slow
def test_workers_with_another_version_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """As those of a scheduler elsewhere may be, which would answer something else, or never."""
    monkeypatch.setattr("app.core.version.__version__", "0.0.1")
    with (
        pytest.raises(BatchError, match=r"has Versant \S+, and this is 0\.0\.1: install"),
        hands(None, 1, None),
    ):
        pass


def test_without_dask_it_is_said_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(BatchError, match=r"versant\[batch\]"), hands(None, 1, None):
        pass
