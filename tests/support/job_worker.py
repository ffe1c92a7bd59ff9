"""A worker with tasks that misbehave, as a program of its own: ``python job_worker.py SETTINGS_JSON``.

A task writes what happens to it into the table ``happened``.
"""

from __future__ import annotations

import sys
import threading
import time
from contextlib import nullcontext
from typing import Any

from sqlalchemy import text

from app.core.db import Sessions, make_engine, session_factory
from app.core.settings import Settings
from app.jobs.task import Interrupted, Kind, Task, Work
from app.jobs.worker import Worker, in_thread

LOCK = 4711
_WAIT = text(f"SELECT pg_advisory_xact_lock({LOCK})")


def happened(sessions: Sessions, what: str) -> None:
    """Note it."""
    with sessions.begin() as session:
        session.execute(text("INSERT INTO happened VALUES (:what)"), {"what": what})


def tasks_of(sessions: Sessions) -> list[Task]:
    """One for each way in which a run may hang."""

    def wait_for_lock() -> None:
        with sessions.begin() as session:
            session.execute(_WAIT)

    def look_without_end(work: Work) -> None:
        while not work.should_stop():
            time.sleep(0.02)
        raise Interrupted

    def task(name: str, run: Any, *, computes: bool = True) -> Task:
        def perform(work: Work, **_: Any) -> str:
            with work.computing() if computes else nullcontext():
                happened(sessions, f"{name} runs")
                run(work)
            return "done"

        return Task(
            Kind(name),
            perform,
            give_up=lambda kind, reason, **_: happened(sessions, f"{name} given up, {kind}: {reason}"),
            put_back=lambda **_: happened(sessions, f"{name} put back"),
        )

    return [
        task("quick", lambda _: None),
        task("long", lambda _: time.sleep(6.0)),  # and ends then
        task("loop", look_without_end),
        task("deaf", lambda _: threading.Event().wait()),  # as machine code that nothing reaches
        task("lock", lambda _: wait_for_lock(), computes=False),
    ]


def main(settings: Settings) -> None:
    """Work until stopped; the chore waits for the lock where ``data_dir`` says so."""
    engine = make_engine(str(settings.database_url), pool_size=1, max_overflow=3)
    sessions = session_factory(engine)

    def chore() -> None:
        happened(sessions, "chore runs")
        with sessions.begin() as session:
            session.execute(_WAIT)

    chores = [(in_thread(chore, "cancelled"), 60.0)] if settings.data_dir.name == "chore" else []
    Worker(settings, engine, sessions, tasks_of(sessions)).run(chores, wait=True, stop_event=None)


if __name__ == "__main__":
    main(Settings.model_validate_json(sys.argv[1]))
