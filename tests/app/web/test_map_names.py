"""The scale beside a panel, and backgrounds that people choose."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from app.core.settings import Settings
from app.roads.imports import import_roads
from browser_fixtures import Tab
from named_town import LAT, LON, write_named_town
from page_states.rules import COVERED
from web_fixtures import Web, served

NAMED = """(layer) => [...new Set(window.versantMap.queryRenderedFeatures({layers: [layer]})
    .map((one) => one.properties.name ?? one.properties.ref))].sort()"""
RESTS = "Boolean(window.versantMap?.loaded() && !window.versantMap.isMoving())"


def drawn(tab: Tab, **wanted: list[str]) -> None:
    """Wait until these layers show these names and no others; labels appear a moment after the tiles."""
    for layer, names in wanted.items():
        named = layer.replace("_", "-")
        tab.await_true(f"({NAMED})({json.dumps(named)}).join() === {json.dumps(','.join(names))}")


@pytest.mark.parametrize("width", [660, 800])
def test_the_scale_is_seen_between_the_search_and_a_panel(
    filled: Web, tab_maker: Callable[..., Tab], width: int
) -> None:
    """In windows too narrow for both columns, and too wide for a sheet."""
    tab = tab_maker(viewport={"width": width, "height": 700})
    identity = filled.client.get("/collections/segments/items?limit=1").json()["features"][0]["id"]
    tab.page.goto(f"{filled.base}/map?segment={identity}")
    tab.await_true(RESTS)
    tab.page.locator(".panel .facts").first.wait_for()
    assert tab.page.evaluate(COVERED) == []
    search, panel = (tab.page.locator(one).bounding_box() for one in (".search", ".panel"))
    assert search is not None
    assert panel is not None
    assert search["x"] + search["width"] < panel["x"]


class _Styles(BaseHTTPRequestHandler):
    """Styles on a host of their own: without letters, and with."""

    def do_GET(self) -> None:
        here = {"type": "geojson", "data": {"type": "Point", "coordinates": [LON, LAT]}}
        layers: list[dict[str, Any]] = [
            {"id": "sea", "type": "background", "paint": {"background-color": "#124"}}
        ]
        if "lettered" in self.path:
            layout = {"text-field": "Theirs", "text-font": ["DejaVu Sans"]}
            layers.append({"id": "towns", "type": "symbol", "source": "here", "layout": layout})
        style = {"version": 8, "glyphs": "http://127.0.0.1:1/{fontstack}/{range}.pbf", "layers": layers}
        body = json.dumps({**style, "sources": {"here": here}}).encode()
        self.send_response(200)
        self.send_header("Access-Control-Allow-Origin", "*")
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture
def offering(settings: Settings, tmp_path: Path) -> Iterator[Web]:
    """A service that offers two backgrounds of another host."""
    host = ThreadingHTTPServer(("127.0.0.1", 0), _Styles)
    Thread(target=host.serve_forever, daemon=True).start()
    there = f"http://127.0.0.1:{host.server_port}"
    offered = f"Plain={there}/plain.json, With letters={there}/lettered.json"
    try:
        with served(settings.model_copy(update={"map_backgrounds": offered})) as web:
            import_roads(web.sessions, write_named_town(tmp_path / "town.osm"), tmp_path / "dem")
            yield web
    finally:
        host.shutdown()
        host.server_close()


def test_a_background_is_chosen_and_the_address_keeps_it(
    offering: Web, tab_maker: Callable[..., Tab]
) -> None:
    policy = offering.client.get("/map").headers["Content-Security-Policy"]
    assert policy.count("http://127.0.0.1:") == 2, "once each for pictures and for what is asked"
    tab = tab_maker(viewport={"width": 1280, "height": 800})
    page = tab.page
    page.goto(f"{offering.base}/map?at=13/{LAT}/{LON}")
    tab.await_true(RESTS)
    sea = "Boolean(window.versantMap.getLayer('background:sea'))"
    places = "Boolean(window.versantMap.getLayer('places'))"
    assert not page.evaluate(sea)
    choice = page.get_by_label("Background")
    choice.select_option("With letters")
    tab.await_true(f"{sea} && !{places} && {RESTS}")
    page.wait_for_url("**background=With+letters**")
    choice.select_option("Plain")
    tab.await_true(f"{sea} && {places} && {RESTS}")
    drawn(tab, places=["Łódź"])
    page.reload()
    tab.await_true(RESTS)
    assert page.evaluate(f"{sea} && {places}")
    page.go_back()
    tab.await_true(f"{sea} && !{places}")
    page.go_back()
    tab.await_true(f"!{sea} && {places}")
    assert choice.input_value() == ""
