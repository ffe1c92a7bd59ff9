"""An owner is removed: nobody is let in as it at once, its drives are cancelled, and what is left goes piece by piece.

One transaction notes the removal, revokes the keys and deletes what is beside the drives. From it on no drive comes: an
upload that ends then finds the owner gone (``app.access.store.hold_owner``). Drives are cancelled as many at once are
(``app.drives.batches.removing``), by the request, and by workers where it is cut off: they look after all that is open,
again and again, and delete the owner's row when no drive is left. Knows no SQL.
"""

from __future__ import annotations

import logging
import uuid

from sqlalchemy.exc import IntegrityError, SQLAlchemyError
from sqlalchemy.orm import Session

from app.core.blobs import BlobStore
from app.core.caller import OPERATOR_OWNER, seeing_all
from app.core.db import Sessions
from app.core.errors import BadRequestError, ForbiddenError
from app.core.http import existing
from app.core.messages import say
from app.core.telemetry import audit
from app.core.telemetry.logs import tell
from app.drives.batches.documents import Selection, Which
from app.drives.batches.removing import remove_all
from app.drives.batches.removing_store import Targets
from app.drives.person import store

LOOK_EVERY_S = 5.0
"""How often a worker looks after removals."""

logger = logging.getLogger(__name__)


def remove_owner(sessions: Sessions, exports: BlobStore, owner_id: int, name: str, origin: str) -> uuid.UUID:
    """Begin the removal of the owner, or find the one that somebody asked for; its id.

    ``name`` confirms which owner is meant. When this returns, nobody is let in as the owner, and nothing of it is shown
    but for what a worker goes on with.
    """
    if owner_id == OPERATOR_OWNER:
        raise ForbiddenError(say("access.operators_stays"))
    with sessions.begin() as session:
        with seeing_all(session):
            removal_id, files = _begin(session, owner_id, name)
        if files is not None:
            audit.note(session, origin, "owner removed", f"owner {owner_id}")
    if files is not None:
        tell(logger, "removal of an owner asked for", owner=owner_id)
        try:
            _cancel_drives(sessions, owner_id)
            for key in files:
                exports.delete(key)
        except (SQLAlchemyError, OSError) as error:  # the removal is noted, and its receipt has to be told
            logger.warning("workers go on with the removal of owner %d: %s", owner_id, error)
    return removal_id


def _begin(session: Session, owner_id: int, name: str) -> tuple[uuid.UUID, list[str] | None]:
    """The removal, and the blobs that nobody refers to any more; None where it had been asked for before."""
    present = store.hold(session, owner_id)
    if (before := store.removal_of(session, owner_id)) is not None:
        return before, None
    if existing(present, "owner", owner_id) != name:
        raise BadRequestError.about("name", say("access.not_its_name"))
    removal_id = store.begin(session, owner_id, name, store.counts_of(session, owner_id))
    return removal_id, store.clear(session, owner_id)


def look_after(sessions: Sessions, exports: BlobStore) -> None:
    """A worker's part: go on with removals, and end those of which nothing is left."""
    with sessions() as session:
        owners = store.open_removals(session)
    for owner_id in owners:
        _cancel_drives(sessions, owner_id)
        try:
            files = _end(sessions, owner_id)
        except IntegrityError:
            logger.info("something of owner %d was made just now: it is removed with the next look", owner_id)
            continue
        for key in files:
            exports.delete(key)


def _cancel_drives(sessions: Sessions, owner_id: int) -> None:
    selection = Selection(which=Which.ALL, force=True)
    targets = Targets(selection=selection, method=None, ids=None, drives_of=owner_id, whatever_they_do=True)
    remove_all(sessions, targets, None)


def _end(sessions: Sessions, owner_id: int) -> list[str]:
    with sessions.begin() as session:
        if not store.take(session, owner_id) or store.has_drives(session, owner_id):
            return []
        files = store.clear(session, owner_id)
        store.end(session, owner_id)
    tell(logger, "owner removed", owner=owner_id)
    return files
