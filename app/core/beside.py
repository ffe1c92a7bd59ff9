"""A process beside this one, at the other end of a pipe: for what would keep this one busy. It knows no database."""

from __future__ import annotations

import subprocess
import sys
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from types import ModuleType


class Beside:
    """A process that runs a module, which gets the number of its end of the pipe as its only argument.

    Not a copy of this process, whose threads hold locks, and not by multiprocessing, which would load this program's
    commands there and start a third process to watch over them. It ends when the pipe closes.
    """

    def __init__(self, module: ModuleType) -> None:
        self.pipe, theirs = Pipe()
        with theirs:
            end = theirs.fileno()
            self.process = subprocess.Popen(  # noqa: S603 - our own program
                [sys.executable, "-m", module.__name__, str(end)],
                pass_fds=[end],
                start_new_session=True,
            )

    def close(self) -> None:
        """End the process, whatever it does."""
        self.pipe.close()
        self.process.kill()
        self.process.wait()

    @staticmethod
    def end_of_pipe() -> Connection:
        """In such a process: its end."""
        return Connection(int(sys.argv[1]))
