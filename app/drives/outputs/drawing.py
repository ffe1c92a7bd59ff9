"""The process that draws pictures, beside the one that answers requests, which drawing would block.

It is started with the first picture (loading matplotlib takes half a second and 100 MB), draws one at a time, and is
started again when it has ended. It gets all data of a picture at once and knows no database.
"""

from __future__ import annotations

from threading import Lock

from app.core.admission import RequestClass
from app.core.beside import Beside
from app.core.errors import NotReadyError
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
        self._beside: Beside | None = None

    def profile(
        self,
        profile: Profile,
        title: str,
        measurements: DrawnMeasurements | None,
        datum: str | None = None,
    ) -> bytes:
        """The PNG; ``NotReadyError`` when the process ends or stays silent over it."""
        with self._lock:
            for _ in range(2):  # a process that ended while idle, for lack of memory say, is noticed only now
                try:
                    return self._draw(profile, title, measurements, datum)
                except (EOFError, OSError):
                    self._stop()
        raise NotReadyError(
            "The picture could not be drawn. Ask for the profile as JSON, or try again in a moment."
        )

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._stop()

    def _draw(self, *picture: Profile | str | DrawnMeasurements | None) -> bytes:
        self._beside = self._beside or Beside(drawing_process)
        pipe = self._beside.pipe
        pipe.send(picture)
        if not pipe.poll(LONGEST_S):
            self._stop()
            raise NotReadyError(f"The picture took more than {LONGEST_S:g} s. Ask for the profile as JSON.")
        png, fault = pipe.recv()
        if fault:
            raise RuntimeError(f"the picture could not be drawn\n{fault}")
        return bytes(png)

    def _stop(self) -> None:
        if self._beside is not None:
            self._beside.close()
        self._beside = None
