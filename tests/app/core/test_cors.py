"""Which pages of other sites may read what: none, unless the settings name them, and then the map alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from pydantic import ValidationError

from app.core.settings import Settings

MAP = (
    "/",
    "/tiles.json",
    "/collections/segments/items",
    "/tiles/14/0/0.mvt",  # answered before the framework
    "/tiles/14/0/0.mvt?v=2",  # and by it
    "/v1/changes",
    "/v1/segments/1",
    "/style.json",
    "/sprites/versant.json",
    "/glyphs/DejaVu Sans/0-255.pbf",
    "/height",  # an error
    "/tiles/99/0/0.mvt",
)
DRIVES = ("/v1/drives", "/v1/segments/1/observations", "/v1/admin/stats", "/healthz", "/nowhere", "/map")
PAGE = "https://map.example"
PREFLIGHT = {"Origin": PAGE, "Access-Control-Request-Method": "GET"}


def cors_of(answer: Any) -> dict[str, str]:
    return {name: value for name, value in answer.headers.items() if name.startswith("access-control-")}


@pytest.fixture
def naming(settings: Settings, server_maker: Callable[[Settings], Any]) -> Iterator[Callable[[str], Any]]:
    """``naming(origins)``: a service whose setting says so."""
    running: list[Any] = []

    def start(origins: str) -> Any:
        running.append(server_maker(settings.model_copy(update={"cors_origins": origins})))
        return running[-1].__enter__()

    yield start
    for one in running:
        one.__exit__(None, None, None)


@pytest.mark.parametrize("path", [*MAP, *DRIVES])
def test_no_page_of_another_site_reads_anything(reading: Any, path: str) -> None:
    """A page could else read from a service on loopback where its visitor drives."""
    assert cors_of(reading.client.get(path, headers={"Origin": PAGE})) == {}
    assert cors_of(reading.client.options(path, headers=PREFLIGHT)) == {}


def test_pages_of_an_origin_that_is_named_read_the_map_alone(naming: Callable[[str], Any]) -> None:
    web = naming(f"https://other.example, {PAGE}")
    for path in MAP:
        answer = web.client.get(path, headers={"Origin": PAGE})
        assert answer.headers["access-control-allow-origin"] == PAGE, path
        assert "etag" in answer.headers["access-control-expose-headers"].lower()
        assert web.client.options(path, headers=PREFLIGHT).status_code == 200
        for asking in ({}, {"Origin": "https://evil.example"}):
            elsewhere = web.client.get(path, headers=asking)
            assert "access-control-allow-origin" not in elsewhere.headers, path
            assert "origin" in elsewhere.headers["vary"].lower(), "a cache must not give it to others"
        assert "origin" in answer.headers["vary"].lower()
    for path in DRIVES:
        assert cors_of(web.client.get(path, headers={"Origin": PAGE})) == {}, path
        assert cors_of(web.client.options(path, headers=PREFLIGHT)) == {}, path


def test_any_page_reads_the_map_where_that_is_said(naming: Callable[[str], Any]) -> None:
    web = naming("*")
    for path in MAP:
        assert web.client.get(path, headers={"Origin": PAGE}).headers["access-control-allow-origin"] == "*", (
            path
        )
    for path in DRIVES:
        assert cors_of(web.client.get(path, headers={"Origin": PAGE})) == {}, path


@pytest.mark.parametrize(
    "origins", ["map.example", "https://map.example/", "https://a.example https://b.example"]
)
def test_what_is_no_origin_is_refused_at_the_start(origins: str) -> None:
    with pytest.raises(ValidationError, match="scheme and host"):
        Settings(cors_origins=origins)
