"""The process that draws pictures, beside the one that answers requests, which drawing would block.

It is started with the first picture (loading matplotlib takes half a second and 100 MB), draws one at a time, and is
started again when it has ended. It gets all data of a picture at once and knows no database.
"""

from __future__ import annotations

import subprocess
import sys
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from threading import Lock

from app.core.admission import RequestClass
from app.core.errors import NotReadyError
from app.core.messages import say
from app.drives.outputs import drawing_process
from app.drives.outputs.profile import Profile
from fusion.types import DrawnMeasurements

LONGEST_S = 30.0
"""A picture of a day's drive takes some seconds."""
LONGEST_WAIT_S = 60.0


class Drawing:
    """The process, and the queue before it."""

    def __init__(self, most_waiting: int) -> None:
        self.request_class = RequestClass(1, most_waiting, LONGEST_WAIT_S)
        """Hold its place before reading the data of a picture: only one at a time is in memory."""
        self._lock = Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._pipe: Connection | None = None

    def profile(
        self,
        profile: Profile,
        title: str,
        measurements: DrawnMeasurements | None,
        datum: str | None = None,
        language: str = "en",
    ) -> bytes:
        """The PNG; ``NotReadyError`` when the process ends or stays silent over it."""
        with self._lock:
            for _ in range(2):  # a process that ended while idle, for lack of memory say, is noticed only now
                try:
                    return self._draw(profile, title, measurements, datum, language)
                except (EOFError, OSError):
                    self._stop()
        raise NotReadyError(say("service.no_picture"))

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._stop()

    def _draw(self, *picture: Profile | str | DrawnMeasurements | None) -> bytes:
        pipe = self._pipe or self._start()
        pipe.send(picture)
        if not pipe.poll(LONGEST_S):
            self._stop()
            raise NotReadyError(say("service.slow_picture", seconds=LONGEST_S))
        png, fault = pipe.recv()
        if fault:
            raise RuntimeError(f"the picture could not be drawn\n{fault}")
        return bytes(png)

    def _start(self) -> Connection:
        # Not a copy of this process, whose threads hold locks, and not by multiprocessing, which would load this
        # program's commands there and start a third process to watch over them. It ends when the pipe closes.
        ours, theirs = Pipe()
        with theirs:
            end = theirs.fileno()
            self._process = subprocess.Popen(  # noqa: S603 - our own program
                [sys.executable, "-m", drawing_process.__name__, str(end)],
                pass_fds=[end],
                start_new_session=True,
            )
        self._pipe = ours
        return ours

    def _stop(self) -> None:
        if self._pipe is not None:
            self._pipe.close()
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        self._pipe = self._process = None
