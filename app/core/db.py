"""Engine and sessions, and what passes between Python and PostgreSQL. Knows no table and no statement.

One style of database access: synchronous SQLAlchemy over psycopg 3. Vector tiles alone have another one
(``app.map.tiles.connections``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import psycopg
import sqlalchemy
from numpy.typing import NDArray
from psycopg import Connection
from psycopg.adapt import Buffer, Dumper, PyFormat
from psycopg.pq import Format
from sqlalchemy import Engine, create_engine, event
from sqlalchemy.engine import ExceptionContext
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session, sessionmaker
from sqlalchemy.pool import ConnectionPoolEntry, QueuePool
from sqlalchemy.util.queue import Empty

from app.core.background import lower_server_priority
from app.core.settings.places import sqlalchemy_url

Sessions = sessionmaker[Session]

Bounds = tuple[float, float, float, float]
"""(west, south, east, north), degrees."""

# Every request is short: parallel workers and just-in-time compilation take longer to begin than it takes to
# answer (PostGIS functions are declared so costly that the planner would often choose them). What is asked for is in a
# few places of large tables: for disks that turn, which the server's own value is of, the planner would read all of it.
_SERVER_OPTIONS = {
    "timezone": "UTC",
    "jit": "off",
    "max_parallel_workers_per_gather": "0",
    "random_page_cost": "1.1",
}


@dataclass(frozen=True)
class Patience:
    """How long a process waits for the database before it gives up, seconds."""

    statement_s: float
    """For one statement to end, its locks included."""
    lock_s: float
    """For one lock."""
    connection_s: float
    """For a free connection of the pool, or a new one to the server."""


def _server_options(patience: Patience | None, schema: str | None) -> dict[str, str]:
    options = _SERVER_OPTIONS if schema is None else _SERVER_OPTIONS | {"search_path": f"{schema},public"}
    if patience is None:
        return options
    statement_ms, lock_ms = round(1000 * patience.statement_s), round(1000 * patience.lock_s)
    return options | {"statement_timeout": str(statement_ms), "lock_timeout": str(lock_ms)}


def server_options(patience: Patience | None, schema: str | None = None) -> str:
    """Options of the server for a connection. Tables that ``schema`` has are its own, all others the live ones."""
    return " ".join(f"-c {name}={value}" for name, value in _server_options(patience, schema).items())


def transaction_options(patience: Patience | None, schema: str | None = None) -> bytes:
    """The same as statements, for one transaction: a pooler gives the next one to another connection."""
    options = _server_options(patience, schema).items()
    return "; ".join(f"SET LOCAL {name} TO {value}" for name, value in options).encode()


class ClosingPool(QueuePool):
    """Closes what comes back after it was given up: a thread that outlives its server still has a connection."""

    _sqla_logger_namespace = (
        "sqlalchemy.pool"  # a library's own words are logged as such, not as the service's
    )
    _given_up = False

    def dispose(self) -> None:
        self._given_up = True
        super().dispose()

    def _do_return_conn(self, record: ConnectionPoolEntry) -> None:
        super()._do_return_conn(record)
        if self._given_up:
            super().dispose()


class PatientPool(ClosingPool):
    """Waits for a moment before it makes one more connection than it keeps: most are in use for milliseconds."""

    WAIT_S: ClassVar[float] = 0.25

    def _do_get(self) -> ConnectionPoolEntry:
        if self.overflow() >= 0:  # all that it keeps are made
            with suppress(Empty):
                return self._pool.get(True, self.WAIT_S)
        return super()._do_get()


def make_engine(
    url: str,
    *,
    pool_size: int = 5,
    max_overflow: int = 10,
    patience: Patience | None = None,
    background: bool = False,
    schema: str | None = None,
    pooled: bool = False,
) -> Engine:
    """An engine whose connections are checked before use, so that a restarted database costs no request.

    Without ``patience`` statements and locks take as long as they take: workers and imports have nobody who waits.
    ``background``: connections have background priority at a server on this machine (``app.core.background``), and are
    as few as can be (``PatientPool``).
    ``schema``: as ``server_options`` has it. ``pooled``: connections are those of a pooler in transaction mode, and
    nothing is kept in one beyond a transaction.
    """
    limits: dict[str, Any] = {}
    if patience is not None:
        # libpq takes whole seconds, at least two.
        limits["connect_timeout"] = max(2, math.ceil(patience.connection_s))
    engine = create_engine(
        sqlalchemy_url(url),
        poolclass=PatientPool if background else ClosingPool,
        pool_pre_ping=True,
        hide_parameters=True,  # errors are logged, and boxes and places are parameters
        pool_size=pool_size,
        max_overflow=max_overflow,
        pool_timeout=30.0 if patience is None else patience.connection_s,
        connect_args={
            **({"prepare_threshold": None} if pooled else {"options": server_options(patience, schema)}),
            "application_name": "versant",
            **limits,
        },
    )
    event.listen(engine, "handle_error", _replace_lost)
    if pooled:
        begin = transaction_options(patience, schema)
        begin_with(engine, lambda connection: _driver(connection).execute(begin))
    if background:
        event.listen(engine, "connect", lambda connection, _record: lower_server_priority(connection))
    return engine


def begin_with(engine: Engine, work: Callable[[sqlalchemy.Connection], object]) -> None:
    """Begin every transaction of ``engine`` with this; where the driver fails there, it is an error of SQLAlchemy's as
    of any other statement, and the connection is not kept."""

    def begin(connection: sqlalchemy.Connection) -> None:
        try:
            work(connection)
        except psycopg.Error as error:
            # What fails in a hook is not its own to SQLAlchemy: it would roll back on a connection that is gone.
            connection.invalidate(error)
            raise _of_sqlalchemy(lost_connection(error) or error) from error

    event.listen(engine, "begin", begin)


def lost_connection(error: BaseException | None) -> psycopg.OperationalError | None:
    """What an error means that says nothing of the kind: the connection is gone; None: it means what it says.

    Where the server dies during a command, its last word and the pooler's own come as two results of that command.
    """
    if isinstance(error, psycopg.InternalError) and error.sqlstate is None:
        return psycopg.OperationalError(f"the server and what is before it ended the connection: {error}")
    return None


def _of_sqlalchemy(error: psycopg.Error) -> BaseException:
    return DBAPIError.instance(
        None, None, error, psycopg.Error, hide_parameters=True, connection_invalidated=True
    )


def _replace_lost(context: ExceptionContext) -> BaseException | None:
    lost = lost_connection(context.original_exception)
    if lost is None:
        return None
    context.is_disconnect = True
    return _of_sqlalchemy(lost)


def session_factory(engine: Engine) -> Sessions:
    """Sessions on ``engine``; use ``with sessions.begin() as session`` for one transaction."""
    return sessionmaker(engine, expire_on_commit=False)


@contextmanager
def snapshot(sessions: Sessions) -> Iterator[Session]:
    """A session that sees one moment and changes nothing: a drive that ends meanwhile is in it whole or not at all."""
    with sessions() as session:
        session.connection(
            execution_options={"isolation_level": "REPEATABLE READ", "postgresql_readonly": True}
        )
        yield session


def fetch_binary(
    session: Session, query: str, parameters: Mapping[str, Any], *, prepare: bool | None = None
) -> list[tuple[Any, ...]]:
    """The rows of a query with psycopg's placeholders, in the session's transaction.

    ``prepare=False`` is for what a client composes: each connection would keep a hundred such with their plans.
    """
    with _connection(session).cursor(binary=True) as cursor:
        return list(cursor.execute(query, parameters, prepare=prepare).fetchall())


def send_binary(session: Session, statement: str, parameters: Mapping[str, Any]) -> None:
    """Execute a statement with psycopg's placeholders (``%(name)b`` for bytes) in the session's transaction."""
    with _connection(session).cursor() as cursor:
        cursor.execute(statement, parameters)


def _connection(session: Session) -> Connection[Any]:
    return _driver(session.connection())


def _driver(on: sqlalchemy.Connection) -> Connection[Any]:
    connection: Any = on.connection.driver_connection
    assert isinstance(connection, Connection)  # noqa: S101 - the one driver that app.core.db uses
    return connection


def plain_text(value: str | None) -> Any:
    """``value`` without the NUL characters that PostgreSQL's text cannot hold."""
    return None if value is None else value.replace("\x00", "\ufffd")


def plain_json(value: Any) -> Any:
    """``value`` with what PostgreSQL's JSON cannot hold replaced: NaN, infinities by null, NUL by U+FFFD."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, str):
        return plain_text(value)
    if isinstance(value, Mapping):
        return {plain_text(str(key)): plain_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain_json(item) for item in value]
    return value


def bigints(values: Iterable[int]) -> NDArray[np.int64]:
    """Ids as a parameter: a list of thousands is written and read as text, number by number (``ArrayDumper``)."""
    return np.fromiter(values, np.int64)


_HEADER = np.dtype(">i4")


class ArrayDumper(Dumper):
    """NumPy's vectors as PostgreSQL's arrays, in binary; what a masked vector masks is NULL.

    Written as text, thousands of ids of a statement cost more than the statement. Chooses by the kind of numbers;
    raises ``psycopg.DataError`` for what has no array type of PostgreSQL here.
    """

    format = Format.BINARY

    def get_key(self, obj: NDArray[Any], format: PyFormat) -> Any:  # noqa: A002 - psycopg's name
        """One dumper for each kind of numbers."""
        return (self.cls, obj.dtype.kind)

    def upgrade(self, obj: NDArray[Any], format: PyFormat) -> Dumper:  # noqa: A002 - psycopg's name
        """The dumper of these numbers."""
        vector = _OF_KIND.get(obj.dtype.kind)
        if vector is None or obj.ndim != 1:
            raise psycopg.DataError(
                f"PostgreSQL gets vectors of numbers, not {obj.ndim} dimensions of {obj.dtype}"
            )
        return vector(self.cls)

    def dump(self, obj: NDArray[Any]) -> Buffer | None:
        """Never called: ``upgrade`` has chosen another."""
        raise NotImplementedError


class _Vector(ArrayDumper):
    """PostgreSQL's binary form: dimensions, whether there are nulls, the element's type, length, first index; then size
    and value of each, a null as a size of -1 and no value."""

    element_oid: ClassVar[int]
    value: ClassVar[np.dtype[Any]]

    def dump(self, obj: NDArray[Any]) -> Buffer:
        """The whole array."""
        if not len(obj):
            return np.array([0, 0, self.element_oid], _HEADER).tobytes()
        null = np.ma.getmaskarray(obj)
        elements = np.empty(len(obj), [("size", _HEADER), ("value", self.value)])
        elements["size"] = np.where(null, -1, self.value.itemsize)
        elements["value"] = np.ma.getdata(obj)
        written = np.ones((len(obj), elements.itemsize), bool)
        written[null, _HEADER.itemsize :] = False
        header = np.array([1, null.any(), self.element_oid, len(obj), 1], _HEADER)
        return header.tobytes() + elements.view(np.uint8).reshape(written.shape)[written].tobytes()


class _BigInts(_Vector):
    oid, element_oid, value = 1016, 20, np.dtype(">i8")


class _Doubles(_Vector):
    oid, element_oid, value = 1022, 701, np.dtype(">f8")


class _Booleans(_Vector):
    oid, element_oid, value = 1000, 16, np.dtype("?")


_OF_KIND: dict[str, type[_Vector]] = {"i": _BigInts, "f": _Doubles, "b": _Booleans}


for _vector in (np.ndarray, np.ma.MaskedArray):  # every connection that is opened from now on takes them
    psycopg.adapters.register_dumper(_vector, ArrayDumper)
