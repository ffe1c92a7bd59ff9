"""The service of a checkout as processes on a database, and what its database tells of it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path

import httpx
import numpy as np
import psycopg

PATIENCE_S = 3600.0
Process = subprocess.Popen[bytes]
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")


def run_command(arguments: Sequence[str], environment: Mapping[str, str], checkout: Path) -> None:
    """Run a command of a checkout to its end; what it prints is told where it fails."""
    process = subprocess.run(
        [sys.executable, "-m", "app.cli", *arguments],
        cwd=checkout, env=dict(environment), capture_output=True, text=True, check=False,
    )  # fmt: skip
    if process.returncode:
        sys.exit(f"{arguments[0]}: {process.stderr.strip()}")


def await_answer(address: str) -> None:
    """Until there is a good answer."""
    ends = time.monotonic() + 60
    while time.monotonic() < ends:
        with suppress(httpx.TransportError):
            if httpx.get(address, trust_env=False).is_success:
                return
        time.sleep(0.05)
    sys.exit(f"{address} did not answer within a minute")


@contextmanager
def ended(process: Process, within_s: float) -> Iterator[Process]:
    """Let a process go on until the block ends, and end it then."""
    try:
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(within_s)


class Service:
    """The command line of a checkout on a database, as processes that compute with so many ``threads`` each (None: as
    many as they like)."""

    def __init__(self, checkout: Path, url: str, folder: Path, threads: int | None = None) -> None:
        self.checkout, self.url = checkout, url
        self.port = 18_700 + os.getpid() % 1000
        self.address = f"http://127.0.0.1:{self.port}"
        self.worker = ("worker", "--concurrency", "1")
        ours = {
            "VERSANT_DATABASE_URL": url,
            "VERSANT_DATA_DIR": str(folder),
            "VERSANT_ACCESS": "open",
            "VERSANT_LOG_LEVEL": "WARNING",
            "PYTHONPATH": str(checkout),
            "OMP_WAIT_POLICY": "PASSIVE",
            **({} if threads is None else dict.fromkeys(THREADS, str(threads))),
        }
        self.environment: Mapping[str, str] = {
            **{name: value for name, value in os.environ.items() if not name.startswith("VERSANT_")},
            **ours,
        }

    def command(self, *arguments: str) -> None:
        """Run a command to its end; what it prints is told where it fails."""
        run_command(arguments, self.environment, self.checkout)

    def set_up(self, roads: Path, dem: Path) -> None:
        """Make the schema of an empty database, and bring in roads and heights."""
        for command in (("migrate",), ("import-roads", str(roads)), ("import-dem", str(dem))):
            self.command(*command)

    def begin(self, *arguments: str) -> Process:
        """A command as a process beside this one, in a session of its own as under ``versant up``."""
        command = [sys.executable, "-m", "app.cli", *arguments]
        return subprocess.Popen(
            command,
            cwd=self.checkout,
            env=dict(self.environment),
            stdout=subprocess.DEVNULL,
            start_new_session=True,
        )

    def started(self, *arguments: str) -> AbstractContextManager[Process]:
        """A process that goes on until the block ends."""
        return ended(self.begin(*arguments), 60)

    def await_ready(self) -> None:
        """Until the API answers."""
        await_answer(f"{self.address}/readyz")

    def send(self, log: bytes) -> str:
        """Upload a log; the drive's address."""
        answer = httpx.post(f"{self.address}/v1/drives", content=log, timeout=60, trust_env=False)
        answer.raise_for_status()
        return str(answer.headers["location"])

    def await_done(self, tell: Callable[[int], None] | None = None) -> None:
        """Until no drive waits or runs; ends the program where one failed."""
        ends = time.monotonic() + PATIENCE_S
        query = """
            SELECT count(*) FILTER (WHERE status = 'done'), count(*) FILTER (WHERE status IN ('queued', 'running')),
                   min(failure_reason) FILTER (WHERE status = 'failed') FROM drives
        """
        with psycopg.connect(self.url, autocommit=True) as connection:
            while time.monotonic() < ends:
                done, left, failure = connection.execute(query).fetchone() or (0, 0, None)
                if failure:
                    sys.exit(f"a drive failed: {failure}")
                if not left:
                    return
                if tell is not None:
                    tell(done)
                time.sleep(0.1)
        sys.exit(f"not done within {PATIENCE_S:.0f} s")

    def throughput(self, drives: int) -> tuple[float, float]:
        """Drives a second of the last so many, and the longest time of any, s."""
        query = """
            SELECT extract(epoch FROM max(finished_at) - min(started_at)),
                   max(extract(epoch FROM finished_at - started_at))
            FROM (SELECT * FROM drives ORDER BY created_at DESC LIMIT %s) AS last
        """
        with psycopg.connect(self.url) as connection:
            took, longest = connection.execute(query, (drives,)).fetchone() or (1, 0)
        return drives / float(took), float(longest)

    def alone(self, log: bytes) -> float:
        """Seconds from upload to done of one drive in an idle service."""
        time.sleep(1.5)
        begin = time.perf_counter()
        address = self.send(log)
        with httpx.Client(trust_env=False) as client:
            while client.get(address).json()["status"] in {"queued", "running"}:
                time.sleep(0.02)
        return time.perf_counter() - begin

    def moved_by_settling(self) -> tuple[float, float]:
        """By how much settling moves slopes, sigmas: 99 % by at most, and all."""
        query = "SELECT segment_id, slope_percent, slope_sigma_percent FROM segment_slopes WHERE drives > 0 ORDER BY 1"
        with psycopg.connect(self.url, autocommit=True) as connection:
            before = np.array(connection.execute(query).fetchall(), float)
            self.command("settle")
            after = np.array(connection.execute(query).fetchall(), float)
        if not np.array_equal(before[:, 0], after[:, 0]):
            sys.exit("settling published other segments")
        moved = np.abs(after[:, 1] - before[:, 1]) / after[:, 2]
        return float(np.quantile(moved, 0.99)), float(moved.max())
