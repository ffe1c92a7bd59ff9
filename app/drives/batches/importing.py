"""Drives that come with the result of ``versant batch``, in the database: which are there, and with which import.

An import is a row of ``batches``: its drives that have to be computed are followed as a batch's are. They keep its
number for good, so that all of one import can be removed. And the other way: which logs go out as an archive. Callers
own the transaction.
"""

from __future__ import annotations

import uuid
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from datetime import datetime
from typing import Any, NamedTuple

from sqlalchemy import Connection, event, text
from sqlalchemy.orm import Session, SessionTransaction

from app.core.claims import Claim
from app.core.db import Sessions
from app.core.tables import HAS_LOG, IS_SHOWN
from app.drives.queue import IMPORT

_FIND = text("""
    SELECT id FROM batches WHERE owner_id = (SELECT versant_owner()) AND selection = CAST(:selection AS jsonb)
    ORDER BY id LIMIT 1
""")
_OPEN = text(
    "INSERT INTO batches (selection, state) VALUES (CAST(:selection AS jsonb), 'enqueued') RETURNING id"
)
_NOTE = text("""
    UPDATE drives SET import_id = :number, batch_id = :number, records = coalesce(records, :records) WHERE id = :id
""")
_KNOWN = text("""
    SELECT sha256, import_id FROM drives
    WHERE owner_id = (SELECT versant_owner()) AND sha256 = ANY(CAST(:sha256 AS text[]))
""")
_STORED = f"""
    FROM drives AS d JOIN owners AS o ON o.id = d.owner_id
    WHERE {IS_SHOWN.format("d")} AND d.{HAS_LOG} AND (CAST(:owner_id AS bigint) IS NULL OR d.owner_id = :owner_id)
"""
_COUNT_STORED = text(f"SELECT count(*) {_STORED}")
_NEXT_STORED = text(f"""
    SELECT d.id, d.owner_id, o.name, d.filename, d.sha256, d.size_bytes, d.blob_key, d.method, d.options, d.created_at
    {_STORED} AND (CAST(:after_id AS uuid) IS NULL OR (d.created_at, d.id) > (:after_created_at, :after_id))
    ORDER BY d.created_at, d.id LIMIT :piece
""")
STORED_AT_ONCE = 1000
_SET_OWNER = "SELECT set_config('versant.owner', %s, true)"


def import_claim(sessions: Sessions) -> Claim:
    """To be held by whoever imports drives: one does at a time. Solvers wait meanwhile, as while drives wait."""
    return Claim(sessions, IMPORT)


@contextmanager
def on_behalf_of(sessions: Sessions, owner_id: int) -> Iterator[None]:
    """Let what a command makes in transactions of ``sessions`` be that owner's."""

    def become(_: Session, __: SessionTransaction, connection: Connection) -> None:
        connection.exec_driver_sql(_SET_OWNER, (str(owner_id),))

    event.listen(sessions, "after_begin", become)
    try:
        yield
    finally:
        event.remove(sessions, "after_begin", become)


def open_import(session: Session, archive: str) -> int:
    """The number of the present owner's import of this archive, which may have been begun before."""
    values = {"selection": f'{{"which": "import", "archive": "{archive}"}}'}
    for statement in (_FIND, _OPEN):
        if (number := session.execute(statement, values).scalar()) is not None:
            return int(number)
    raise AssertionError("a row was just made")


def note_imported(session: Session, drive_id: uuid.UUID, number: int, records: int) -> None:
    """Note with which import a drive came, and how many records its log has: they are not of the owner's quota."""
    session.execute(_NOTE, {"id": drive_id, "number": number, "records": records})


def known_logs(session: Session, sha256: Collection[str]) -> dict[str, int | None]:
    """Those of logs of these bytes that the present owner has, and with which import each came."""
    return {row.sha256: row.import_id for row in session.execute(_KNOWN, {"sha256": list(sha256)})}


class StoredLog(NamedTuple):
    """A log that the service keeps, and the drive that it is."""

    id: uuid.UUID
    owner_id: int
    owner: str
    filename: str
    sha256: str
    size_bytes: int
    blob_key: str
    method: str
    options: dict[str, Any]
    created_at: datetime


def count_stored_logs(session: Session, owner_id: int | None) -> int:
    """How many there are of that owner, or of all."""
    return int(session.execute(_COUNT_STORED, {"owner_id": owner_id}).scalar_one())


def stored_logs(session: Session, owner_id: int | None, after: StoredLog | None) -> list[StoredLog]:
    """The next ones of that owner, or of all, oldest upload first."""
    place = {"after_id": after and after.id, "after_created_at": after and after.created_at}
    rows = session.execute(_NEXT_STORED, {"owner_id": owner_id, "piece": STORED_AT_ONCE, **place})
    return [StoredLog(*row) for row in rows]
