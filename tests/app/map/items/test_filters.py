"""Filters in CQL2 keep what the same conditions keep when Python looks at each row; unusable ones say why."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.core.errors import BadQueryError
from app.map.items.collections import SEGMENTS
from items_support import Items

Row = dict[str, Any]
Truth = bool | None
"""None: unknown, as in SQL."""


@dataclass(frozen=True)
class Written:
    """A piece of a filter in both languages, and what it gives for a row."""

    text: str
    tree: Any
    of: Callable[[Row], Any]


def operation(op: str, text: str, parts: list[Written], of: Callable[[Row], Any]) -> Written:
    return Written(text, {"op": op, "args": [part.tree for part in parts]}, of)


def literal(value: float | str | bool) -> Written:
    if isinstance(value, bool):
        return Written(str(value).upper(), value, lambda _row: value)
    if isinstance(value, str):
        return Written("'" + value.replace("'", "''") + "'", value, lambda _row: value)
    return Written(f"{value:.6f}".rstrip("0").rstrip("."), value, lambda _row: value)


def column(name: str) -> Written:
    return Written(name, {"property": name}, lambda row: row[name])


def timestamp(value: datetime) -> Written:
    text = value.isoformat(timespec="microseconds").replace("+00:00", "Z")
    return Written(f"TIMESTAMP('{text}')", {"timestamp": text}, lambda _row: value)


NUMBERS = [
    "length_m",
    "slope_percent",
    "slope_sigma_percent",
    "steepest_percent",
    "driven_share",
    "oneway",
    "drives",
]
TEXTS = ["highway", "name"]
quarters = st.integers(-80, 80).map(lambda n: literal(n / 4))
numbers = st.sampled_from(NUMBERS).map(column)
words = st.sampled_from(
    ["residential", 'motor"way', "Straße", "Allée", "O'Brien", "a\\b\n%_", "ÉCOLE", "", "x"]
)
moments = st.integers(-2, 20).map(
    lambda days: timestamp(datetime(2026, 11, 1, tzinfo=UTC) + timedelta(days=days))
)

COMPARED: dict[str, Callable[[Any, Any], bool]] = {
    "=": lambda a, b: a == b,
    "<>": lambda a, b: a != b,
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
}
COMPUTED: dict[str, Callable[[float, float], float | None]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b if b else None,
}


def known(values: list[Any], of: Callable[..., Any]) -> Any:
    return None if any(value is None for value in values) else of(*values)


def lifted(parts: list[Written], of: Callable[..., Any]) -> Callable[[Row], Any]:
    """``of`` of what the parts give, unknown where any is."""
    return lambda row: known([part.of(row) for part in parts], of)


@st.composite
def computations(draw: st.DrawFn) -> Written:
    a, b = draw(numbers), draw(numbers | quarters)
    op = draw(st.sampled_from(list(COMPUTED)))
    return operation(op, f"({a.text} {op} {b.text})", [a, b], lifted([a, b], COMPUTED[op]))


@st.composite
def comparisons(draw: st.DrawFn) -> Written:
    a, b, ops = draw(
        st.one_of(
            st.tuples(numbers | computations(), quarters | numbers | computations(), st.just(list(COMPARED))),
            st.tuples(st.sampled_from(TEXTS).map(column), words.map(literal), st.just(["=", "<>"])),
            st.tuples(
                st.sampled_from(["bridge", "tunnel"]).map(column),
                st.booleans().map(literal),
                st.just(["=", "<>"]),
            ),
            st.tuples(st.just(column("updated_at")), moments, st.just(list(COMPARED))),
        )
    )
    op = draw(st.sampled_from(ops))
    return operation(op, f"{a.text} {op} {b.text}", [a, b], lifted([a, b], COMPARED[op]))


@st.composite
def between(draw: st.DrawFn) -> Written:
    parts = [draw(numbers), draw(quarters), draw(quarters)]
    text = f"{parts[0].text} BETWEEN {parts[1].text} AND {parts[2].text}"
    return operation("between", text, parts, lifted(parts, lambda a, low, high: low <= a <= high))


@st.composite
def listed(draw: st.DrawFn) -> Written:
    a, kind = draw(
        st.sampled_from(
            [(column("name"), words.map(literal)), (column("drives"), st.integers(0, 5).map(literal))]
        )
    )
    among = draw(st.lists(kind, min_size=1, max_size=4))
    text = f"{a.text} IN ({', '.join(one.text for one in among)})"
    values = [one.of({}) for one in among]
    return Written(
        text, {"op": "in", "args": [a.tree, [o.tree for o in among]]}, lifted([a], lambda v: v in values)
    )


@st.composite
def like(draw: st.DrawFn) -> Written:
    a = column(draw(st.sampled_from(TEXTS)))
    pattern = draw(st.sampled_from(["%", "r%", "_traße", "%e", "a\\\\b%", "%\\%\\_", "ALL%", "%é%"]))
    flags = re.DOTALL
    folded = draw(st.booleans())
    written = literal(pattern)
    if folded:
        a, written = (operation("casei", f"CASEI({one.text})", [one], one.of) for one in (a, written))
        flags |= re.IGNORECASE
    parts = re.findall(r"\\.|[^\\]", pattern)
    expression = re.compile("".join({"%": ".*", "_": "."}.get(p, re.escape(p[-1])) for p in parts), flags)
    return operation(
        "like",
        f"{a.text} LIKE {written.text}",
        [a, written],
        lifted([a], lambda v: bool(expression.fullmatch(v))),
    )


@st.composite
def unknown(draw: st.DrawFn) -> Written:
    a = column(draw(st.sampled_from([*NUMBERS, *TEXTS, "updated_at"])))
    return operation("isNull", f"{a.text} IS NULL", [a], lambda row: a.of(row) is None)


@st.composite
def during(draw: st.DrawFn) -> Written:
    a, ends = column("updated_at"), sorted([draw(moments), draw(moments)], key=lambda one: one.of({}))
    texts = [end.tree["timestamp"] for end in ends]
    low, high = (end.of({}) for end in ends)
    op, of = draw(
        st.sampled_from(
            [
                ("t_during", lambda v: low < v < high),
                ("t_intersects", lambda v: low <= v <= high),
                ("t_before", lambda v: v < low),
                ("t_after", lambda v: v > high),
                ("t_disjoint", lambda v: v < low or v > high),
            ]
        )
    )
    tree = {"op": op, "args": [a.tree, {"interval": texts}]}
    return Written(f"{op.upper()}({a.text}, INTERVAL('{texts[0]}', '{texts[1]}'))", tree, lifted([a], of))


def denied(part: Written) -> Written:
    return operation("not", f"NOT ({part.text})", [part], lifted([part], lambda v: not v))


def joined(op: str, parts: list[Written]) -> Written:
    decisive = op == "or"

    def of(row: Row) -> Truth:
        values = [part.of(row) for part in parts]
        return decisive if decisive in values else None if None in values else not decisive

    return operation(op, "(" + f" {op.upper()} ".join(f"({p.text})" for p in parts) + ")", parts, of)


leaves = comparisons() | between() | listed() | like() | unknown() | during()
filters = st.recursive(
    leaves,
    lambda inner: (
        inner.map(denied)
        | st.builds(joined, st.sampled_from(["and", "or"]), st.lists(inner, min_size=2, max_size=3))
    ),
    max_leaves=6,
)


@settings(max_examples=40)
@given(written=filters)
def test_a_filter_keeps_what_its_condition_keeps(items: Items, written: Written) -> None:
    expected = [row["id"] for row in items.stored if written.of(row) is True]
    assert items.ids(filter=written.text) == expected, written.text
    found = items.asked(
        [("limit", "1000"), ("filter", json.dumps(written.tree)), ("filter-lang", "cql2-json")]
    )
    assert [json.loads(text)["id"] for text in found.features] == expected


def test_precedence_is_the_standard_s(items: Items) -> None:
    one, two, three = "bridge = TRUE", "tunnel = TRUE", "oneway = 1"
    assert items.ids(filter=f"{one} OR {two} AND {three}") == items.ids(
        filter=f"{one} OR ({two} AND {three})"
    )
    assert items.ids(filter=f"NOT {one} AND {three}") == items.ids(filter=f"(NOT {one}) AND {three}")


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("CASEI(name) = CASEI('éCoLe')", "name = 'ÉCOLE'"),
        ("ACCENTI(CASEI(name)) = 'ecole'", "name = 'ÉCOLE'"),
        ("ACCENTI(name) = ACCENTI('Allee')", "name = 'Allée'"),
        ("bridge", "bridge = TRUE"),
        ("name NOT LIKE 'S%'", "NOT (name LIKE 'S%')"),
        ("oneway IN (1.5, 1)", "oneway = 1"),
        ("drives = 1.5", "FALSE"),
        ("length_m % 4 = 1", "length_m - 4 * (length_m div 4) = 1"),
        ("oneway ^ 2 = 1", "oneway <> 0"),
        ("-slope_percent > 2", "slope_percent < -2"),
        ("updated_at >= DATE('2026-11-05')", "updated_at >= TIMESTAMP('2026-11-05T00:00:00Z')"),
        ("updated_at >= '2026-11-05'", "updated_at >= DATE('2026-11-05')"),
        (
            "T_INTERSECTS(updated_at, DATE('2026-11-05'))",
            "updated_at BETWEEN '2026-11-05' AND '2026-11-05T23:59:59.999999Z'",
        ),
        ("T_AFTER(updated_at, INTERVAL('..', '2026-11-05'))", "updated_at >= DATE('2026-11-06')"),
        ("T_EQUALS(updated_at, updated_at)", "updated_at IS NOT NULL"),
        (
            "S_DISJOINT(geometry, BBOX(8.4, 49, 8.45, 49.1))",
            "NOT S_INTERSECTS(geometry, BBOX(8.4, 49, 8.45, 49.1))",
        ),
        (
            "S_INTERSECTS(BBOX(8.4, 49, 8.45, 49.1), geom)",
            "S_INTERSECTS(geometry, BBOX(8.4, 49, 8.45, 49.1))",
        ),
        ("S_WITHIN(geometry, BBOX(8.4, 49, 8.45, 49.1))", "S_CONTAINS(BBOX(8.4, 49, 8.45, 49.1), geometry)"),
        (
            "S_INTERSECTS(geometry, BBOX(179.9, 49, -179.9, 50))",
            "S_INTERSECTS(geometry, MULTIPOLYGON(((179.9 49, 180 49, 180 50, 179.9 50, 179.9 49)), "
            "((-180 49, -179.9 49, -179.9 50, -180 50, -180 49))))",
        ),
    ],
)
def test_two_ways_of_saying_the_same(items: Items, text: str, same: str) -> None:
    assert items.ids(filter=text) == items.ids(filter=same)
    assert same == "FALSE" or items.ids(filter=text)


def test_whole_numbers_are_exact(items: Items) -> None:
    big = 2**53 + 1
    tree = {"op": "<", "args": [{"property": "from_node"}, big]}
    assert items.asked([("filter", json.dumps(tree)), ("filter-lang", "cql2-json")]).features
    with pytest.raises(BadQueryError, match="cql2-json"):
        items.page(filter=f"from_node < {big}")
    tree = {"op": "=", "args": [{"property": "from_node"}, 2**70]}
    with pytest.raises(BadQueryError, match="up to"):
        items.asked([("filter", json.dumps(tree)), ("filter-lang", "cql2-json")])


def test_a_geometry_in_another_system(items: Items) -> None:
    there = "S_INTERSECTS(geometry, POLYGON((8.4251 48.9951, 8.4751 48.9951, 8.4751 49.1, 8.4251 48.9951)))"
    flipped = "S_INTERSECTS(geometry, POLYGON((48.9951 8.4251, 48.9951 8.4751, 49.1 8.4751, 48.9951 8.4251)))"
    root = "http://www.opengis.net/def/crs/EPSG/0/"
    expected = items.ids(filter=there)
    assert expected
    assert items.ids(**{"filter": flipped, "filter-crs": root + "4326"}) == expected

    def metres(match: re.Match[str]) -> str:
        lon, lat = float(match[1]), float(match[2])
        y = math.log(math.tan(math.pi / 4 + math.radians(lat) / 2))
        return f"{math.radians(lon) * 6378137:.9f} {y * 6378137:.9f}"

    projected = re.sub(r"(\d+\.?\d*) (\d+\.?\d*)", metres, there)
    assert items.ids(**{"filter": projected, "filter-crs": root + "3857"}) == expected


def test_what_cannot_be_divided_is_unknown(items: Items) -> None:
    assert items.ids(filter="length_m / (oneway - oneway) > 0") == []
    assert items.ids(filter="length_m % (oneway - oneway) > 0 OR bridge") == items.ids(bridge="true")


def test_every_queryable_can_be_asked_for(items: Items) -> None:
    for name in SEGMENTS.properties:
        assert items.ids(filter=f"{name} IS NULL OR {name} IS NOT NULL") == [
            row["id"] for row in items.stored
        ]
