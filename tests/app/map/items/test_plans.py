"""What is promised to be found at once is asked for in a form that the indexes serve."""

from __future__ import annotations

from typing import Any

import pytest

from app.core.db import fetch_binary
from app.map.items import store
from app.map.items.collections import SEGMENTS, WAYS, Collection
from app.map.items.request import parse_items
from items_support import Items


def plans(
    items: Items, params: dict[str, str], monkeypatch: pytest.MonkeyPatch, collection: Collection = SEGMENTS
) -> list[str]:
    """How the server would find a page if it had to avoid reading whole tables and sorting."""
    found: list[str] = []

    def explained(session: Any, query: str, values: Any, **how: Any) -> Any:
        if query.lstrip().startswith(("SELECT CASE", "SELECT concat")):
            found.append("\n".join(line for (line,) in fetch_binary(session, f"EXPLAIN {query}", values)))
        return fetch_binary(session, query, values, **how)

    monkeypatch.setattr(store, "fetch_binary", explained)
    with items.sessions() as session:
        for name in ("enable_seqscan", "enable_bitmapscan", "enable_sort"):
            fetch_binary(session, "SELECT set_config(%(name)s, 'off', true)", {"name": name})
        store.page(session, parse_items(collection, [*params.items()], items.settings))
    return found


@pytest.mark.parametrize(
    ("params", "index"),
    [
        ({}, "pk_segments"),
        ({"after": "17"}, "pk_segments"),
        ({"id": "17"}, "pk_segments"),
        ({"sortby": "-id"}, "pk_segments"),
        ({"filter": "id > 17"}, "pk_segments"),
        ({"osm_way_id": "71", "sortby": "osm_way_id"}, "uq_segments_osm_way_id"),
        ({"filter": "osm_way_id > 71", "sortby": "-osm_way_id"}, "uq_segments_osm_way_id"),
        ({"highway": "track", "sortby": "highway"}, "ix_segments_highway"),
        ({"filter": "highway > 'r'", "sortby": "highway"}, "ix_segments_highway"),
        ({"sortby": "name"}, "ix_segments_name"),
        ({"sortby": "-name"}, "ix_segments_name"),
        ({"sortby": "-slope_percent"}, "ix_segment_slopes_slope_percent"),
        ({"sortby": "slope_percent", "filter": "slope_percent > 1"}, "ix_segment_slopes_slope_percent"),
        ({"sortby": "-steepness_percent"}, "ix_segment_slopes_steepness_percent"),
        (
            {"sortby": "-steepness_percent", "filter": "steepness_percent > 4"},
            "ix_segment_slopes_steepness_percent",
        ),
        ({"sortby": "-steepest_percent"}, "ix_segment_slopes_steepest_percent"),
        ({"sortby": "-updated_at"}, "ix_segment_slopes_updated_at"),
        (
            {"sortby": "-updated_at", "filter": "T_AFTER(updated_at, DATE('2026-11-05'))"},
            "ix_segment_slopes_updated",
        ),
    ],
)
def test_an_index_finds_and_orders(
    items: Items, params: dict[str, str], index: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, *_ = plans(items, {"limit": "5", **params}, monkeypatch)
    assert index in first
    assert "Seq Scan" not in first
    whole = [
        line
        for line in first.splitlines()
        if "Sort" in line and "Incremental" not in line and "Key" not in line
    ]
    assert whole == []


def test_the_steepest_ways_are_found_by_an_index(items: Items, monkeypatch: pytest.MonkeyPatch) -> None:
    params = {"sortby": "-steepness_percent", "limit": "5"}
    place = items.page("ways", **params).next_cursor
    assert place is not None
    for more in ({}, {"after": place}):
        first, *_ = plans(items, {**params, **more}, monkeypatch, WAYS)
        assert "ix_ways_steepness_percent" in first


def test_a_box_is_found_by_the_index_of_places(items: Items, monkeypatch: pytest.MonkeyPatch) -> None:
    for params in (
        {"bbox": "8.4,49,8.41,49.01"},
        {"filter": "S_INTERSECTS(geometry, BBOX(8.4,49,8.41,49.01))"},
    ):
        (plan,) = plans(items, {"sortby": "-length_m", **params}, monkeypatch)
        assert "ix_segments_geom" in plan


def test_slopes_are_looked_up_for_the_page_alone(items: Items, monkeypatch: pytest.MonkeyPatch) -> None:
    (plan,) = plans(items, {"limit": "5", "highway": "track"}, monkeypatch)
    assert plan.index("Limit") < plan.index("pk_segment_slopes")
    assert "Join" not in plan.replace("Nested Loop Left Join", "")
