"""What Prometheus reads, and the dashboard that is drawn of it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from prometheus_client.parser import text_string_to_metric_families

from app.core.telemetry.measures import MEASURES

DASHBOARD = Path(__file__).resolve().parents[3] / "docs" / "files" / "grafana.json"
SUFFIXES = {"counter": ("_total",), "histogram": ("_bucket", "_sum", "_count")}


def test_metrics_count_requests_by_route(reading: Any) -> None:
    reading.client.get("/v1/segments/1")
    reading.client.get("/v1/segments/999999")
    text = reading.client.get("/metrics").text
    for status in (200, 404):
        assert f'route="/v1/segments/{{segment_id}}",status="{status}"' in text
    assert 'versant_drives{status="done"} 2.0' in text
    assert "versant_queue_depth 0.0" in text
    assert "versant_workers 0.0" in text
    assert "versant_database_up 1.0" in text
    assert "/v1/segments/1" not in text, "a series per segment would never end"


def exposed(service: Any) -> dict[str, str]:
    """Every name that a query can use, with the kind of its metric."""
    families = text_string_to_metric_families(service.client.get("/metrics").text)
    return {family.name + s: family.type for family in families for s in SUFFIXES.get(family.type, ("",))}


def test_what_workers_count_is_declared_before_anything_is_counted(reading: Any) -> None:
    names = exposed(reading)
    for measure in MEASURES:
        assert (f"{measure.name}_bucket" if measure.buckets else measure.name) in names


def queries() -> list[str]:
    panels = json.loads(DASHBOARD.read_text())["panels"]
    return [target["expr"] for panel in panels for target in panel.get("targets", ())]


def test_the_dashboard_shows_what_there_is_and_all_of_it(reading: Any) -> None:
    names = exposed(reading)
    drawn = {name for query in queries() for name in re.findall(r"\bversant_\w+", query)}
    assert drawn - names.keys() == set()
    of_families = {name: re.sub(r"_(bucket|sum|count)$", "", name) for name, kind in names.items()}
    current = {one for one in of_families.values() if not one.startswith("versant_squares_")}
    shown = {of_families[name] for name in drawn}
    assert {family for family in current if not family.endswith("_created")} - shown == set()


@pytest.mark.parametrize("query", queries())
def test_counters_are_drawn_as_rates_and_gauges_are_not(reading: Any, query: str) -> None:
    names = exposed(reading)
    for name in re.findall(r"\bversant_\w+", query):
        rated = re.search(rf"(rate|increase)\({name}\b", query) is not None
        assert rated == (names[name] in SUFFIXES), query


def test_panels_of_the_dashboard_do_not_overlap() -> None:
    board = json.loads(DASHBOARD.read_text())
    taken: set[tuple[int, int]] = set()
    for panel in board["panels"]:
        at = panel["gridPos"]
        here = {(x, y) for x in range(at["x"], at["x"] + at["w"]) for y in range(at["y"], at["y"] + at["h"])}
        assert not here & taken and at["x"] + at["w"] <= 24
        taken |= here
    assert len({panel["id"] for panel in board["panels"]}) == len(board["panels"])
