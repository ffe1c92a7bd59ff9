"""What processes count: in memory, in their rows, and summed over all of them."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import text

from app.core.db import Sessions
from app.core.telemetry import ledger as ledgers
from app.core.telemetry import measures
from app.core.telemetry.ledger import Ledger, counting, totals_of_all
from app.core.telemetry.measures import MEASURES, Measure, Totals, growth, totals_now

APPLES = Measure("test_apples_total", "Apples.", ("kind",))
WAITS = Measure("test_waits_seconds", "Waits.", ("lock",), (0.1, 1.0))


@pytest.fixture(autouse=True)
def empty(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """As if this process had counted nothing yet."""
    monkeypatch.setattr(measures, "_totals", type(measures._totals)(float))  # type: ignore[call-overload]
    yield


def summed(sessions: Sessions) -> Totals:
    with sessions() as session:
        return totals_of_all(session)


def rows(sessions: Sessions) -> int:
    with sessions() as session:
        return int(session.execute(text("SELECT count(*) FROM process_totals")).scalar_one())


def age(sessions: Sessions) -> None:
    with sessions.begin() as session:
        session.execute(text("UPDATE process_totals SET written_at = now() - interval '2 hours'"))


@given(st.lists(st.floats(0, 100), max_size=30))
def test_a_histogram_holds_each_duration_in_every_bucket_above_it(seconds: list[float]) -> None:
    before = totals_now()
    for one in seconds:
        WAITS.observe(one, "a")
    series = WAITS.series(growth(totals_now(), before))
    buckets, total = WAITS.cumulative(series.get(("a",), {}))
    ends = {"0.1": 0.1, "1.0": 1.0, "+Inf": math.inf}
    assert buckets == [(name, sum(one <= end for one in seconds)) for name, end in ends.items()]
    assert total == pytest.approx(sum(seconds), abs=1e-3)


def test_threads_count_together() -> None:
    def count() -> None:
        for _ in range(500):
            APPLES.count("red")

    threads = [threading.Thread(target=count) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert APPLES.series(totals_now()) == {("red",): {"": 2000.0}}


def test_labels_that_a_measure_has_not_are_refused() -> None:
    with pytest.raises(ValueError, match="has the labels"):
        APPLES.count()


def test_names_are_those_that_prometheus_wants() -> None:
    assert len({measure.name for measure in MEASURES}) == len(MEASURES)
    for measure in MEASURES:
        assert measure.name.endswith("_seconds" if measure.buckets else "_total"), measure.name
        assert list(measure.buckets) == sorted(measure.buckets)


def test_processes_are_added_up(sessions: Sessions) -> None:
    APPLES.count("red")  # before the first of them began
    one, other = Ledger(sessions, "one"), Ledger(sessions, "other")
    APPLES.count("red", by=2)
    one.write()
    assert APPLES.series(summed(sessions)) == {("red",): {"": 2.0}}
    other.write()
    assert APPLES.series(summed(sessions)) == {("red",): {"": 4.0}}
    one.write()
    assert rows(sessions) == 2


def test_nothing_is_written_while_nothing_is_counted(
    sessions: Sessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    with counting(sessions, "idle") as ledger:
        ledger.write()
    assert rows(sessions) == 0


def test_rows_of_processes_that_ended_become_one_and_no_counter_falls(
    sessions: Sessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ledgers, "FOLD_FROM_ROWS", 2)
    silent = Ledger(sessions, "silent for long")
    for k in range(3):
        with counting(sessions, str(k)):
            APPLES.count("red")
            WAITS.observe(0.1 + 0.2 * k, "a")
    silent.write()
    before = summed(sessions)
    silent.fold()
    assert rows(sessions) == 4, "nothing is old enough"
    age(sessions)
    silent.fold()
    assert rows(sessions) == 1
    assert summed(sessions) == before
    APPLES.count("red")
    silent.write()
    after = summed(sessions)
    assert APPLES.series(after) == {("red",): {"": APPLES.series(before)["red",][""] + 1}}
    assert {key: total for key, total in after.items() if "apples" not in key} == {
        key: total for key, total in before.items() if "apples" not in key
    }
    assert rows(sessions) == 2
    silent.write()
    assert summed(sessions) == after


def test_a_write_that_fails_is_made_up_for(sessions: Sessions, monkeypatch: pytest.MonkeyPatch) -> None:
    ledger = Ledger(sessions, "unlucky")
    APPLES.count("red")
    ledger.write()
    age(sessions)
    monkeypatch.setattr(ledgers, "FOLD_FROM_ROWS", 1)
    ledger.fold()
    APPLES.count("red")

    def away(*_: Any, **__: Any) -> None:
        raise ConnectionError("away")

    with monkeypatch.context() as patched:
        patched.setattr(ledger, "_values", away)
        for _ in range(2):
            with pytest.raises(ConnectionError):
                ledger.write()
    ledger.write()
    assert APPLES.series(summed(sessions)) == {("red",): {"": 2.0}}


def test_work_is_done_though_its_figures_are_lost(
    sessions: Sessions, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def away(*_: Any) -> None:
        raise ConnectionError("away")

    monkeypatch.setattr(Ledger, "write", away)
    with caplog.at_level(logging.INFO), counting(sessions, "unlucky"):
        APPLES.count("red")
    assert "is lost" in caplog.text
