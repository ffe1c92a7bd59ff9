"""Pages reach every item once and in order; places in them outlive changes and belong to their query."""

from __future__ import annotations

import base64
import functools
import json
import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import text

from app.core.db import make_engine, session_factory
from app.core.errors import BadQueryError, GoneError
from app.map.items.collections import SEGMENTS
from app.map.items.request import parse_items
from app.map.items.store import page
from items_support import Items, fill, ids_of

KEYS = [
    "slope_percent",
    "steepness_percent",
    "name",
    "highway",
    "oneway",
    "bridge",
    "updated_at",
    "dem_slope_percent",
    "drives",
    "id",
]


def comparable(value: Any) -> Any:
    """NaN is above all numbers, texts go by their bytes, as PostgreSQL has it."""
    if isinstance(value, float):
        return (math.isnan(value), 0.0 if math.isnan(value) else value)
    return value.encode() if isinstance(value, str) else value


def compared(a: Any, b: Any, *, descending: bool) -> int:
    """Of two values of a key: what is unknown comes last, whichever the direction."""
    if a is None or b is None:
        return (a is None) - (b is None)
    a, b = comparable(a), comparable(b)
    return ((a > b) - (a < b)) * (-1 if descending else 1)


def in_order(rows: list[dict[str, Any]], keys: list[tuple[str, bool]]) -> list[int]:
    ties = [*keys, ("id", keys[-1][1])]

    def of_rows(a: dict[str, Any], b: dict[str, Any]) -> int:
        return next((c for name, down in ties if (c := compared(a[name], b[name], descending=down))), 0)

    return [row["id"] for row in sorted(rows, key=functools.cmp_to_key(of_rows))]


@settings(max_examples=25)
@given(
    keys=st.lists(
        st.tuples(st.sampled_from(KEYS), st.booleans()), min_size=1, max_size=3, unique_by=lambda key: key[0]
    ),
    limit=st.integers(20, 300),
    driven=st.none() | st.booleans(),
)
def test_sorted_pages_are_the_sorted_whole(
    items: Items, keys: list[tuple[str, bool]], limit: int, driven: bool | None
) -> None:
    rows = [row for row in items.stored if driven is None or driven == (row["drives"] > 0)]
    sortby = ",".join(("-" if down else "+") + name for name, down in keys)
    more = {} if driven is None else {"driven": str(driven).lower()}
    assert items.ids(sortby=sortby, limit=str(limit), **more) == in_order(rows, keys)


@pytest.mark.parametrize("limit", [11, 239, 240, 241])
def test_pages_by_id_are_the_whole_and_none_is_empty(items: Items, limit: int) -> None:
    found, after = [], None
    while True:
        one = items.page(limit=str(limit), **({} if after is None else {"after": after}))
        assert one.features
        assert (one.matched is None) == (after is not None)
        found += ids_of(one)
        if (after := one.next_cursor) is None:
            break
    assert found == [row["id"] for row in items.stored]


def test_how_many_match_is_exact_on_the_first_page(items: Items) -> None:
    for params in ({"driven": "true"}, {"bbox": "8.4,49,8.45,49.1"}, {"highway": "primary"}, {}):
        assert items.page(limit="1", **params).matched == len(items.ids(**params)) > 1


def test_what_comes_and_goes_meanwhile_moves_nothing_else(items: Items) -> None:
    """A page later: what stayed is there once, in order, though what the place was made of is gone."""
    pairs = [("sortby", "-slope_percent"), ("limit", "20")]
    with items.sessions() as session:
        first = page(session, parse_items(SEGMENTS, pairs, items.settings))
        found = ids_of(first)
        session.execute(text("DELETE FROM segments WHERE id = ANY(:ids)"), {"ids": [*found[-3:], found[0]]})
        session.execute(
            text("UPDATE segment_slopes SET slope_percent = 99 WHERE segment_id = :id"), {"id": found[1]}
        )
        cursor = first.next_cursor
        while cursor is not None:
            following = page(session, parse_items(SEGMENTS, [*pairs, ("after", cursor)], items.settings))
            found += ids_of(following)
            cursor = following.next_cursor
        session.rollback()
    assert found == items.ids(sortby="-slope_percent")


def test_a_place_belongs_to_its_query(items: Items) -> None:
    query = {"filter": "oneway = 0", "sortby": "name", "bbox": "-180,-90,180,90", "limit": "9"}
    place = items.page(**query).next_cursor
    assert place is not None
    following = items.page(**query, after=place).features
    shown = {"limit": "3", "crs": "http://www.opengis.net/def/crs/EPSG/0/3857", "properties": "id"}
    assert ids_of(items.page(**{**query, **shown}, after=place)) == [
        json.loads(f)["id"] for f in following[:3]
    ]
    for other in (
        {"filter": "oneway = 1"},
        {"sortby": "-name"},
        {"bbox": "-180,-90,180,89"},
        {"bridge": "true"},
    ):
        with pytest.raises(BadQueryError, match="belongs to another query"):
            items.page(**{**query, **other}, after=place)
    with pytest.raises(BadQueryError, match="belongs to another query"):
        items.page("ways", **query, after=place)


def test_the_last_id_is_a_place_where_items_come_by_id(items: Items) -> None:
    assert ids_of(items.page(after="17", limit="2")) == [18, 19]
    assert items.page(after=str(2**63 - 1)).features == []
    with pytest.raises(BadQueryError, match="next link"):
        items.page(after="17", sortby="name")


def forged(items: Items, sortby: str, change: Any) -> str:
    place = items.page(limit="5", sortby=sortby).next_cursor
    assert place is not None
    said = json.loads(base64.urlsafe_b64decode(place + "=" * (-len(place) % 4)))
    return base64.urlsafe_b64encode(json.dumps(change(said)).encode()).decode().rstrip("=")


STRANGE = [
    *("x", "0", "1e999", "1e-999", "NaN", "-Infinity", "1_0", "9" * 20, "2026-13-45 00:00:00+00"),
    *("2026-11-01 00:00:00+00", "\0", "\ud800", "t", "true", "' OR 1=1"),
]
strange = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.lists(st.integers(), max_size=2),
    st.sampled_from(STRANGE),
)


@settings(max_examples=60)
@given(
    sortby=st.sampled_from(["slope_percent", "name", "updated_at", "bridge", "oneway"]),
    at=st.integers(0, 5),
    value=strange,
)
def test_a_place_that_nobody_made_is_refused_or_is_a_place(
    items: Items, sortby: str, at: int, value: Any
) -> None:
    place = forged(items, sortby, lambda said: [*said[:at], value, *said[at + 1 :]])
    try:
        assert items.page(limit="5", sortby=sortby, after=place).features is not None
    except BadQueryError as error:
        assert [one.field for one in error.errors] == ["after"]


@pytest.mark.parametrize(
    "place", ["", "x", "=", "-1", "1.5", "é", "W10", "e30", "bnVsbA", "WzFd" * 2000, "9" * 20, "[" * 3000]
)
def test_what_is_no_place_is_refused(items: Items, place: str) -> None:
    with pytest.raises(BadQueryError, match=r"^after: .*Follow the next link"):
        items.page(after=place)


def test_ways_are_paged_as_well(items: Items) -> None:
    first = items.page("ways", limit="10", sortby="-length_m")
    second = items.page("ways", limit="1000", sortby="-length_m", after=first.next_cursor or "")
    lengths = [json.loads(f)["properties"]["length_m"] for f in [*first.features, *second.features]]
    assert lengths == sorted(lengths, reverse=True)
    assert len(lengths) == first.matched


def test_a_search_that_takes_too_long_ends_and_says_what_does_not(items: Items) -> None:
    hurried = items.settings.model_copy(update={"items_timeout_s": 0.001})
    slow = " AND ".join(["ACCENTI(CASEI(name)) LIKE '%e%'"] * 60)
    with items.sessions() as session, pytest.raises(BadQueryError, match=r"0\.001 s.*bbox.*slope_percent"):
        page(session, parse_items(SEGMENTS, [("filter", slow)], hurried))


def test_changes_are_listed_to_where_the_first_page_ended_them(database_url: str, items: Items) -> None:
    engine = make_engine(database_url)
    sessions = session_factory(engine)

    def asked(*pairs: tuple[str, str]) -> Any:
        with sessions() as session:
            return page(session, parse_items(SEGMENTS, [("limit", "3"), *pairs], items.settings))

    with sessions.begin() as session:
        fill(session)
    everything = asked(("updated_since", "2026-01-01"))
    assert (len(everything.features), everything.matched) == (3, 240)
    since = ("updated_since", everything.version)
    assert asked(since).features == []
    with sessions.begin() as session:
        session.execute(text("UPDATE segments SET name = 'new' WHERE id IN (5, 6, 7, 8)"))
        session.execute(text("UPDATE segment_slopes SET slope_percent = 1.25 WHERE segment_id = 11"))
    first = asked(since)
    assert (ids_of(first), first.matched) == ([5, 6, 7], 5)
    with sessions.begin() as session:
        session.execute(text("UPDATE segments SET name = 'newer' WHERE id IN (8, 12)"))
    second = asked(since, ("after", first.next_cursor))
    assert (ids_of(second), second.version) == ([11], first.version), "8 changed after the listing began"
    assert ids_of(asked(("updated_since", first.version))) == [8, 12]
    with pytest.raises(BadQueryError, match="updated_since"):
        asked(("updated_since", "yesterday"))
    with pytest.raises(GoneError, match="updated_since"):
        asked(("updated_since", "abcdefghij-5"))
    engine.dispose()
