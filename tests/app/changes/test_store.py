"""Moments and versions: what of the changes is told up to where, and whose numbers they are."""

from __future__ import annotations

from app.changes import store
from app.core.db import Sessions


def test_a_database_begins_its_epoch_at_the_first_question_and_keeps_it(sessions: Sessions) -> None:
    with sessions() as session:
        first = store.state(session)
    with sessions() as session:
        assert store.state(session) == first
    assert not store.begin_epoch(sessions)
