"""Who is told, and when: messages are written where segments changed, and sent beside a worker's jobs.

Each worker sends in threads of its own, so many at once, and one at a time to each address: one that is slow keeps
neither others nor drives waiting. An address that fails is left alone for longer and longer, and switched off after
days; each message goes out at least once, and says by its id when it comes again.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from typing import Any

from sqlalchemy.orm import Session

from app.changes.store import Since, State, count_since, parse_since, state, text_of
from app.changes.webhooks import sending, store
from app.changes.webhooks.store import SEGMENTS_CHANGED, Due, WebhookRow
from app.core.caller import read_edition
from app.core.db import Sessions
from app.core.errors import BadQueryError, GoneError
from app.core.settings import Settings
from app.core.telemetry.logs import tell
from app.core.text import utc_text
from app.core.version import code_version
from app.jobs.task import is_connection_loss

logger = logging.getLogger(__name__)

LOOK_EVERY_S = 1.0
"""How often a worker looks for messages that are due."""
EVERY_S = 10.0
"""An address is told of changed segments at most so often."""
AT_ONCE = 8
"""Messages that one worker sends at the same time, each to another address."""
COUNTED = 100_000
"""Changes that are counted for one message; of more it says that it has not counted all."""


class Teller:
    """Writes and sends messages, beside the jobs of a worker."""

    def __init__(self, sessions: Sessions, settings: Settings) -> None:
        self._sessions, self._settings = sessions, settings
        self._free = threading.Semaphore(AT_ONCE)
        self._ended = threading.Event()

    def look(self) -> None:
        """Write what is to be told of segments, and see that what is due is sent; returns at once."""
        with self._sessions() as session:
            if not store.count_webhooks(session):
                return
        note_changes(self._sessions, EVERY_S, owners_see_editions=self._settings.owners_see_editions)
        while not self._ended.is_set() and self._free.acquire(blocking=False):
            due = None
            try:
                with self._sessions.begin() as session:
                    due = store.claim(session)
                if due is None:
                    return
                # Nobody waits for it at the end: whatever is on its way then is sent again.
                threading.Thread(target=self._send, args=(due,), name="webhook", daemon=True).start()
            finally:
                if due is None:
                    self._free.release()

    def close(self) -> None:
        """Send no more."""
        self._ended.set()

    def _send(self, due: Due | None) -> None:
        """Send a message, and then whatever else is due."""
        try:
            while due is not None:
                deliver(self._sessions, self._settings, due)
                if self._ended.is_set():
                    return
                with self._sessions.begin() as session:
                    due = store.claim(session)
        except Exception as error:
            level = logging.WARNING if is_connection_loss(error) else logging.ERROR
            logger.log(level, "a message could not be seen to; it is sent again", exc_info=True)
        finally:
            self._free.release()


def note_changes(sessions: Sessions, every_s: float, *, owners_see_editions: bool = False) -> int:
    """Write a message to each address that follows segments, where any changed; how many.

    ``owners_see_editions``: those of owners are told of changes of editions, those of operators of the live map's.
    """
    written = 0
    for of_owners in (False, True) if owners_see_editions else (None,):
        with sessions.begin() as session:
            if of_owners:
                read_edition(session)
            now = state(session)
            for webhook in store.followers(session, every_s, of_owners):
                data = _told_of(session, now, webhook)
                if data is not None:
                    store.add_message(session, webhook.id, SEGMENTS_CHANGED, data)
                    written += 1
    return written


def deliver(sessions: Sessions, settings: Settings, due: Due) -> sending.Answer:
    """One attempt at a message, and a note of what came of it."""
    began_s = time.monotonic()
    message_id, timestamp_s, body = f"msg_{due.id.hex}", int(time.time()), body_of(due)
    headers = {
        "Content-Type": "application/json",
        "User-Agent": f"Versant/{code_version()}",
        "webhook-id": message_id,
        "webhook-timestamp": str(timestamp_s),
        "webhook-signature": sending.signature(due.secret, message_id, timestamp_s, body),
    }
    answer = sending.post(
        due.url, headers, body, timeout_s=settings.webhook_timeout_s, private=settings.webhook_private
    )
    off = False
    with sessions.begin() as session:
        if answer.problem is None:
            store.note_taken(session, due, answer.status or 0)
        else:
            patience_s = 86400.0 * settings.webhook_patience_days
            off = store.note_failure(
                session, due, answer.status, answer.problem, patience_s, unwanted=answer.unwanted
            )
    outcome = "switched off" if off else "not taken" if answer.problem else "taken"
    facts: dict[str, Any] = {"webhook": due.webhook_id, "kind": due.event, "outcome": outcome}
    tell(logger, "webhook sent", **facts, status=answer.status, seconds=time.monotonic() - began_s)
    return answer


def prune(sessions: Sessions) -> None:
    """Forget messages that ended long ago."""
    with sessions.begin() as session:
        store.prune_messages(session)


def body_of(due: Due) -> bytes:
    """The message: the same at each attempt."""
    document = {"type": due.event, "timestamp": utc_text(due.created_at), "data": due.data}
    return json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()


def _told_of(session: Session, now: State, webhook: WebhookRow) -> dict[str, Any] | None:
    """What is to be told of segments; None: nothing that concerns the address."""
    until = Since(now.epoch, now.horizon)
    versions: dict[str, Any] = {"since": webhook.reported_version, "version": text_of(until)}
    try:
        since = parse_since(now, webhook.reported_version or "")
    except (BadQueryError, GoneError):
        # Of another database: what there is has to be read anew.
        return {**versions, "since": None, "segments": None, "gone": None, "counted_all": False}
    if since >= until:
        return None
    segments, gone, counted_all = count_since(session, now, since, COUNTED, webhook.bbox)
    if counted_all and not segments:
        store.set_reported_version(session, webhook.id, versions["version"])
        return None
    return {**versions, "segments": segments, "gone": gone, "counted_all": counted_all}
