"""A client that goes away ends what was begun for it, on the server of the database as well."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

import httpx
import psycopg
import pytest

from server_support import connected, sleep, sleep_in_loop, sleeping, wait_until

TILE = "/tiles/14/8574/5626"
ROWS = "app.map.tiles.routes.geojson_rows"
MADE = "app.map.tiles.store.kept_or_made"

both = pytest.mark.parametrize("suffix", [".mvt", ".geojson"])
"""What the event loop runs, and what a thread does."""


def counted(web: Any, status: int) -> float:
    """How many requests were answered so; those that left while they waited had come to no route yet."""
    lines = web.client.get("/metrics").text.splitlines()
    requests = [line for line in lines if line.startswith("versant_http_requests_total{")]
    return sum(float(line.split()[-1]) for line in requests if f'status="{status}"' in line)


@pytest.fixture
def slow(filled: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A service whose tiles take two minutes each."""
    monkeypatch.setattr(ROWS, sleep)
    monkeypatch.setattr(MADE, sleep_in_loop)
    return filled


@both
def test_the_statement_of_a_tile_ends_when_its_client_leaves(slow: Any, suffix: str) -> None:
    with connected(slow, TILE + suffix):
        wait_until(lambda: sleeping(slow) == 1)
    wait_until(lambda: sleeping(slow) == 0)
    wait_until(lambda: counted(slow, 499) == 1)


def test_the_statement_of_a_tile_ends_though_the_cancel_came_too_early(
    slow: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is to be cancelled before the server has begun with it runs on, and the driver asks once."""

    async def without_effect(connection: psycopg.AsyncConnection[Any], *, timeout: float) -> None:
        """The cancel has not reached the server."""

    monkeypatch.setattr(psycopg.AsyncConnection, "_try_cancel", without_effect)
    with connected(slow, TILE + ".mvt"):
        wait_until(lambda: sleeping(slow) == 1)
    wait_until(lambda: sleeping(slow) == 0, within_s=10)


def test_a_route_that_goes_on_to_another_statement_ends_all_the_same(
    filled: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stubborn(session: Any, *_: object, **__: object) -> list[object]:
        for _ in range(3):  # type: ignore[assignment]
            try:
                sleep(session)
            except Exception:
                session.rollback()
        return []

    monkeypatch.setattr(ROWS, stubborn)
    with connected(filled, TILE + ".geojson"):
        wait_until(lambda: sleeping(filled) == 1)
    wait_until(lambda: sleeping(filled) == 0)
    wait_until(lambda: counted(filled, 499) == 1)


@both
def test_clients_that_leave_while_they_wait_begin_nothing(
    filled: Any, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    slow, begun = filled, []

    def counting(*place: Any, **named: Any) -> Any:
        begun.append(place)
        return (sleep_in_loop if suffix == ".mvt" else sleep)(*place, **named)

    monkeypatch.setattr(MADE if suffix == ".mvt" else ROWS, counting)
    with ExitStack() as crowd:
        for y in range(10):
            crowd.enter_context(connected(slow, f"/tiles/8/133/{80 + y}{suffix}"))
        wait_until(lambda: sleeping(slow) == 2)  # the lane's places

    wait_until(lambda: counted(slow, 499) == 10)
    wait_until(lambda: sleeping(slow) == 0)  # the server ends a statement some moments after it is asked to
    assert len(begun) == 2


@both
def test_the_next_one_on_the_connection_is_not_hit(
    filled: Any, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(ROWS, sleep)
        patch.setattr(MADE, sleep_in_loop)
        for _ in range(5):
            with connected(filled, TILE + suffix):
                wait_until(lambda: sleeping(filled) == 1)
    for _ in range(50):
        assert filled.client.get(TILE + suffix).status_code == 200


def test_a_client_that_stays_is_answered_and_its_connection_kept(filled: Any) -> None:
    with httpx.Client(base_url=filled.base, trust_env=False) as client:
        for _ in range(3):
            assert client.get(TILE + ".mvt").status_code == 200
            assert client.request("GET", "/healthz", content=b"a body").status_code == 200
            assert client.head("/v1/drives").status_code == 200
