"""Cycles are looked for when requests have ended that may have left some."""

from __future__ import annotations

import asyncio
import gc
import os
import subprocess
import sys

import pytest
from starlette.types import Receive, Scope, Send

from app.core import middleware
from app.core.middleware import CollectAfterRequests

AFTER_LOADING = """
import gc
import app.main
from app.core.middleware import stay_loaded
stay_loaded()
print(gc.get_freeze_count(), len(gc.get_objects()), gc.get_threshold()[2])
"""


@pytest.mark.slow
def test_what_is_loaded_is_looked_through_no_more() -> None:
    done = subprocess.run(
        [sys.executable, "-c", AFTER_LOADING],
        capture_output=True, text=True, check=True, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    left_alone, looked_through, times = map(int, done.stdout.split())
    assert left_alone > 100_000
    assert looked_through < 1000
    assert times >= 1_000_000


@pytest.mark.parametrize(("lasting_s", "requests"), [(60.0, 100), (0.0, 5)], ids=["quick", "lasting"])
def test_after_so_many_requests_all_is_looked_through(
    monkeypatch: pytest.MonkeyPatch, lasting_s: float, requests: int
) -> None:
    collected: list[int] = []
    monkeypatch.setattr(gc, "collect", lambda: collected.append(1))
    monkeypatch.setattr(middleware, "COLLECT_AFTER", 100)
    monkeypatch.setattr(middleware, "LASTING_S", lasting_s)

    async def route(scope: Scope, receive: Receive, send: Send) -> None:
        await asyncio.sleep(0)

    async def ask(count: int) -> None:
        for _ in range(count):
            await counting({"type": "http"}, None, None)  # type: ignore[arg-type]

    counting = CollectAfterRequests(route)
    asyncio.run(ask(requests - 1))
    assert collected == []
    asyncio.run(ask(1))
    assert collected == [1]
    asyncio.run(ask(requests))
    assert collected == [1, 1]
