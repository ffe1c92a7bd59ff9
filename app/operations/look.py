"""How a run of an operation looks around: whether it is to go on, whether others wait, how far it is."""

from __future__ import annotations

import time
from collections.abc import Callable

from app.core.db import Sessions
from app.jobs.task import Interrupted
from app.operations import store
from app.operations.documents import Operation

LOOK_EVERY_S = 0.5
"""How often a run looks whether it is to go on, and shows how far it is."""
OTHERS_WAIT_S = 2.0
"""Once something that goes first has waited for so long, no lane is free but that of the operation."""
SLICE_S = 20.0
"""An operation lets others go first at once, then after so long, twice, four times as long: it comes to its end."""


class Unwanted(Exception):  # noqa: N818  (no error: somebody cancelled the operation)
    """The operation is no longer this run's."""


class Look:
    """Of one run; its ``progress`` is what the work reports to."""

    def __init__(self, sessions: Sessions, operation: Operation, should_stop: Callable[[], bool]) -> None:
        self._sessions, self.operation, self._should_stop = sessions, operation, should_stop
        self._began_s = time.monotonic()
        self._looked_s = self._waited_since_s = -float("inf")
        self._stage = ""
        self._slice_s = SLICE_S * (2**operation.yields - 1)
        self.yielded = False

    def progress(self, stage: str, share: float) -> None:
        """So much of this stage is done; raises where the run is to end."""
        now_s = time.monotonic()
        if now_s - self._looked_s < LOOK_EVERY_S and stage == self._stage:
            return
        if self._should_stop():
            raise Interrupted
        self._looked_s, self._stage = now_s, stage
        with self._sessions.begin() as session:
            if not store.set_progress(session, self.operation, stage, min(max(share, 0.0), 1.0)):
                raise Unwanted
            waiting = store.others_wait(session)
        self._let_others_go_first(waiting, now_s)

    def note(self, **state: object) -> None:
        """Keep what a later run has to know."""
        with self._sessions.begin() as session:
            if not store.set_state(session, self.operation, **state):
                raise Unwanted

    def _let_others_go_first(self, waiting: bool, now_s: float) -> None:
        if not waiting:
            self._waited_since_s = -float("inf")
        elif self._waited_since_s == -float("inf"):
            self._waited_since_s = now_s
        elif now_s - self._waited_since_s >= OTHERS_WAIT_S and now_s - self._began_s >= self._slice_s:
            self.yielded = True
            raise Interrupted
