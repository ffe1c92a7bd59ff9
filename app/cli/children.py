"""Child processes that are kept running and stopped within a stated time: the service's parts, a worker's lanes.

They are commands here; ``lanes`` forks its children instead.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Protocol, Self

from pydantic import SecretStr

from app.cli.console import Console
from app.core.messages import say
from app.core.settings import ENV_PREFIX, Settings

STOP_MARGIN_S = 5.0
"""Added to the grace of children, within which they end unless the machine is overloaded."""

BEGIN_ANEW = 75
"""Exit status of a child that ended in order, to be started again at once (EX_TEMPFAIL)."""

LONGEST_PAUSE_S = 30.0  # between two attempts to start what keeps ending
STEADY_S = 60.0  # a child that ran this long is no longer in a series of crashes
MOST_LANES = 8
MEMORY_PER_LANE_BYTES = 2**30
_LOOK_EVERY_S = 0.2
STOPPING = (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
_MEMORY_LIMIT = Path("/sys/fs/cgroup/memory.max")


class Process(Protocol):
    """A child's process, with the methods of ``subprocess.Popen`` that are used."""

    @property
    def pid(self) -> int | None:
        """None before it was started."""

    def poll(self) -> int | None:
        """Exit status, None while it runs."""

    def wait(self, timeout: float | None = None) -> int:
        """Exit status once it has ended; raises ``subprocess.TimeoutExpired`` after ``timeout`` seconds."""

    def terminate(self) -> None:
        """Ask it to end."""

    def kill(self) -> None:
        """End it."""


@dataclass
class Child:
    """One process, restarted with growing pauses while it keeps ending by itself."""

    name: str
    command: Sequence[str]
    environment: dict[str, str]
    process: Process | None = None
    started_s: float = 0.0
    restart_s: float = 0.0
    pause_s: float = 1.0

    def start(self) -> None:
        """Start it in its own session: a Ctrl-C in the terminal is for the parent, which stops everything.

        The pipe at its standard input is never written to. It closes when the parent dies, however it dies.
        No signal interrupts this, since nobody would stop a child that is not recorded yet.
        """
        self.started_s = time.monotonic()
        with _signals_held():
            self.process = self.begun()

    def begun(self) -> Process:
        """Start its process."""
        return subprocess.Popen(  # noqa: S603 - our own program with our own arguments
            self.command, env=self.environment, stdin=subprocess.PIPE, start_new_session=True
        )

    def let_go(self) -> None:
        """Forget the process, which has ended."""
        pipe = getattr(self.process, "stdin", None)
        if pipe is not None:
            pipe.close()
        self.process = None

    def look_after(self, console: Console) -> None:
        """Start it again if it has ended, after a pause that doubles from crash to crash."""
        now = time.monotonic()
        ended = None if self.process is None else self.process.poll()
        if ended is not None:
            self.pause_s = 1.0 if now - self.started_s > STEADY_S else min(self.pause_s * 2, LONGEST_PAUSE_S)
            self.restart_s = now + self.pause_s
            if ended == BEGIN_ANEW:
                self.pause_s, self.restart_s = 1.0, now
            else:
                console.complain(say("up.child_ended", name=self.name, status=ended, seconds=self.pause_s))
            self.let_go()
        if self.process is None and now >= self.restart_s:
            self.start()

    @property
    def running(self) -> bool:
        """Whether the process is there."""
        return self.process is not None and self.process.poll() is None


class Watched(Protocol):
    """Something that is checked again and again."""

    def look_after(self, console: Console) -> None:
        """Repair what has failed, and report it."""


@dataclass
class Children:
    """Several of them; use as a context manager."""

    settings: Settings
    console: Console
    children: list[Child] = field(default_factory=list)
    earlier_s: float = 0.0
    """Seconds by which these children are killed before others."""

    def __enter__(self) -> Self:
        try:
            for child in self.children:
                child.start()
            self.await_ready()
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def await_ready(self) -> None:
        """Return once they can be used."""

    def look_after_all(self, others: Sequence[Watched] = ()) -> None:
        """Look after ``others`` and the children until a signal interrupts (``stop_signals``)."""
        while True:
            time.sleep(_LOOK_EVERY_S)
            for one in (*others, *self.children):
                one.look_after(self.console)

    def stop(self) -> None:
        """End every child: asked first, killed after ``stop_timeout_s``; no signal interrupts this."""
        with _signals_handled(signal.SIG_IGN):
            running = [c.process for c in self.children if c.process is not None and c.running]
            for process in running:
                process.terminate()
            deadline = time.monotonic() + stop_timeout_s(self.settings) - self.earlier_s
            for process in running:
                try:
                    process.wait(max(deadline - time.monotonic(), 0.01))
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
            for child in self.children:
                child.let_go()


def stop_timeout_s(settings: Settings) -> float:
    """How long children are waited for that were asked to stop."""
    return settings.grace_s + STOP_MARGIN_S


def versant(*arguments: str) -> list[str]:
    """A command of ours that stops with this process."""
    return [sys.executable, "-m", "app.cli", *arguments, "--stop-with-parent"]


def workers(settings: Settings) -> Child:
    """The process that has the lanes (``app.cli.lanes``): each computes with its share of the cores."""
    count = lane_count(settings)
    threads = str(max(1, _cores() // count))
    shares = dict.fromkeys(_THREADS, threads) if count > 1 else {}
    environment = shares | child_environment(settings)  # what is set by hand stays
    return Child("workers", versant("worker"), environment)


def lane_count(settings: Settings) -> int:
    """Lanes that compute side by side: as many as the settings want."""
    return settings.worker_concurrency or sensible_lanes()


def sensible_lanes() -> int:
    """One for each core that this process may use, as far as memory goes."""
    return max(1, min(_cores(), _memory_bytes() // MEMORY_PER_LANE_BYTES, MOST_LANES))


def _cores() -> int:
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not everywhere
        return os.cpu_count() or 1


def _memory_bytes() -> int:
    """Of the machine, or of the container."""
    installed = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    with contextlib.suppress(OSError, ValueError):  # no such limit, or "max"
        installed = min(installed, int(_MEMORY_LIMIT.read_text()))
    return installed


def child_environment(settings: Settings) -> dict[str, str]:
    """The environment in which a child reads exactly these settings."""
    # Without the key: that is for commands that ask a service.
    changed = settings.model_dump(mode="json", exclude_none=True, exclude={"key"})
    secrets = {name: value.get_secret_value() for name, value in settings if isinstance(value, SecretStr)}
    ours = {ENV_PREFIX + name.upper(): str(secrets.get(name, value)) for name, value in changed.items()}
    return {name: v for name, v in os.environ.items() if not name.startswith(ENV_PREFIX)} | ours


@contextmanager
def stop_signals() -> Iterator[None]:
    """Let SIGTERM and SIGHUP do what Ctrl-C does: leave the block by ``KeyboardInterrupt``, caught here."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    with contextlib.suppress(KeyboardInterrupt), _signals_handled(interrupt):
        yield


def stop_with_parent() -> None:
    """End this process as by SIGTERM once its standard input closes, as it does when the parent dies."""

    def watch() -> None:
        while os.read(sys.stdin.fileno(), 4096):
            pass
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _signals_held() -> Iterator[None]:
    """Let what would stop this process wait until the block has ended."""
    came: list[int] = []
    with _signals_handled(lambda number, frame: came.append(number)):
        yield
    if came:
        signal.raise_signal(came[0])


@contextmanager
def _signals_handled(handler: Callable[[int, FrameType | None], object] | signal.Handlers) -> Iterator[None]:
    """Treat the signals that stop this process so within the block; outside the main thread none arrive."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    former = {number: signal.signal(number, handler) for number in STOPPING}
    try:
        yield
    finally:
        for number, former_handler in former.items():
            signal.signal(number, former_handler)
