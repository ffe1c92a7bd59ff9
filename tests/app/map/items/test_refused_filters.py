"""Filters that cannot be used: each is refused in words, and none becomes part of a statement."""

from __future__ import annotations

import json

import pytest

from app.core.errors import BadQueryError
from items_support import Items

HOSTILE = [
    "slope_percent = 1; DROP TABLE segments",
    "name = '' OR 1=1 --'",
    "name = ''' OR ''1''=''1'",
    '"a.id" = 1',
    '"s.id) OR (1=1" = 1',
    "pg_sleep(9) = 1",
    "name LIKE '\\'",
    "CASEI(name) LIKE CASEI('\\')",
    "ACCENTI(name) LIKE ACCENTI('x\\')",
    "length_m * 1" + "0" * 300 + " * 1" + "0" * 300 + " > 1",
    "length_m ^ 9999 > 1",
    "slope_percent ^ 0.5 > 1",
    "S_WITHIN(geometry, GEOMETRYCOLLECTION(POINT(8 49)))",
    "S_INTERSECTS(geometry, POLYGON((0 0, 1 1, 1 0, 0 1, 0 0)))",
    "S_INTERSECTS(geometry, POLYGON((0 0, 1 1, 0 0)))",
    "S_INTERSECTS(geometry, POINT(200 10))",
    "S_INTERSECTS(geometry, BBOX(1, 2, 3))",
    "S_INTERSECTS(geometry, LINESTRING(8 49, 9 4 50, 9 49))",
    "T_AFTER(updated_at, TIMESTAMP('9999-12-31T23:59:59-14:00'))",
    "T_AFTER(updated_at, DATE('2026-02-30'))",
    "T_DURING(updated_at, INTERVAL('2026-03-01', '2026-02-01'))",
    "T_DURING(updated_at, INTERVAL('..', 'x'))",
    "T_DURING(updated_at, 3)",
    "slope_percent IN ()",
    "slope_percent",
    "1",
    "'x'",
    "geometry",
    "geometry = geometry",
    "updated_at = 5",
    "updated_at = 'yesterday'",
    "bridge < TRUE",
    "bridge = 'yes'",
    "name + 1 = 2",
    "name = NULL",
    "slope_percent BETWEEN 1 AND 'x'",
    "NOT 5",
    "TRUE AND 5",
    "CASEI(5) = 'x'",
    "(1, 2) = (1, 2)",
    "A_CONTAINS(name, ('a', 'b'))",
    "name LIKE 5",
    "highwya = 'primary'",
    "name = 'x",
    "((name = 'x')",
    "name == 'x'",
    "",
    " ",
    "\0",
    "(" * 40 + "bridge" + ")" * 40,
    "(" * 20_000 + "bridge" + ")" * 20_000,
    "NOT " * 5000 + "bridge",
    "length_m = " + "-" * 5000 + "1",
    "length_m" + " + 1" * 5000 + " = 1",
    "CASEI(" * 3000 + "name" + ")" * 3000 + " = 'x'",
    " OR ".join(["oneway = 1"] * 3000),
    "x" * 70_000,
    f"id IN ({','.join(['1'] * 1001)})",
    "name = '\ud800'",
]


@pytest.mark.parametrize("text", HOSTILE, ids=range(len(HOSTILE)))
def test_an_unusable_filter_is_refused_in_words(items: Items, text: str) -> None:
    """Or answered, where it is a text like any other; the segments are there afterwards."""
    with pytest.raises(BadQueryError) as caught:
        assert items.page(filter=text).matched == 0
        raise BadQueryError("filter: nothing is called that.", field="filter")
    assert [error.field for error in caught.value.errors] == ["filter"]
    assert str(caught.value).startswith("filter: ")
    assert len(str(caught.value)) < 800
    assert items.page(limit="1").features


HOSTILE_JSON = [
    "{",
    "[]",
    "null",
    "5",
    '{"op": "="}',
    '{"op": "=", "args": [{"property": "id"}]}',
    '{"op": "=", "args": [{"property": "id"}, NaN]}',
    '{"op": "=", "args": [{"property": "id"}, 1e999]}',
    '{"op": "=", "args": [{"property": ["id"]}, 1]}',
    '{"op": "=", "args": [{"property": {}}, 1]}',
    '{"op": "=", "args": {"property": "id"}}',
    '{"op": ["="], "args": [1, 1]}',
    '{"op": "and", "args": [{"property": "bridge"}]}',
    '{"op": "in", "args": [{"property": "id"}, 5]}',
    '{"op": "in", "args": [{"property": "id"}, [[1]]]}',
    '{"op": "s_intersects", "args": [{"property": "geometry"}, {"type": "Point", "coordinates": [[1, 2]]}]}',
    '{"op": "s_intersects", "args": [{"property": "geometry"}, {"type": "Point", "coordinates": []}]}',
    '{"op": "s_intersects", "args": [{"property": "geometry"}, {"type": "Polygon", "coordinates": [[]]}]}',
    '{"op": "s_intersects", "args": [{"property": "geometry"}, {"bbox": [1, 2, 3, 4, 5]}]}',
    '{"op": "t_after", "args": [{"property": "updated_at"}, {"timestamp": 5}]}',
    '{"op": "t_after", "args": [{"property": "updated_at"}, {"interval": [1, 2, 3]}]}',
    '{"op": "=", "args": [{"property": "name"}, "\\u0000"]}',
    '{"op": "=", "args": [{"property": "name"}, "\\ud800"]}',
    '{"op": "not", "args": [' * 200 + "true" + "]}" * 200,
    "[" * 60_000,
]


@pytest.mark.parametrize("text", HOSTILE_JSON, ids=range(len(HOSTILE_JSON)))
def test_an_unusable_filter_in_json_is_refused_in_words(items: Items, text: str) -> None:
    with pytest.raises(BadQueryError, match=r"^filter: "):
        items.asked([("filter", text), ("filter-lang", "cql2-json")])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("bridge AND highwya = 'x'", "(?s)'highwya'.*steepest_percent.*at character 12"),
        ("bridge AND", "character 1?"),
        ("bridge AND length_m = 'x'", "compare a number with the text 'x'"),
        ("foo(name) = 1", "there is no function 'foo'.*S_INTERSECTS"),
        ("T_AFTER(updated_at)", "takes 2 arguments, not 1"),
    ],
)
def test_a_refusal_says_what_is_wrong_and_where(items: Items, text: str, told: str) -> None:
    with pytest.raises(BadQueryError, match=told):
        items.page(filter=text)


def test_a_refusal_of_json_says_the_way_to_it(items: Items) -> None:
    tree = {"op": "and", "args": [{"property": "bridge"}, {"op": "=", "args": [{"property": "x"}, 1]}]}
    with pytest.raises(BadQueryError, match=r"'x'.*at args\[1\]\.args\[0\]"):
        items.asked([("filter", json.dumps(tree)), ("filter-lang", "cql2-json")])
