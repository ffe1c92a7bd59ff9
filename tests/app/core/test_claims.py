"""Claims: one holder at a time, prolonged while it lives, taken over after its time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest
from sqlalchemy import text

from app.core import claims
from app.core.claims import Claim, ClaimLostError, alone, free_of, process_name, taken
from app.core.db import Sessions, make_engine, session_factory

NAME = "something"
OVERDUE = "UPDATE claims SET until = clock_timestamp() - interval '1 s'"


def execute(sessions: Sessions, statement: str) -> None:
    with sessions.begin() as session:
        session.execute(text(statement))


def held(sessions: Sessions) -> set[int]:
    with sessions() as session:
        return taken(session, NAME)


def test_each_key_has_one_holder(sessions: Sessions) -> None:
    with Claim(sessions, NAME) as first, Claim(sessions, NAME) as second, Claim(sessions, "other") as other:
        assert first.take([1, 2, 3]) == {1, 2, 3}
        assert first.take([3, 4]) == {3, 4}, "what it has already is its own"
        assert second.take([4, 5]) == {5}
        assert other.take([1]) == {1}
        assert held(sessions) == {1, 2, 3, 4, 5}
    assert held(sessions) == set()


def test_of_many_who_try_at_once_one_gets_each_key(sessions: Sessions) -> None:
    ready, over = threading.Barrier(8), threading.Barrier(8)

    def get(number: int) -> list[int]:
        with Claim(sessions, NAME) as claim:
            ready.wait()
            got = claim.take(range(number % 3, 40))
            over.wait()
            return sorted(got)

    with ThreadPoolExecutor(8) as pool:
        got = [key for keys in pool.map(get, range(8)) for key in keys]
    assert sorted(got) == list(range(40))


def test_the_block_ends_the_claim_also_when_it_fails(sessions: Sessions) -> None:
    with pytest.raises(ZeroDivisionError), alone(sessions, NAME) as claim:
        assert claim is not None
        with alone(sessions, NAME) as other:
            assert other is None
        raise ZeroDivisionError
    with alone(sessions, NAME) as claim:
        assert claim is not None


def test_a_claim_is_prolonged_while_its_holder_works(
    sessions: Sessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(claims, "CLAIM_S", 0.5)
    monkeypatch.setattr(claims, "PROLONG_EVERY_S", 0.1)
    with Claim(sessions, NAME) as first, Claim(sessions, NAME) as second:
        assert first.take([7])
        until_s = time.monotonic() + 1.5
        while time.monotonic() < until_s:
            assert not second.take([7])
            time.sleep(0.05)


def test_who_gives_no_sign_loses_it_and_writes_nothing_more(sessions: Sessions) -> None:
    with Claim(sessions, NAME) as first, Claim(sessions, NAME) as second:
        assert first.take([1, 2])
        with sessions.begin() as session:
            first.require(session)
        execute(sessions, f"{OVERDUE} WHERE key = 2")
        with sessions.begin() as session:
            first.require(session)  # nobody has come meanwhile
        assert second.take([1, 2]) == {2}
        with sessions.begin() as session, pytest.raises(ClaimLostError, match="Start it again"):
            first.require(session)
        with sessions.begin() as session:
            second.require(session)
    assert held(sessions) == set()


def test_who_is_writing_keeps_its_claim_and_nobody_waits_for_it(sessions: Sessions) -> None:
    with Claim(sessions, NAME) as first, Claim(sessions, NAME) as second:
        assert first.take([1])
        with sessions.begin() as session:
            first.require(session)
            execute(sessions, OVERDUE)
            began_s = time.monotonic()
            assert not second.take([1])
            assert time.monotonic() - began_s < 1.0
        assert second.take([1])


def test_a_claim_begins_with_the_transaction_that_takes_it(sessions: Sessions) -> None:
    with Claim(sessions, NAME) as first:
        with sessions.begin() as session:
            assert first.take([1], session) == {1}
            assert held(sessions) == set()
        assert held(sessions) == {1}


def test_the_claims_of_a_dead_process_are_free(sessions: Sessions) -> None:
    with Claim(sessions, NAME) as first, Claim(sessions, NAME) as second:
        assert first.take([1])
        with sessions.begin() as session:
            free_of(session, ["somebody else"])
        assert not second.take([1])
        with sessions.begin() as session:
            free_of(session, [process_name()])
        assert second.take([1])


def test_one_waits_for_the_other_and_looks_meanwhile(sessions: Sessions) -> None:
    looks: list[None] = []

    def look() -> None:
        looks.append(None)
        if len(looks) == 2:
            execute(sessions, "DELETE FROM claims")

    with Claim(sessions, NAME) as first, Claim(sessions, NAME) as second:
        first.wait()
        second.wait(look)
        assert len(looks) == 2
        with pytest.raises(ZeroDivisionError):
            first.keys.clear()
            first.wait(lambda: 1 / 0)


def test_schemas_have_claims_of_their_own(sessions: Sessions, database_url: str) -> None:
    engine = make_engine(database_url, schema="told")
    with Claim(sessions, NAME) as live, Claim(session_factory(engine), NAME) as told:
        assert live.take([1])
        assert told.take([1])
    engine.dispose()


def test_a_database_that_is_away_for_a_moment_costs_no_claim(
    sessions: Sessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(claims, "PROLONG_EVERY_S", 0.05)
    monkeypatch.setattr(claims, "_AGAIN_S", 0.05)
    prolonged: Callable[[], str] = lambda: _value(sessions, "SELECT until FROM claims")  # noqa: E731
    with Claim(sessions, NAME) as claim:
        assert claim.take([1])
        execute(sessions, "ALTER TABLE claims RENAME TO away")
        time.sleep(0.3)
        execute(sessions, "ALTER TABLE away RENAME TO claims")
        before, until_s = prolonged(), time.monotonic() + 5.0
        while prolonged() == before:
            assert time.monotonic() < until_s
            time.sleep(0.02)


def _value(sessions: Sessions, query: str) -> str:
    with sessions() as session:
        return str(session.execute(text(query)).scalar_one())
