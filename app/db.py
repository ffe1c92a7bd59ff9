"""Engine and sessions. One style of database access: synchronous SQLAlchemy over psycopg 3."""

from __future__ import annotations

from sqlalchemy import Engine, create_engine
from sqlalchemy.orm import Session, sessionmaker

from app.settings import sqlalchemy_url

Sessions = sessionmaker[Session]


# Every request is short: parallel workers and just-in-time compilation take longer to begin than it takes to
# answer (PostGIS functions are declared so costly that the planner would often choose them).
_SERVER_OPTIONS = "-c timezone=UTC -c jit=off -c max_parallel_workers_per_gather=0"


def make_engine(url: str, *, pool_size: int = 5, max_overflow: int = 10) -> Engine:
    """An engine whose connections are checked before use, so that a restarted database costs no request."""
    return create_engine(
        sqlalchemy_url(url),
        pool_pre_ping=True,
        pool_size=pool_size,
        max_overflow=max_overflow,
        connect_args={"options": _SERVER_OPTIONS, "application_name": "versant"},
    )


def session_factory(engine: Engine) -> Sessions:
    """Sessions on ``engine``; use ``with sessions.begin() as session`` for one transaction."""
    return sessionmaker(engine, expire_on_commit=False)
