"""Reading from a hot standby: whether it may be used just now, and the primary wherever it cannot.

What is read there is at most ``VERSANT_DATABASE_READ_LAG_S`` old when a request begins. That is known, not guessed from
clocks: every second the primary says how far its log is, and the standby how far it has replayed. Once it has replayed
what the primary had written at a moment, it shows everything up to that moment. An idle primary is no lag, and one that
cannot be asked makes the bound run out.

A request that reads the map asks the standby first (``Standby.first``). Where the standby cancels it, because what it
reads has to make room for what is replayed, it is asked once more, and then the primary; for any other fault of the
database the primary at once. Everything that a request reads comes from one server: it begins anew on the other.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine
from contextvars import ContextVar
from functools import partial
from threading import Lock
from time import monotonic
from typing import Any, TypeVar

import psycopg
from anyio import CapacityLimiter, to_thread
from fastapi import Request, Response
from fastapi.routing import APIRoute
from psycopg.errors import QueryCanceled
from sqlalchemy import make_url
from sqlalchemy.exc import DBAPIError, SQLAlchemyError

from app.core import migrate
from app.core.admission import MORE_CONNECTIONS
from app.core.caller import guard
from app.core.db import Patience, Sessions, make_engine, session_factory
from app.core.settings import Settings
from app.core.standby import store
from app.core.telemetry.logs import tell

Answer = TypeVar("Answer")

LOOK_EVERY_S = 1.0
LAST_LOOK_S = 5.0
"""So long the end of the process waits for a look."""
TRIES = 2
"""Of a request on the standby."""
_CONFLICT = "40"
"""The class of what a standby cancels: the same may succeed at the next try."""
_GONE = ("08", "57P", "None")
"""What is said of a connection that is gone: by the server, by a pooler, by nobody."""
_SILENT = "It does not answer."
_KEPT_ALIVE = {"keepalives_idle": "5", "keepalives_interval": "2", "keepalives_count": "3"}
"""Options of connections: a standby whose machine is gone without a word is noticed in seconds, not in hours."""

log = logging.getLogger(__name__)
_asked: ContextVar[bool] = ContextVar("whether this request reads from the standby", default=False)


def from_standby() -> bool:
    """Whether what is being answered is to be read from the standby."""
    return _asked.get()


def standby_url(settings: Settings) -> str | None:
    """Where the standby is, with the options of its connections; None: there is none."""
    if settings.database_read_url is None:
        return None
    url = make_url(settings.database_read_url)
    options = _KEPT_ALIVE | {"tcp_user_timeout": str(round(1000 * settings.database_read_lag_s))}
    return url.update_query_dict({**options, **url.query}).render_as_string(hide_password=False)


class Standby:
    """The hot standby of a process of the API. Lives in its event loop."""

    def __init__(self, url: str, settings: Settings, patience: Patience, primary: Sessions) -> None:
        """``primary``: sessions by which the primary is asked how far it is."""
        connect = partial(make_engine, url, patience=patience, pooled=settings.database_pooled)
        self._engine = guard(connect(pool_size=settings.db_pool_size, max_overflow=MORE_CONNECTIONS))
        self._probing = connect(pool_size=1, max_overflow=0)
        self.sessions = session_factory(self._engine)
        """As those of the primary, for reading."""
        self.passed_on = 0
        """Requests that the primary answered because the standby failed at them."""
        self._primary, self._probes = primary, session_factory(self._probing)
        self._most_s = settings.database_read_lag_s
        self._marks: deque[tuple[float, int]] = deque()
        """When the primary was asked, and what it had written, of what the standby may not have replayed yet."""
        self._as_of: float | None = None
        """All that had committed by then is there; None: unknown."""
        self._problem = "It has not been looked at yet."
        self._told = False
        self._looking = Lock()

    @property
    def lag_s(self) -> float | None:
        """How old what it shows is at most, seconds; None: nobody knows."""
        return None if self._as_of is None else monotonic() - self._as_of

    @property
    def used(self) -> bool:
        """Whether it follows closely enough."""
        lag_s = self.lag_s
        return lag_s is not None and lag_s <= self._most_s

    @property
    def problem(self) -> str | None:
        """Why it is not used; None: it is."""
        if self.used:
            return None
        return self._problem or f"It is more than {self._most_s:g} s behind, or cannot be compared any more."

    async def first(self, work: Callable[[], Awaitable[Answer]]) -> Answer:
        """What ``work`` answers on the standby, or else on the primary; it asks ``from_standby`` which it is."""
        for _ in range(TRIES):
            if not self.used:
                break
            token = _asked.set(True)
            try:
                return await work()
            except (psycopg.Error, DBAPIError) as error:
                cause = error.orig if isinstance(error, DBAPIError) else error
                if isinstance(cause, QueryCanceled):
                    raise  # it took too long, or its client left: nowhere else either
                state = str(getattr(cause, "sqlstate", None))
                if not state.startswith(_CONFLICT):
                    self._note_fault(cause, state)
                    break
            finally:
                _asked.reset(token)
        else:
            self.passed_on += 1
        return await work()

    def _note_fault(self, cause: BaseException | None, state: str) -> None:
        """A connection that is gone is a reason not to use the standby until it has been looked at."""
        self.passed_on += 1
        if state.startswith(_GONE) and not isinstance(cause, StandbyBehindError):
            self._as_of, self._problem = None, _SILENT

    async def run(self) -> None:
        """Look at it until cancelled."""
        turn = CapacityLimiter(1)
        while True:
            looking = asyncio.create_task(
                to_thread.run_sync(self._look, abandon_on_cancel=True, limiter=turn)
            )
            try:
                while not (await asyncio.wait({looking}, timeout=LOOK_EVERY_S))[0]:
                    self._tell()  # one that hangs is not used for long
            finally:
                looking.cancel()
            if (error := looking.exception()) is not None:
                log.error("the standby cannot be looked at", exc_info=error)
            self._tell()
            await asyncio.sleep(LOOK_EVERY_S)

    def close(self) -> None:
        """Give its connections back, those of a look that is under way when that is over; not if it hangs."""
        self._looking.acquire(timeout=LAST_LOOK_S)
        self._engine.dispose()
        self._probing.dispose()

    def _look(self) -> None:
        with self._looking:
            self._compare()

    def _compare(self) -> None:
        asked = monotonic()
        try:
            with self._primary() as session:
                here = store.written(session)
        except (SQLAlchemyError, psycopg.Error):
            self._problem = "The primary does not say how far it is."  # so the bound runs out
            return
        try:
            with self._probes() as session:
                there, standing = store.replayed(session), migrate.standing(session)
        except (SQLAlchemyError, psycopg.Error):
            self._doubt(_SILENT)
            return
        problem = store.unfit(there, here) or (None if standing.usable else standing.sentence)
        if problem is not None:
            self._doubt(problem)
            return
        self._problem = ""
        self._marks.append((asked, here.lsn))
        while self._marks and (self._marks[0][1] <= there.lsn or asked - self._marks[0][0] > self._most_s):
            moment, lsn = self._marks.popleft()
            if lsn <= there.lsn:
                self._as_of = moment

    def _doubt(self, problem: str) -> None:
        """Do not use it until it has been looked at."""
        self._as_of, self._problem = None, problem
        self._marks.clear()

    def _tell(self) -> None:
        """A line whenever it is used again, or no longer."""
        if (used := self.used) != self._told:
            self._told = used
            if used:
                tell(log, "the map is read from the standby")
            else:
                tell(log, "the map is read from the primary", level=logging.WARNING, reason=self.problem)


def standby_of(settings: Settings, patience: Patience, primary: Sessions) -> Standby | None:
    """The standby that the settings name, if they do."""
    url = standby_url(settings)
    return None if url is None else Standby(url, settings, patience, primary)


class StandbyBehindError(psycopg.OperationalError):
    """What is asked for needs data that this server does not have yet."""


class MapRoute(APIRoute):
    """A route that only reads the map, and may read it from the standby."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """The handler of its requests."""
        answer = super().get_route_handler()

        async def answer_from_either(request: Request) -> Response:
            standby: Standby | None = request.app.state.service.standby
            # Whoever follows the map goes on from a version, which is the primary's.
            if standby is None or "updated_since" in request.query_params:
                return await answer(request)
            return await standby.first(partial(answer, request))

        return answer_from_either
