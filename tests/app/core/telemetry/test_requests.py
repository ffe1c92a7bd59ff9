"""Each request's number and its line in the log."""

from __future__ import annotations

import logging
import time
from typing import Any

import httpx
import pytest

from app.core.telemetry.requests import names_of, request_id
from log_lines import Lines, logged


def line_of(lines: Lines, answer: httpx.Response) -> dict[str, Any]:
    """Of the request that was answered so; the line is written after the answer's last byte."""
    number, deadline = answer.headers["x-request-id"], time.monotonic() + 10
    while time.monotonic() < deadline:
        for line in lines.all("request"):
            if line["request"] == number:
                return line
        time.sleep(0.005)
    raise AssertionError(lines.text)


def test_a_request_is_one_line_with_its_number(reading: Any) -> None:
    with logged() as lines:
        answer = reading.client.get("/v1/segments/1", headers={"Accept-Encoding": "identity"})
        line = line_of(lines, answer)
    assert (line["method"], line["route"], line["path"]) == (
        "GET",
        "/v1/segments/{segment_id}",
        "/v1/segments/1",
    )
    assert (line["status"], line["bytes"], line["level"]) == (200, len(answer.content), "INFO")
    assert 0 < line["seconds"] < 60
    assert "query" not in line


def test_a_number_that_is_sent_is_kept_and_one_that_cannot_be_is_not(reading: Any) -> None:
    kept = reading.client.get("/healthz", headers={"X-Request-ID": "balancer-7.a_b"})
    assert kept.headers["x-request-id"] == "balancer-7.a_b"
    for bad in ("", "a b", "x" * 65, 'a"b', "a\tb"):
        assert len(request_id(bad)) == 32
    assert request_id(None) != request_id(None)


def test_places_in_queries_and_paths_are_not_logged(reading: Any) -> None:
    with logged(logging.DEBUG) as lines:
        box = reading.client.get("/collections/segments/items?bbox=8.4011,49.0011,8.41,49.01&limit=3")
        tile = reading.client.get("/tiles/14/8574/5639.mvt")
        assert line_of(lines, box)["query"] == "bbox,limit"
        told = line_of(lines, tile)
    assert told["route"] == "/tiles/{z}/{x}/{y}.mvt"
    assert "path" not in told
    for place in ("8.4011", "8574", "5639"):
        assert place not in lines.text


@pytest.mark.parametrize("path", ["/healthz", "/readyz", "/metrics"])
def test_what_machines_ask_all_the_time_is_told_at_debug(reading: Any, path: str) -> None:
    with logged() as lines:
        reading.client.get(path)
        line_of(lines, reading.client.get("/v1/segments/1"))
        assert len(lines.all()) == 1
    with logged(logging.DEBUG) as lines:
        assert line_of(lines, reading.client.get(path))["level"] == "DEBUG"


def test_what_has_no_route_and_what_is_refused_early_are_told_as_well(reading: Any) -> None:
    with logged() as lines:
        lost = line_of(lines, reading.client.get("/nowhere/at/all"))
        refused = line_of(lines, reading.client.get("/v1/segments/1", headers={"Host": "evil.example"}))
    assert (lost["route"], lost["path"], lost["status"]) == ("(no route)", "/nowhere/at/all", 404)
    assert refused["status"] == 421


def test_the_line_of_a_drive_names_it(reading: Any) -> None:
    drive = reading.client.get("/v1/drives").json()["drives"][0]["id"]
    with logged() as lines:
        assert line_of(lines, reading.client.get(f"/v1/drives/{drive}"))["drive"] == drive


def test_names_of_a_query() -> None:
    assert names_of(b"") is None
    assert names_of(b"bbox=1,2&limit=&bbox=3&locations=49.1%2C8.4") == "bbox,limit,locations"
    assert names_of(b"49.1,8.4&limit=3&x%0Ay=1") == "?,limit"
