"""A worker's lanes: processes forked from one that has loaded everything, so that they share its memory.

A lane by itself would take two hundred megabytes before its first drive. The parent imports what lanes run and loads
the machine code of the default method. It has no event loop, no thread of Python and no connection, which a fork would
break: what listens for jobs (``app.jobs.listening``) is forked beside the lanes. It never runs a loop of OpenMP
(``compiled_parallel``): GNU's cannot be continued in a fork. It compiles nothing either: that is a program of its own
(``compiling``), since memory that the compiler has taken never comes back.
"""

from __future__ import annotations

import gc
import logging
import os
import select
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.context import ForkProcess
from typing import NoReturn

from app.cli import compiling
from app.cli.children import (
    BEGIN_ANEW,
    STOP_MARGIN_S,
    STOPPING,
    Child,
    Children,
    Process,
    lane_count,
    stop_with_parent,
)
from app.cli.console import Console
from app.core.background import lower_priority
from app.core.messages import say
from app.core.settings import Settings
from app.core.telemetry.logs import begin_logging
from app.core.telemetry.tracing import begin_tracing, end_tracing
from app.drives.worker import run_worker
from app.jobs.listening import listen

_EARLIER_S = STOP_MARGIN_S / 2
"""Lanes are stopped earlier than this process, which its parent kills after the full margin."""
_LOOK_EVERY_S = 0.05
_COMPILE = (sys.executable, "-m", "app.cli.compiling")


class Forked(ForkProcess):
    """A process that was forked from this one to run something and end; asked for as ``subprocess.Popen`` is."""

    def __init__(self, work: Callable[[], int]) -> None:
        """``work`` returns the exit status; it begins with the usual treatment of signals, in a session of its own."""
        super().__init__()
        self._work = work
        self._held = signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)
        self.start()
        signal.pthread_sigmask(signal.SIG_SETMASK, self._held)

    def run(self) -> NoReturn:
        """Do it in the forked process, which ends with it: nothing that its parent had begun goes on there."""
        status = 1
        try:
            for number in STOPPING:
                signal.signal(number, signal.SIG_DFL)
            signal.pthread_sigmask(signal.SIG_SETMASK, self._held)
            os.setsid()
            status = self._work()
        except BaseException:  # as the interpreter would at its end
            traceback.print_exc()
        finally:
            with suppress(Exception):
                logging.shutdown()
                sys.stdout.flush()
                sys.stderr.flush()
            os._exit(status)

    def poll(self) -> int | None:
        """Exit status, the signal's number below zero; None while it runs."""
        return self.exitcode

    def wait(self, timeout: float | None = None) -> int:
        """Exit status once it has ended; raises ``subprocess.TimeoutExpired`` after ``timeout`` seconds."""
        self.join(timeout)
        if self.exitcode is None:
            raise subprocess.TimeoutExpired("lane", timeout or 0.0)
        return self.exitcode


@dataclass
class Lane(Child):
    """A lane; ``run`` returns its exit status."""

    run: Callable[[], int] = field(kw_only=True)

    def begun(self) -> Process:
        """Fork it."""
        return Forked(self.run)


@dataclass
class Lanes(Children):
    """All lanes of a worker and their listener; use as a context manager, after loading what they share."""

    earlier_s: float = _EARLIER_S
    prepare: Callable[[Settings], object] = field(kw_only=True)
    """What a lane does first, in its own process; it raises where there is nothing to work on."""
    ends: tuple[int, int] = field(default_factory=os.pipe)
    """A pipe into which nothing is written: the lanes find its other end closed when this process is gone."""
    wakes: list[tuple[int, int]] = field(default_factory=list)
    """A pipe for each lane, by which the listener tells it of jobs."""

    def __post_init__(self) -> None:
        count = lane_count(self.settings)
        names = ["worker"] if count == 1 else [f"worker {number}" for number in range(1, count + 1)]
        self.wakes = [os.pipe() for _ in names]
        listens = self.settings.listen_url is not None
        self.children = [
            *([Lane("listener", (), {}, run=self._listener)] if listens else []),
            *(Lane(name, (), {}, run=self._lane(number)) for number, name in enumerate(names, 1)),
        ]

    def _watch_parent(self) -> None:
        reading, writing = self.ends
        os.close(writing)
        os.dup2(reading, sys.stdin.fileno())
        os.close(reading)

    def _listener(self) -> int:
        self._watch_parent()
        begin_logging(self.settings, "listener")
        lower_priority()
        listen(str(self.settings.listen_url), [writing for _, writing in self.wakes], sys.stdin.fileno())
        return 0

    def _lane(self, number: int) -> Callable[[], int]:
        def run() -> int:
            self._watch_parent()
            process = f"worker {number}"
            begin_logging(self.settings, process)
            stop_with_parent()
            lower_priority()
            self.prepare(self.settings)
            begin_tracing(self.settings, process)
            wakes, _ = self.wakes[number - 1]
            again = run_worker(
                self.settings,
                with_chores=number == 1,
                derives=number == 2,  # two lanes of a machine do at most
                process=process,
                renewed=True,
                wakes=wakes,
            )
            end_tracing()
            return BEGIN_ANEW if again else 0

        return run


class ParentWatch:
    """Ends this process, as Ctrl-C would, once its standard input closes because the parent has ended."""

    def look_after(self, console: Console) -> None:
        """Look without waiting, and without a thread."""
        readable, _, _ = select.select([sys.stdin], [], [], 0)
        if readable and not os.read(sys.stdin.fileno(), 4096):
            raise KeyboardInterrupt


@contextmanager
def _compiler(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """Compile in a process of its own, beside whatever else happens; it ends with the block."""
    process = subprocess.Popen([*_COMPILE, *arguments], stdin=subprocess.DEVNULL)  # noqa: S603
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()


def serve(settings: Settings, console: Console, prepare: Callable[[Settings], object]) -> None:
    """Load what lanes share and keep them running until a signal interrupts (``stop_signals``) or the parent is gone.

    ``prepare`` is what a lane does first; it raises where there is nothing to work on.
    """
    watch, can_compile = ParentWatch(), compiling.can_be_kept()
    if can_compile and not compiling.is_compiled(first=True):
        console.note(say("up.compiled"))
        with _compiler("--first", "--processes", "2") as process:
            while process.poll() is None:
                watch.look_after(console)  # which may end this
                time.sleep(_LOOK_EVERY_S)
    lower_priority()  # all drives waited for what was compiled; from here on requests go before them
    compiling.load()
    gc.collect()
    # A collection writes into the header of every object it looks at: without this each lane would soon have its own
    # copy of all shared pages (`benchmarks/service/lane_memory.py`).
    gc.freeze()
    with ExitStack() as stack:
        lanes = stack.enter_context(Lanes(settings, console, prepare=prepare))
        if can_compile and not compiling.is_compiled():
            stack.enter_context(_compiler())
        lanes.look_after_all([watch])
