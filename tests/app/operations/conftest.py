"""A worker's part in a word, and files to be imported."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import pytest
from sqlalchemy import text

from app.drives.batches.touched import queue_touched
from app.jobs.context import JobContext
from app.jobs.requests.run import perform
from app.jobs.task import Work
from app.operations.run import OPERATION
from web_fixtures import Web


@pytest.fixture
def work() -> Callable[..., list[str]]:
    """``work(web)``: what a worker does with all operations that wait; how each ended."""

    def run(web: Web, **changes: Any) -> list[str]:
        context = JobContext(web.settings.model_copy(update=changes), web.sessions, queue_touched)
        query = "SELECT id FROM operations WHERE status IN ('queued', 'running') ORDER BY created_at, id"
        with web.sessions() as session:
            numbers = list(session.execute(text(query)).scalars())
        return [perform(OPERATION, context, number, Work(bool, nullcontext)) for number in numbers]

    return run
