"""Tiles as two processes have them, without HTTP."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any

import pytest

from app.core.lanes import make_lanes
from app.core.settings import Settings
from app.map.tiles.tiles import Tiles

Scenario = Callable[..., Coroutine[Any, Any, None]]


@asynccontextmanager
async def processes(url: str, number: int, **settings: Any) -> AsyncIterator[list[Tiles]]:
    chosen = Settings(database_url=url, **settings)
    made = [Tiles(url, chosen, make_lanes(5)) for _ in range(number)]
    try:
        yield made
    finally:
        for one in made:
            await one.close()


@pytest.fixture
def in_processes(database_url: str) -> Callable[..., None]:
    """``in_processes(scenario, **settings)``: run ``scenario(one, other)``, each the tiles of a process of its own."""

    def run(scenario: Scenario, **settings: Any) -> None:
        async def whole() -> None:
            async with processes(database_url, 2, **settings) as made:
                await scenario(*made)

        asyncio.run(whole())

    return run
