"""Databases of the embedded cluster for benchmarks that work on them without the service's processes."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from contextlib import contextmanager

from sqlalchemy.orm import Session

from app.core import databases, migrate
from app.core.db import Sessions, make_engine, session_factory
from app.drives import claims
from app.drives import store as drives
from app.drives.documents import Drive
from app.embedded.cluster import EmbeddedPostgres


@contextmanager
def sessions_of(url: str) -> Iterator[Sessions]:
    """Sessions on a database until the block ends."""
    engine = make_engine(url)
    try:
        yield session_factory(engine)
    finally:
        engine.dispose()


@contextmanager
def new_database(cluster: EmbeddedPostgres, name: str) -> Iterator[Sessions]:
    """The same on one of this name, of the present schema, which is made where it is not there."""
    databases.ensure_database(cluster.url, name)
    migrate.upgrade(cluster.url_of(name), finish=True)
    with sessions_of(cluster.url_of(name)) as sessions:
        yield sessions


def vacuum(sessions: Sessions) -> None:
    """Let the tables be what they are once the background has been through them."""
    with sessions() as session:
        session.connection(execution_options={"isolation_level": "AUTOCOMMIT"}).exec_driver_sql(
            "VACUUM ANALYZE"
        )


def begun_drive(session: Session, method: str = "profile") -> Drive:
    """A drive that a worker has begun."""
    key = uuid.uuid4().hex
    drive, _ = drives.create_drive(
        session, sha256=f"{key:0>64}", filename=f"{key}.csv", size_bytes=10, blob_key=f"drives/{key}",
        method=method, options={},
    )  # fmt: skip
    if not claims.mark_running(session, drive.id, drive.generation):
        raise RuntimeError("somebody else took the drive")
    return drive
