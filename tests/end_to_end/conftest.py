"""A real ``versant up`` in its own process, on the simulated town."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import pytest

from app.cli.client import Client
from fusion.simulate.demonstration import Demonstration, write_all

REPOSITORY = Path(__file__).resolve().parents[2]
START_S, STOP_S, COMMAND_S = 90.0, 40.0, 120.0
PROC = Path("/proc")


FIRST = "test_service.py"
"""Compares the whole map with what was uploaded, so that nobody may have uploaded before."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the tests of this folder first: one process takes them all, and they share one service."""
    here = Path(__file__).parent
    items.sort(
        key=lambda item: (item.path.parent != here, item.path.parent == here and item.path.name != FIRST)
    )


def environment(**extra: str) -> dict[str, str]:
    """No Versant setting of the person who runs the tests, and no colours."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("VERSANT_")}
    return clean | {"TERM": "dumb", "PYTHONUNBUFFERED": "1"} | extra


def versant(*arguments: str | Path, timeout_s: float = COMMAND_S) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    return subprocess.run(
        [sys.executable, "-m", "app.cli", *map(str, arguments)],
        cwd=REPOSITORY,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )


@dataclass
class Up:
    """A running ``versant up``; every process below it carries a mark in its environment."""

    data_dir: Path
    mark: str = field(default_factory=lambda: f"versant-test-{uuid.uuid4().hex}")
    address: str = ""
    starts: int = 0

    def start(self, *extra: str) -> Up:
        """Start it on a free port and wait until it says that it is ready."""
        self.starts += 1
        self.log = self.data_dir.parent / f"{self.mark}-{self.starts}.log"
        command = [sys.executable, "-m", "app.cli", "up", "--data-dir", str(self.data_dir), "--port", "0"]
        with self.log.open("w") as said:
            self.process = subprocess.Popen(
                [*command, *extra],
                cwd=REPOSITORY,
                env=environment(RUN_MARK=self.mark),
                stdout=said,
                stderr=subprocess.STDOUT,
                # As at a terminal: a process group of its own, to which Ctrl-C goes.
                process_group=0,
            )
        deadline = time.monotonic() + START_S
        while not (found := re.search(r"ready at (http://\S+)", self.said())):
            assert self.process.poll() is None, self.said()
            assert time.monotonic() < deadline, self.said()
            time.sleep(0.1)
        self.address = found.group(1)
        return self

    @property
    def key(self) -> str:
        """The operator's key, which it made in its data folder."""
        return (self.data_dir / "operator.key").read_text().strip()

    def client(self) -> Client:
        """Asks it by that key."""
        return Client(self.address, key=self.key)

    def http(self) -> httpx.Client:
        """The same for whatever is not asked by our own client."""
        shown = {"Authorization": f"Bearer {self.key}"}
        return httpx.Client(base_url=self.address, timeout=30, trust_env=False, headers=shown)

    def said(self) -> str:
        """Everything it printed since its last start."""
        return self.log.read_text()

    def interrupt(self) -> int:
        """Ctrl-C: a SIGINT to the whole process group; returns the exit status."""
        os.killpg(self.process.pid, signal.SIGINT)
        return self.process.wait(STOP_S)

    def processes(self, *words: str) -> list[int]:
        """Ids of its living processes, those with all ``words`` among their arguments."""
        found = []
        for entry in PROC.glob("[0-9]*"):
            try:
                marked = self.mark.encode() in (entry / "environ").read_bytes()
                arguments = (entry / "cmdline").read_bytes().split(b"\0")
            except OSError:
                continue
            if marked and arguments != [b""] and all(word.encode() in arguments for word in words):
                found.append(int(entry.name))
        return found

    def close(self) -> None:
        """Leave nothing behind, whatever the test did."""
        if self.starts and self.process.poll() is None:
            self.process.terminate()
            self.process.wait(STOP_S)
        for pid in self.processes():
            os.kill(pid, signal.SIGKILL)


def await_true(condition: Callable[[], object], timeout_s: float, what: str) -> None:
    """Fail with ``what`` unless the condition comes true in time."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.1)


@pytest.fixture(scope="session")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    """The town with three short drives: CSV, UBX, CSV."""
    return write_all(tmp_path_factory.mktemp("town"), 3, seed=1, duration_s=100.0)


@pytest.fixture(scope="session")
def running(simulated: Demonstration, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Up]:
    """One service for all modules, with the town's roads and elevations imported while it runs."""
    up = Up(tmp_path_factory.mktemp("up") / "data").start()
    try:
        for command, file in (("import-roads", simulated.osm), ("import-dem", simulated.dem)):
            done = versant(command, "--data-dir", up.data_dir, file)
            assert done.returncode == 0, done.stderr
        yield up
    finally:
        up.close()


@pytest.fixture
def idle(tmp_path: Path) -> Iterator[Up]:
    """A service of the test's own, not started."""
    up = Up(tmp_path / "data")
    yield up
    up.close()
