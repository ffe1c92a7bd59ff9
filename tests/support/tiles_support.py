"""Vector tiles as one or more processes have them, without HTTP."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Any

from app.core.admission import make_request_classes
from app.core.settings import Settings
from app.map.tiles.tiles import Tiles


@asynccontextmanager
async def processes(url: str, number: int, **settings: Any) -> AsyncIterator[list[Tiles]]:
    """The tiles of so many processes on one database."""
    chosen = Settings(database_url=url, **settings)
    made = [Tiles(url, chosen, make_request_classes(5)) for _ in range(number)]
    try:
        yield made
    finally:
        for one in made:
            await one.close()


def run(
    those: AbstractAsyncContextManager[list[Tiles]], scenario: Callable[..., Coroutine[Any, Any, None]]
) -> None:
    """Run ``scenario(one, other ...)`` to its end."""

    async def whole() -> None:
        async with those as made:
            await scenario(*made)

    asyncio.run(whole())
