"""The service that is attacked, as ``versant up`` starts it in a folder, and the memory of its processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

from accuracy.arguments import REPOSITORY
from hostile.well_behaved import request
from service.processes import run_command
from service.watching import children, command_of, descendants, pss_mb, repeated

START_S, STOP_S = 180.0, 60.0
LOOK_EVERY_S = 0.25
LIMITED = ("/bin/sh", "-c", 'ulimit -S -n 1024; exec "$0" "$@"')
"""As a login shell has it: so many files and connections, unless a program asks for more."""


@dataclass
class Memory:
    """The most memory that any one process of each kind had since the last ``take``, MB (PSS; Linux)."""

    most_mb: dict[str, float] = field(default_factory=dict)

    def note(self, role: str, mb: float) -> None:
        """One look at one process."""
        self.most_mb[role] = max(self.most_mb.get(role, 0.0), mb)

    def take(self) -> dict[str, float]:
        """The figures, and begin anew."""
        peak_mb, self.most_mb = self.most_mb, {}
        return peak_mb


@dataclass
class Attacked:
    """A running service."""

    folder: Path
    process: subprocess.Popen[str]
    port: int
    memory: Memory = field(default_factory=Memory)

    def command(self, *arguments: str) -> None:
        """Run a command on its database; ends the program where it fails."""
        run_command([*arguments, "--data-dir", str(self.folder / "data")], environment(), REPOSITORY)

    def get(self, path: str) -> tuple[int, bytes]:
        """Status and body; status 0 where there was no answer."""
        return request(self.port, "GET", path)

    def look(self) -> None:
        """Note what each of its processes takes now."""
        for child in children(self.process.pid):
            role = "api" if "api" in command_of(child) else "worker"
            for pid in (child, *descendants(child)):
                self.memory.note(role, pss_mb(pid))
        with suppress(OSError, ValueError):
            postmaster = int((self.folder / "data/postgres/data/postmaster.pid").read_text().split()[0])
            for pid in children(postmaster):
                self.memory.note("backend", pss_mb(pid))


@contextmanager
def attacked(folder: Path) -> Iterator[Attacked]:
    """Start ``versant up`` in the folder, and watch its memory until the block ends."""
    log = folder / "service.log"
    with log.open("w") as output:
        process = subprocess.Popen(
            [*LIMITED, sys.executable, "-m", "app.cli", "up", "--data-dir", str(folder / "data"), "--port", "0"],
            cwd=REPOSITORY, env=environment(), stdout=subprocess.PIPE, stderr=output, text=True, start_new_session=True,
        )  # fmt: skip
    try:
        service = Attacked(folder, process, _port_of(process, log))
        with repeated(service.look, LOOK_EVERY_S):
            yield service
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def environment() -> dict[str, str]:
    """Without settings of whoever runs this: every bound is the default one, and whoever attacks needs no key."""
    ours = {name: value for name, value in os.environ.items() if not name.startswith("VERSANT_")}
    return {
        **ours,
        "PYTHONPATH": f"{REPOSITORY}:{REPOSITORY / 'benchmarks'}",
        "VERSANT_ACCESS": "open",
        "VERSANT_LOG_LEVEL": "WARNING",
        "PYTHONUNBUFFERED": "1",
    }


def _port_of(process: subprocess.Popen[str], log: Path) -> int:
    """From the line that says where the service is ready."""
    assert process.stdout is not None  # noqa: S101 - asked for above
    ends = time.monotonic() + START_S
    for line in process.stdout:
        if "ready at http" in line:
            port = urlsplit(line.split("ready at ")[1].split()[0]).port
            threading.Thread(
                target=process.stdout.read, daemon=True
            ).start()  # else a full pipe would stop it
            return port or 80
        if time.monotonic() > ends:
            break
    sys.exit(f"The service did not start: {log.read_text()[-2000:]}")
