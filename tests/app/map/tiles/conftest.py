"""Tiles of two processes on the test's own database."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from tiles_support import processes, run


@pytest.fixture
def in_processes(database_url: str) -> Callable[..., None]:
    """``in_processes(scenario, **settings)``: run ``scenario(one, other)``."""

    def both(scenario: Any, **settings: Any) -> None:
        run(processes(database_url, 2, **settings), scenario)

    return both
