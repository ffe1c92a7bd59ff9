"""What a short filter may make of itself is bounded: the statement, its plans, and the time that all of it takes."""

from __future__ import annotations

import json
import math
import time
from itertools import pairwise
from typing import Any

import pytest

from app.core.db import fetch_binary
from app.core.errors import BadQueryError
from app.map.items import filters, store
from app.map.items.collections import SEGMENTS
from app.map.items.cql import ARITHMETIC, DEEPEST, JSON, OF_TEXTS, TEXT
from app.map.items.filters import filter_condition
from app.map.items.places import CRS84
from app.map.items.request import parse_items
from items_support import Items


def sql_of(text: str, language: str = TEXT) -> str:
    return filter_condition(text, language, CRS84, SEGMENTS).sql


@pytest.mark.parametrize("template", [*ARITHMETIC.values(), *OF_TEXTS.values()])
def test_an_operator_writes_each_operand_once(template: str) -> None:
    written = template.format(a="<A>", b="<B>")
    assert written.count("<A>") == 1
    assert written.count("<B>") <= 1


@pytest.mark.parametrize("op", [*ARITHMETIC, "casei", "accenti"])
def test_sql_grows_by_the_same_with_every_operator(op: str) -> None:
    def chain(count: int) -> str:
        text = op in OF_TEXTS
        tree: Any = {"property": "name" if text else "slope_percent"}
        for _ in range(count):
            tree = {"op": op, "args": [tree] if text else [tree, 7]}
        return json.dumps({"op": "=", "args": [tree, "x" if text else 1]})

    lengths = [len(sql_of(chain(count), JSON)) for count in (10, 15, 20)]
    assert lengths[2] - lengths[1] == pytest.approx(lengths[1] - lengths[0], abs=10)
    assert lengths[2] < 5000


def test_remainders_are_those_of_whole_quotients(items: Items) -> None:
    for divisor in (4, -2.5, 0.75):
        found = items.ids(filter=f"slope_percent % {divisor} > 0.1")
        slopes = {row["id"]: row["slope_percent"] for row in items.stored}
        assert found == [i for i, s in slopes.items() if s is not None and math.fmod(s, divisor) > 0.1]


def test_a_value_is_compared_with_hundreds_of_columns_at_once(items: Items) -> None:
    """PostgreSQL's IN would copy the value for each that is no constant."""
    value: Any = {"property": "length_m"}
    for _ in range(DEEPEST - 2):
        value = {"op": "+", "args": [value, {"property": "length_m"}]}
    others = [{"op": "+", "args": [{"property": "length_m"}, n]} for n in range(1, 401)]
    tree = {"op": "in", "args": [value, others]}
    text = json.dumps(tree, separators=(",", ":"))
    with items.sessions() as session:
        where = filter_condition(text, JSON, CRS84, SEGMENTS)
        plan = fetch_binary(
            session, f"EXPLAIN (VERBOSE) SELECT FROM {SEGMENTS.source} WHERE {where.sql}", where.values
        )
    assert sum(len(line) for (line,) in plan) < 3 * len(where.sql)
    fitting = [row for row in items.stored if (DEEPEST - 2) * row["length_m"] in range(1, 401)]
    assert items.asked([("filter", text), ("filter-lang", JSON)]).matched == len(fitting) > 0


@pytest.mark.parametrize(
    "text",
    [
        "slope_percent" + " + 1" * 200 + " > 1",
        "slope_percent" + " % 7" * (DEEPEST + 1) + " > 1",
        "NOT " * 200 + "bridge",
        "CASEI(" * 10 + "name" + " + 1)" * 100 + " = 'x'",
    ],
)
def test_what_is_nested_too_deep_is_refused(text: str) -> None:
    with pytest.raises(BadQueryError, match=r"nested deeper|cannot be read"):
        sql_of(text)


def test_as_deep_as_is_said_is_served(items: Items) -> None:
    assert items.page(filter="slope_percent" + " % 7" * (DEEPEST - 1) + " < 7").features
    assert items.page(filter="NOT " * (DEEPEST - 1) + "bridge").features
    assert items.page(filter=" OR ".join(["bridge", *["oneway = 5"] * 100])).features


def test_too_much_sql_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(filters, "MOST_SQL_CHARACTERS", 500)
    sql_of("slope_percent + 1 > 2")
    with pytest.raises(BadQueryError, match="more than 500 characters of SQL"):
        sql_of("slope_percent" + " + 1" * 20 + " > 2")
    with pytest.raises(BadQueryError, match="more than 500 characters of SQL"):
        sql_of(" OR ".join(["oneway = 1"] * 20))


@pytest.mark.parametrize(
    "text",
    [
        "bridge AND (" + " " * 60_000,
        "(" * 26,
        "(" * 10 + "a+" * 25_000,
        "NOT (" * 26 + "1",
        "MULTIPOLYGON(((" * 10 + "1",
        "a IN (f((" * 15 + "x",
    ],
)
def test_a_text_is_read_in_a_time_that_grows_with_its_length(text: str) -> None:
    begin_s = time.process_time()
    with pytest.raises(BadQueryError):
        sql_of(text)
    assert (
        time.process_time() - begin_s < 5
    )  # milliseconds; quadratic, or twice as long for each bracket, it was half a minute and more


def test_all_statements_of_a_page_have_one_time_limit(items: Items, monkeypatch: pytest.MonkeyPatch) -> None:
    """However many there are: each has what those before it have left."""
    left_ms: list[float] = []

    def slowly(session: Any, query: str, values: Any, **how: Any) -> Any:
        if query == store._PATIENCE:
            left_ms.append(float(values["ms"]))
        else:
            time.sleep(0.02)
        return fetch_binary(session, query, values, **how)

    monkeypatch.setattr(store, "fetch_binary", slowly)
    request = parse_items(
        SEGMENTS, [("filter", "length_m > 0"), ("sortby", "slope_percent"), ("limit", "170")], items.settings
    )
    with items.sessions() as session:
        usual = fetch_binary(session, "SHOW statement_timeout", {})
        store.page(session, request)
        assert fetch_binary(session, "SHOW statement_timeout", {}) == usual
    assert len(left_ms) > 3  # both parts of the order, the plan of the count, the count
    assert left_ms[0] <= 1000 * items.settings.items_timeout_s
    assert all(later <= before - 20 for before, later in pairwise(left_ms))


def test_connections_keep_no_plans_of_filters(items: Items) -> None:
    request = parse_items(SEGMENTS, [("filter", "length_m % 7 > 1"), ("limit", "3")], items.settings)
    with items.sessions() as session:
        for _ in range(10):
            store.page(session, request)
        kept = fetch_binary(session, "SELECT statement FROM pg_prepared_statements", {})
    assert not [one for (one,) in kept if "CAST(s.length_m AS float8)" in one]
