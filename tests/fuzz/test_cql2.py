"""Filters by a grammar, valid and nearly so, in both languages: answered or refused in words, within bounds.

A failure names the seed of its filter: ``random.Random(seed)`` makes the same one again.
"""

from __future__ import annotations

import json
import random
import resource
import time
from pathlib import Path
from typing import Any

import pytest

from app.core.db import fetch_binary
from app.core.errors import BadQueryError
from app.map.items.collections import COLLECTIONS, GEOMETRY
from app.map.items.cql import ARITHMETIC, COMPARED, JSON, OF_TEXTS, SPATIAL, TEMPORAL, TEXT
from app.map.items.filters import MOST_SQL_CHARACTERS
from app.map.items.request import parse_items
from app.map.items.store import page
from fuzz_support import first_seed, rounds
from items_support import Items

LONGEST_S = 5.0
MOST_GROWTH_BYTES = 200 * 2**20
"""Of the process that compiles."""
MOST_BACKEND_BYTES = 300 * 2**20
"""Of the server's process, at its peak."""

NUMBERS = ("id", "length_m", "slope_percent", "drives", "oneway", "dem_slope_percent", "from_node")
TEXTS = ("name", "highway")
WORDS = ("'x'", "'%e%'", "'O''Brien'", "''", "'\\\\'", "'ÉCOLE'", "'2026-11-05'", "'" + "%a" * 40 + "'")
VALUES = ("0", "-1", "7", "0.5", "1e300", "-1e-300", "9007199254740993", "1" + "0" * 400)
TIMES = (
    "DATE('2026-11-05')",
    "TIMESTAMP('2026-11-05T00:00:00Z')",
    "INTERVAL('..', '2026-11-09')",
    "updated_at",
)
PLACES = (GEOMETRY, "POINT(8.4 49)", "BBOX(8, 49, 9, 50)", "LINESTRING(8 49, 9 50, 8 50, 9 49)",
          "POLYGON((8 49, 9 49, 9 50, 8 49))", "MULTIPOLYGON(((8 49, 9 49, 9 50, 8 49)))",
          "BBOX(179, 0, -179, 90)")  # fmt: skip
TOKENS = ("(", ")", "((((", ",", "'", '"', "NOT ", " AND ", " OR ", " % 7", "- ", " IN (", "NULL", "\0", "é", " " * 50,
          "f(", "BETWEEN", "1e999", "POLYGON((", "CASEI(", "{", "[", ".5")  # fmt: skip


class Grammar:
    """Texts of filters."""

    def __init__(self, rng: random.Random) -> None:
        self._rng = rng

    def condition(self, depth: int) -> str:
        """A truth value, mostly."""
        choose = self._rng.choice
        if depth <= 0:
            return choose(("bridge", "TRUE", f"{choose(NUMBERS)} {choose([*COMPARED])} {choose(VALUES)}"))
        kinds = (
            self._junction,
            self._negation,
            self._comparison,
            self._list,
            self._pattern,
            self._place,
            self._time,
        )
        return choose(kinds)(depth - 1)

    def number(self, depth: int) -> str:
        if depth <= 0 or self._rng.random() < 0.2:
            return self._rng.choice([*NUMBERS, *VALUES])
        op = self._rng.choice([*ARITHMETIC])
        count = self._rng.choice((1, 1, 2, 30))
        chain = "".join(f" {op} {self.number(depth - 2 - count // 2)}" for _ in range(count))
        return self._rng.choice(("{}", "({})", "-({})")).format(self.number(depth - 1) + chain)

    def text(self, depth: int) -> str:
        if depth <= 0 or self._rng.random() < 0.3:
            return self._rng.choice([*TEXTS, *WORDS])
        return f"{self._rng.choice([*OF_TEXTS]).upper()}({self.text(depth - 1)})"

    def _junction(self, depth: int) -> str:
        parts = [self.condition(depth - n) for n in range(self._rng.choice((2, 2, 3, 12)))]
        return "(" + self._rng.choice((" AND ", " OR ")).join(parts) + ")"

    def _negation(self, depth: int) -> str:
        return "NOT " * self._rng.choice((1, 1, 3, 31)) + f"({self.condition(depth)})"

    def _comparison(self, depth: int) -> str:
        of = self._rng.choice((self.number, self.text, self.number))
        if self._rng.random() < 0.3:
            return f"{of(depth)} BETWEEN {of(depth)} AND {of(depth)}"
        return f"{of(depth)} {self._rng.choice([*COMPARED])} {of(depth)}"

    def _list(self, depth: int) -> str:
        of = self._rng.choice((self.number, self.text))
        listed = [of(min(depth, 2)) for _ in range(self._rng.choice((1, 3, 60)))]
        return f"{of(depth)} IN ({', '.join(listed)})"

    def _pattern(self, depth: int) -> str:
        return f"{self.text(depth)} LIKE {self.text(depth)}"

    def _place(self, _depth: int) -> str:
        op = self._rng.choice([*SPATIAL, "s_disjoint"]).upper()
        return f"{op}({self._rng.choice(PLACES)}, {self._rng.choice(PLACES)})"

    def _time(self, _depth: int) -> str:
        op = self._rng.choice([*TEMPORAL]).upper()
        return f"{op}({self._rng.choice(TIMES)}, {self._rng.choice(TIMES)})"


def spoilt(text: str, rng: random.Random) -> str:
    """The text with something lost, doubled or put in."""
    for _ in range(rng.choice((1, 1, 2, 5))):
        at, end = sorted(rng.randrange(len(text) + 1) for _ in range(2))
        part = rng.choice(("", text[at:end] * 2, rng.choice(TOKENS) * rng.choice((1, 1, 3, 20, 300))))
        text = text[:at] + part + text[rng.choice((at, end)) :]
    return text


def as_json(text: str, rng: random.Random) -> str:
    """The same in JSON, where it can be read, mostly with something of it replaced."""
    import cql2  # noqa: PLC0415 - as the service does

    tree = cql2.parse_text(text).to_json()
    odd: tuple[Any, ...] = (
        None,
        [],
        {},
        {"op": "not"},
        -1,
        1e308,
        "x",
        {"property": "id"},
        [[1]],
        {"bbox": [1]},
        tree,
    )

    def walked(node: Any) -> Any:
        if rng.random() < 0.02:
            return rng.choice(odd)
        if isinstance(node, dict):
            return {key: walked(value) for key, value in node.items()}
        return [walked(one) for one in node] if isinstance(node, list) else node

    return json.dumps(walked(tree))


def filter_of(seed: int) -> tuple[str, str]:
    """A filter, and its language."""
    rng = random.Random(seed)  # noqa: S311 - not for secrets
    text = Grammar(rng).condition(rng.choice((1, 2, 4, 6)))
    if rng.random() < 0.4:
        return spoilt(text, rng), TEXT
    if rng.random() < 0.5 and len(text) < 5000 and text.count("(") < 40:
        try:
            return as_json(text, rng), JSON
        except ValueError:
            return text, TEXT
    return text, TEXT


def peak_bytes(pid: int) -> int:
    status = Path(f"/proc/{pid}/status").read_text()
    return 1024 * int(status.partition("VmHWM:")[2].split()[0])


def test_filters_by_the_grammar_are_answered_or_refused_within_bounds(items: Items) -> None:
    begin = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    answered = refused = 0
    first = first_seed()
    settings = items.settings.model_copy(update={"items_timeout_s": 2.0})
    for number in rounds():
        seed = first + number
        text, language = filter_of(seed)
        collection = COLLECTIONS["ways" if seed % 5 == 0 else "segments"]
        pairs = [("filter", text), ("filter-lang", language), ("limit", "5")]
        pairs += [("sortby", "-slope_percent")] if seed % 3 == 0 else []
        begin_s = time.monotonic()
        try:
            with items.sessions() as session:
                asked = parse_items(collection, pairs, settings)
                assert len(asked.conditions[0].sql) <= MOST_SQL_CHARACTERS + 100
                page(session, asked)
                pid = fetch_binary(session, "SELECT pg_backend_pid()", {})[0][0]
                assert peak_bytes(pid) < MOST_BACKEND_BYTES
            answered += 1
        except BadQueryError as error:
            assert "filter" in str(error) or "takes longer" in str(error)
            refused += 1
        except Exception as error:
            pytest.fail(f"seed {seed}, {language}, {type(error).__name__}: {str(error)[:300]}\n{text[:2000]}")
        took_s = time.monotonic() - begin_s
        assert took_s < LONGEST_S, f"seed {seed}, {language}: {took_s:.1f} s\n{text[:2000]}"
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 - begin
        assert grown < MOST_GROWTH_BYTES, f"seed {seed}, {language}: {grown} bytes more\n{text[:2000]}"
    assert answered > 10
    assert refused > 10
