"""Requests in the database, of whatever table: added, claimed by a worker, put back, ended.

Each run of a request has a number. Whoever cancels or removes a request takes it away from its run, which finds that
out when it writes: ``update`` returns False then.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Self, TypeVar, cast

from pydantic import BaseModel, Field
from sqlalchemy import Select, Table, func, insert, select, text, tuple_, update
from sqlalchemy.orm import Session

from app.core.caller import has_share, seeing_all
from app.core.db import plain_json
from app.core.errors import BusyError
from app.core.messages import SAID, Said, said_in, say
from app.core.tables.requests import RequestColumns
from app.core.telemetry.logs import reason_text, said_of_failure
from app.jobs.task import Kind, add_job

NOW = func.clock_timestamp()
UNDER_WAY = ("queued", "running")


class Request(BaseModel, frozen=True, json_schema_serialization_defaults_required=True):
    """What the document of every request has, and what only the service knows of it."""

    id: uuid.UUID
    run: int = Field(exclude=True)
    yields: int = Field(exclude=True)

    if TYPE_CHECKING:  # declared by each document, at its own place in it
        status: str
        created_at: datetime


class RequestFailure(BaseModel):
    """Why a request failed, as its document tells it."""

    kind: str = Field(description="Stable identifier of the reason.")
    reason: str = Field(description="What is wrong and what to do about it.")
    said: Said | None = Field(None, description=f"The same by its key; {SAID}")

    @classmethod
    def of(cls, columns: Mapping[str, Any]) -> Self | None:
        """The reason in the columns of a row; None unless it is failed."""
        if columns["status"] != "failed":
            return None
        said = said_in(columns)["said"]
        return cls(kind=columns["failure_kind"], reason=columns["failure_reason"], said=said)


class Failure(NamedTuple):
    """Why a request failed: a stable kind, a sentence for people, the line, byte or field at fault, and the stage."""

    kind: str
    reason: str
    where: str | None = None
    stage: str | None = None


R = TypeVar("R", bound=Request)

# Two that ask for the same at the same moment: the second waits for the first to commit.
_ONE_BY_ONE = text("SELECT pg_advisory_xact_lock(hashtextextended('versant ' || :lock, 0))")

# Their job is gone: a worker of a version that did not know it took it, say.
_JOBLESS = """
    SELECT id FROM {table} AS r WHERE status IN ('queued', 'running') AND NOT EXISTS (
        SELECT FROM procrastinate_jobs AS j WHERE j.status IN ('todo', 'doing') AND j.task_name = :task
            AND j.args ->> :argument = CAST(r.id AS text))
    ORDER BY created_at FOR UPDATE SKIP LOCKED
"""

# Jobs with one lock run one after the other; of several locks a job gets the one that fewest have. A lane that died is
# counted until others take it off the list: half a minute.
_LOCK = text("""
    WITH places AS (
        SELECT generate_series(0, greatest(count(*) / :lanes, 1) - 1) AS place FROM procrastinate_workers)
    SELECT p.place FROM places AS p
    LEFT JOIN procrastinate_jobs AS j
        ON j.status IN ('todo', 'doing') AND j.lock = CASE p.place WHEN 0 THEN :lock ELSE :lock || ' ' || p.place END
    GROUP BY p.place ORDER BY count(j.id), p.place LIMIT 1
""")

# Jobs that go first, and that no lane has taken yet.
_OTHERS_WAIT = text("""
    SELECT EXISTS (
        SELECT FROM procrastinate_jobs
        WHERE status = 'todo' AND priority > :priority AND (scheduled_at IS NULL OR scheduled_at <= now()))
""")


class RequestStore(Generic[R]):
    """The rows of one table as documents, and their jobs."""

    def __init__(
        self,
        name: str,
        table: type[RequestColumns],
        document: Callable[[Mapping[str, Any]], R],
        job: Kind,
        plural: str,
        *,
        rows: Callable[[Table], Select[Any]] = select,
        on_claim: Mapping[str, Any] | None = None,
        one_of_lanes: int | None = None,
    ) -> None:
        """``name`` and ``plural``: what people call one and several; a job's argument is ``name``_id. Jobs run one
        after the other, which leaves all lanes but one to drives; or at once in one of every ``one_of_lanes`` lanes of
        all machines. ``rows`` selects what the document needs, ``on_claim`` are columns that a run begins with."""
        self.name, self.plural, self.job = name, plural, job
        self.argument = f"{name}_id"
        self._document = document
        self._table = cast(Table, table.__table__)  # type: ignore[attr-defined]
        self._rows = rows(self._table)
        self._on_claim = dict(on_claim or {})
        self._one_of_lanes = one_of_lanes
        self._jobless = text(_JOBLESS.format(table=self._table.name))

    def add(self, session: Session, **columns: Any) -> R:
        """A new one with its job."""
        number = uuid.uuid4()
        session.execute(insert(self._table).values(id=number, status="queued", **_plain(columns)))
        return self.enqueue(session, number)

    def enqueue(self, session: Session, number: uuid.UUID) -> R:
        """Add its job; the request."""
        self._add_job(session, number)
        request = self.get(session, number)
        assert request is not None  # noqa: S101 - the transaction has written it
        return request

    def one_by_one(self, session: Session) -> None:
        """Wait for others that ask for one, until the transaction ends."""
        session.execute(_ONE_BY_ONE, {"lock": self.plural})

    def require_place(self, session: Session, most: int) -> None:
        """``BusyError`` where so many wait, whoever asked for them, that no other may, or no other of this owner."""
        waiting = select(func.count()).select_from(self._table).where(self._table.c.status == "queued")
        mine = session.execute(waiting).scalar_one()
        with seeing_all(session):
            count = session.execute(waiting).scalar_one()
        if count >= most:
            raise BusyError(say("service.wait_already", n=count, plural=self.plural))
        if not has_share(mine, count, most):
            raise BusyError(say("service.yours_wait", n=mine, plural=self.plural))

    def under_way(self, session: Session) -> int:
        """How many wait or run, of those that the caller sees."""
        rows = select(func.count()).select_from(self._table).where(self._table.c.status.in_(UNDER_WAY))
        return int(session.execute(rows).scalar_one())

    def get(self, session: Session, number: uuid.UUID, **equal: Any) -> R | None:
        """The request, all of which columns are equal to these; None where there is none."""
        return self.first(session, self._where(id=number, **equal))

    def first(self, session: Session, rows: Select[Any]) -> R | None:
        """The first of these rows."""
        row = session.execute(rows.limit(1)).one_or_none()
        return None if row is None else self._document(row._asdict())

    def hold(self, session: Session, number: uuid.UUID) -> R | None:
        """The request, whose row nobody else changes until the transaction ends."""
        return self.first(session, self._where(id=number).with_for_update(of=self._table))

    def page(
        self,
        session: Session,
        *,
        limit: int | None = None,
        after: tuple[datetime, uuid.UUID] | None = None,
        **equal: Any,
    ) -> list[R]:
        """At most ``limit``, the newest first, that come after that place in this order."""
        columns = self._table.c
        rows = self._where(**equal).order_by(columns.created_at.desc(), columns.id.desc()).limit(limit)
        if after is not None:
            rows = rows.where(tuple_(columns.created_at, columns.id) < after)
        return [self._document(row._asdict()) for row in session.execute(rows)]

    def claim(self, session: Session, number: uuid.UUID) -> R | None:
        """Take one for a worker; None: it is gone, at its end, or waits for a person.

        A running one may be claimed as well: its worker may have died and its job have come back.
        """
        columns = self._table.c
        rows = self._where(id=number).where(columns.status.in_(UNDER_WAY))
        if self.first(session, rows.with_for_update(of=self._table)) is None:
            return None
        begun = {"run": columns.run + 1, "started_at": NOW, **self._on_claim}
        self.write(session, number, status="running", stage=None, progress=0, **begun)
        return self.get(session, number)

    def update(self, session: Session, request: R, **columns: Any) -> bool:
        """Write what its run has to say; False: it is no longer this run's."""
        table = self._table
        ours = (table.c.id == request.id, table.c.run == request.run, table.c.status == "running")
        written = session.execute(update(table).where(*ours).values(_plain(columns)).returning(table.c.id))
        return written.scalar() is not None

    def write(self, session: Session, number: uuid.UUID, **columns: Any) -> None:
        """Write columns, whoever's it is."""
        session.execute(update(self._table).where(self._table.c.id == number).values(_plain(columns)))

    def put_back(self, session: Session, request: R, *, yielded: bool) -> bool:
        """Let it wait again; ``yielded``: because others go first."""
        yields = self._table.c.yields + int(yielded)
        return self.update(session, request, status="queued", stage=None, progress=0, yields=yields)

    def let_wait(self, session: Session, number: uuid.UUID) -> None:
        """Let it wait again, by who knows of no run: its worker ended without a word."""
        table = self._table
        running = update(table).where(table.c.id == number, table.c.status == "running")
        session.execute(running.values(status="queued", stage=None, progress=0))

    def finish(self, session: Session, request: R, **columns: Any) -> bool:
        """It is done; False: it is no longer this run's, and nobody wants what came of it."""
        return self.update(
            session, request, status="done", stage=None, progress=1, finished_at=NOW, **columns
        )

    def fail(
        self, session: Session, number: uuid.UUID, failure: Failure, run: int | None = None, **columns: Any
    ) -> R | None:
        """It failed, unless it is at its end already or has another run than ``run``; the request as it was before."""
        before = self.hold(session, number)
        if before is None or before.status not in UNDER_WAY or run not in {None, before.run}:
            return None
        texts = {"failure_reason": failure.reason, "failure_where": failure.where, "stage": failure.stage}
        values = {name: reason_text(value) for name, value in texts.items()}
        values["failure_said"] = said_of_failure(failure.reason, failure.where)
        self.write(
            session, number, status="failed", failure_kind=failure.kind, finished_at=NOW, **values, **columns
        )
        return before

    def give_jobs(self, session: Session) -> int:
        """Give those that wait without a job one; how many."""
        values = {"task": self.job.name, "argument": self.argument}
        numbers = list(session.execute(self._jobless, values).scalars())
        for number in numbers:
            self._add_job(session, number)
        return len(numbers)

    def others_wait(self, session: Session) -> bool:
        """Whether a job waits that goes before these."""
        return bool(session.execute(_OTHERS_WAIT, {"priority": self.job.priority}).scalar_one())

    def _add_job(self, session: Session, number: uuid.UUID) -> None:
        place = 0
        if self._one_of_lanes is not None:
            values = {"lock": self.plural, "lanes": self._one_of_lanes}
            place = session.execute(_LOCK, values).scalar_one()
        lock = f"{self.plural} {place}" if place else self.plural
        add_job(session, self.job, lock=lock, **{self.argument: str(number)})

    def _where(self, **equal: Any) -> Select[Any]:
        return self._rows.where(*(self._table.c[name] == value for name, value in equal.items()))

    def referred_blobs(self, session: Session) -> set[str]:
        """The files that rows refer to."""
        key = self._table.c.blob_key
        return set(session.execute(select(key).where(key.is_not(None))).scalars())


def _plain(columns: Mapping[str, Any]) -> dict[str, Any]:
    """Values as PostgreSQL can hold them."""
    return {
        name: plain_json(value) if isinstance(value, str | dict) else value for name, value in columns.items()
    }
