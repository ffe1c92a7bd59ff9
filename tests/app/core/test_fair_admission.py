"""Clients share a class of requests: none takes it all, whatever it asks for."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from app.core.admission import RequestClass
from app.core.errors import BusyError
from app.core.receiving.clients import _current, present_client
from app.map.items import store
from server_support import Gate, asking_from, holding, wait_until


def as_client(client: str, work: Callable[[], Coroutine[Any, Any, Any]]) -> asyncio.Task[Any]:
    """Begin it as that client's."""

    async def run() -> Any:
        _current.set(client)
        return await work()

    return asyncio.create_task(run())


async def settled() -> None:
    for _ in range(50):
        await asyncio.sleep(0)


def test_one_client_leaves_places_to_others_and_is_served_in_turn() -> None:
    async def scenario() -> None:
        request_class = RequestClass(places=2, for_others=2, longest_wait_s=60)
        inside: list[str] = []
        ends: list[tuple[str, asyncio.Event]] = []

        async def stay() -> None:
            async with request_class.place():
                client, end = present_client(), asyncio.Event()
                inside.append(client)
                ends.append((client, end))
                await end.wait()
                inside.remove(client)

        def end_one_of(client: str) -> None:
            one = next(one for one in ends if one[0] == client)
            ends.remove(one)
            one[1].set()

        tasks = [as_client("a", stay) for _ in range(20)]
        await settled()
        assert inside == ["a", "a"], "as many as there are for one client alone"
        tasks += [as_client("b", stay), as_client("b", stay)]
        await settled()
        assert sorted(inside) == ["a", "a", "b"]
        tasks += [as_client("c", stay)]
        await settled()
        assert sorted(inside) == ["a", "a", "b", "c"]
        tasks += [as_client("d", stay)]
        await settled()
        assert len(inside) == 4
        end_one_of("a")
        await settled()
        assert sorted(inside) == ["a", "b", "c", "d"], "who has none comes before who has one"
        while ends:
            end_one_of(ends[0][0])
            await settled()
        await asyncio.gather(*tasks)
        assert inside == []
        async with request_class.place():
            pass

    asyncio.run(scenario())


def test_one_client_fills_half_of_the_waiting_room() -> None:
    async def scenario() -> None:
        request_class = RequestClass(places=1, most_waiting=10, longest_wait_s=60)

        async def enter() -> None:
            async with request_class.place():
                pass

        async with request_class.place():
            waiting = [as_client("a", enter) for _ in range(20)]
            await settled()
            refused = [one for one in waiting if one.done()]
            assert len(refused) == 15
            assert all(isinstance(one.exception(), BusyError) for one in refused)
            other = as_client("b", enter)
            await settled()
            assert not other.done()
        await asyncio.gather(other, *(one for one in waiting if one not in refused))

    asyncio.run(scenario())


def test_who_gives_up_waiting_leaves_nothing_behind() -> None:
    async def scenario() -> None:
        request_class = RequestClass(places=1, longest_wait_s=60)

        async def enter() -> str:
            async with request_class.place():
                return present_client()

        async with request_class.place():
            first, second = as_client("a", enter), as_client("a", enter)
            await settled()
            first.cancel()
            await settled()
        assert await second == "a"
        held = request_class.place()
        await held.__aenter__()
        both = as_client("a", enter)
        await settled()
        leaving = asyncio.ensure_future(held.__aexit__(None, None, None))
        both.cancel()  # at the same moment as its turn comes
        await asyncio.gather(leaving, both, return_exceptions=True)
        assert await as_client("c", enter) == "c"

    asyncio.run(scenario())


def test_slow_searches_of_one_client_keep_nobody_else_waiting(
    reading: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two hundred connections with slow filters: another client's searches are answered, its own plain pages too."""
    gate = Gate(lambda *_, **__: [])
    really = store.page

    def page(session: Any, asked: Any) -> Any:
        if asked.limit == 7:
            gate(session, asked)
        return really(session, asked)

    monkeypatch.setattr("app.map.items.routes.store.page", page)
    slow = b"GET /collections/segments/items?filter=drives%3E0&limit=7 HTTP/1.1\r\nHost: localhost\r\n\r\n"
    search, plain = "/collections/segments/items?filter=drives%3E0", "/collections/segments/items"
    with holding(reading, slow, 210, client="127.0.0.2"):
        try:
            wait_until(lambda: gate.inside == 2)
            for _ in range(10):
                assert reading.client.get(search, timeout=5).status_code == 200
                assert reading.client.get(plain, timeout=5).status_code == 200
            with asking_from(reading, "127.0.0.2") as same:
                assert same.get(plain, timeout=5).status_code == 200
        finally:
            gate.open.set()
    assert gate.most == 2
