"""The text that PostgreSQL writes says what ``Segment.geojson`` says, digit by digit."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.core.db import fetch_binary
from app.core.text import rounded
from app.map import store as segments
from app.map.items.collections import COLLECTIONS, SEGMENTS, Property
from app.map.items.places import CRS84, CRSS, EPSG3857
from app.map.items.request import parse_item
from app.map.items.store import one
from app.map.items.writing import _joined, _value, feature_sql
from app.map.segment import COLUMNS, PROPERTIES
from items_support import Items, N


@pytest.mark.parametrize("gaps", ["true", "false"])
def test_every_feature_is_what_the_record_writes(items: Items, gaps: str) -> None:
    found = [json.loads(text) for text in items.page(limit="1000", gaps=gaps).features]
    with items.sessions() as session:
        expected = [row.geojson() for row in segments.all_segments(session, gaps=gaps == "true")]
    assert len(found) == N
    assert found == expected
    assert [list(feature["properties"]) for feature in found] == [list(PROPERTIES)] * N
    for feature, record in zip(found, expected, strict=True):
        for name, value in feature["properties"].items():
            if isinstance(record["properties"][name], int | str | None):
                assert type(value) is type(record["properties"][name]), name


def test_a_page_by_what_is_measured_is_the_same_text(items: Items) -> None:
    """Such a page is another statement: the second table is joined, not looked up."""
    whole = {json.loads(text)["id"]: text for text in items.page(limit="1000").features}
    joined = items.page(limit="1000", filter="slope_percent > -100").features
    assert joined == [whole[json.loads(text)["id"]] for text in joined]
    assert len(joined) == sum(row["slope_percent"] is not None for row in items.stored)


def test_the_sample_has_what_is_hard_to_write(items: Items) -> None:
    dem = [row["dem_slope_percent"] for row in items.stored]
    assert any(value is not None and math.isnan(value) for value in dem)
    assert any(value == math.inf for value in dem)
    assert any(value == -0.00001 for value in dem)
    text = items.page(limit="1000").features
    assert not any("-0," in one or "-0.0," in one or "NaN" in one or "nfinity" in one for one in text)


numbers = st.floats() | st.builds(
    lambda n, digits: n / (2 * 10**digits), st.integers(-(10**9), 10**9), st.integers(0, 7)
)


@settings(max_examples=30)
@given(values=st.lists(numbers | st.none(), min_size=20, max_size=20), digits=st.integers(0, 7))
def test_numbers_are_rounded_alike(items: Items, values: list[float | None], digits: int) -> None:
    properties = [
        Property(
            f"CAST(%(v{n})s AS float8)",
            "double",
            digits,
            name=f"v{n}",
            title="",
            description="",
            nullable=True,
        )
        for n in range(len(values))
    ]
    pieces = ", ',', ".join(", ".join(_joined(_value(one, None))) for one in properties)
    with items.sessions() as session:
        statement = f"SELECT concat('[', {pieces}, ']')"
        ((text,),) = fetch_binary(session, statement, {f"v{n}": value for n, value in enumerate(values)})
    expected = [rounded(value, digits) for value in values]
    found = json.loads(text)
    assert found == expected
    assert [math.copysign(1, v) for v in found if v is not None] == [
        math.copysign(1, v) for v in expected if v is not None
    ]


@given(value=st.floats(-1e9, 1e9), digits=st.integers(0, 7))
def test_rounding_is_to_the_nearest(value: float, digits: int) -> None:
    found = rounded(value, digits)
    assert found is not None
    assert abs(found - value) <= 0.5 * 10.0**-digits * (1 + 1e-6) + 1e-15 * abs(value)
    assert float(f"{found:.{digits}f}") == found


def test_every_property_is_described(items: Items) -> None:
    assert tuple(SEGMENTS.properties) == tuple(COLUMNS)
    for collection in COLLECTIONS.values():
        feature = json.loads(items.page(collection.id, limit="1").features[0])
        assert list(feature["properties"]) == list(collection.properties)
        for described in collection.properties.values():
            assert described.title
            assert described.description
            assert (described.unit == "%") == described.name.endswith("_percent")
            assert (described.unit == "m") == described.name.endswith("_m")
        assert set(collection.quick) <= set(collection.properties)


def test_what_is_never_null_is_never_null(items: Items) -> None:
    for collection in COLLECTIONS.values():
        always = [one.name for one in collection.properties.values() if not one.nullable]
        for text in items.page(collection.id, limit="1000").features:
            properties = json.loads(text)["properties"]
            assert [name for name in always if properties[name] is None] == []


def test_some_properties_and_no_line(items: Items) -> None:
    (text,) = items.page(limit="1", properties="name,id,geometry", skipGeometry="true").features
    assert json.loads(text) == {
        "type": "Feature",
        "id": 1,
        "geometry": None,
        "properties": {"id": 1, "name": items.stored[0]["name"]},
    }
    (text,) = items.page(limit="1", properties="").features
    assert json.loads(text)["properties"] == {}


def test_places_in_other_systems(items: Items) -> None:
    def lines(crs: str) -> list[Any]:
        return [json.loads(t)["geometry"]["coordinates"] for t in items.page(limit="1000", crs=crs).features]

    degrees, flipped, metres = (lines(crs) for crs in CRSS)
    assert [[p[::-1] for p in line] for line in flipped] == degrees
    for there, here in zip(metres, degrees, strict=True):
        for (x, y), place in zip(there, here, strict=True):
            assert EPSG3857.to_degrees(x, y) == pytest.approx(place, abs=1e-7)


def test_one_feature(items: Items) -> None:
    with items.sessions() as session:
        shape = parse_item(SEGMENTS, [("gaps", "true")])
        assert one(session, SEGMENTS, 3, shape) == items.page(limit="1", gaps="true", after="2").features[0]
        assert one(session, SEGMENTS, 10**6, shape) is None


def test_constants_cannot_end_the_text() -> None:
    quoted = Property("s.id", "int64", name="it's", title="", description="")
    collection = type("C", (), {**vars(SEGMENTS), "properties": {"it's": quoted}, "key": "s.id"})
    assert "it''s" in feature_sql(collection, CRS84, ("it's",))  # type: ignore[arg-type]
