"""PgBouncer in transaction mode before the tests' server: each transaction may come to another connection."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest

from soak.servers import PgBouncer, find_pgbouncer

Pooler = Callable[[str, int], AbstractContextManager[PgBouncer]]


@pytest.fixture(scope="session")
def pooler() -> Pooler:
    """``pooler(url, size)``: the same database through PgBouncer with so many connections to the server."""
    program = find_pgbouncer()
    if program is None:
        pytest.skip("PgBouncer is missing (Debian: apt-get install pgbouncer)")

    @contextmanager
    def pooled(url: str, size: int) -> Iterator[PgBouncer]:
        with tempfile.TemporaryDirectory() as folder:
            one = PgBouncer(program, url, size, Path(folder))
            one.start()
            try:
                yield one
            finally:
                one.kill()

    return pooled
