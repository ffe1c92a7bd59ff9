"""Names on the map, the scale that nothing covers, and backgrounds that people choose."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import osmium
import pytest
from osmium.osm.mutable import Node, Way

from app.core.settings import Settings
from app.roads.imports import import_roads
from browser_fixtures import Tab
from web_fixtures import Web, served

LON, LAT, STEP = 8.69, 49.41, 0.004
SIZES = {"desk": (1280, 800), "phone": (390, 844)}
NAMED = """(layer) => [...new Set(window.versantMap.queryRenderedFeatures({layers: [layer]})
    .map((one) => one.properties.name ?? one.properties.ref))].sort()"""
SEEN = """() => {
  const box = document.querySelector('.maplibregl-ctrl-scale').getBoundingClientRect();
  const at = (x, y) => document.elementFromPoint(x, y)?.className ?? 'nothing';
  return [at(box.left + 2, box.top + 2), at(box.right - 2, box.bottom - 2)];
}"""
SCALE = ["maplibregl-ctrl maplibregl-ctrl-scale"] * 2
RESTS = "Boolean(window.versantMap?.loaded() && !window.versantMap.isMoving())"


def town(file: Path) -> Path:
    """A cross of streets with a place in its middle, and a river beside."""
    with osmium.SimpleWriter(str(file)) as writer:
        for n in range(-9, 10):
            writer.add_node(Node(id=10 + n, location=(LON + n * STEP, LAT), version=1))
            writer.add_node(Node(id=30 + n, location=(LON, LAT + n * STEP), version=1))
            writer.add_node(Node(id=50 + n, location=(LON + n * STEP, LAT - STEP / 2), version=1))
        tags = {"place": "town", "name": "Łódź", "population": "1500"}
        writer.add_node(Node(id=70, location=(LON + 1.5 * STEP, LAT + 1.5 * STEP), tags=tags, version=1))
        main = {"highway": "primary", "name": "Große Straße", "ref": "B 37"}
        writer.add_way(Way(id=1, nodes=range(1, 20), tags=main, version=1))
        lane = {"highway": "residential", "name": "Şirin Çeşme"}
        writer.add_way(Way(id=2, nodes=range(21, 40), tags=lane, version=1))
        river = {"waterway": "river", "name": "Neckar"}
        writer.add_way(Way(id=3, nodes=range(41, 60), tags=river, version=1))
    return file


@pytest.fixture
def named(web: Web, tmp_path: Path) -> Web:
    """A service with such a town."""
    import_roads(web.sessions, town(tmp_path / "town.osm"), tmp_path / "dem")
    return web


def go(tab: Tab, zoom: float) -> None:
    tab.page.evaluate("([zoom, at]) => window.versantMap.jumpTo({zoom, center: at})", [zoom, [LON, LAT]])
    tab.await_true(RESTS)


def drawn(tab: Tab, **wanted: list[str]) -> None:
    """Wait until these layers show these names and no others; labels appear a moment after the tiles."""
    for layer, names in wanted.items():
        named = layer.replace("_", "-")
        tab.await_true(f"({NAMED})({json.dumps(named)}).join() === {json.dumps(','.join(names))}")


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("size", SIZES)
def test_names_are_drawn_at_their_zooms_and_the_scale_is_seen(
    named: Web, tab_maker: Callable[..., Tab], size: str, theme: str
) -> None:
    width, height = SIZES[size]
    tab = tab_maker(viewport={"width": width, "height": height}, color_scheme=theme)
    page = tab.page
    page.goto(f"{named.base}/map?at=10/{LAT}/{LON}")
    tab.await_true(RESTS)
    drawn(tab, places=["Łódź"], street_names=[], water_names=[])
    go(tab, 13)
    drawn(tab, street_names=["Große Straße"], road_numbers=["B 37"], water_names=["Neckar"], places=["Łódź"])
    go(tab, 14.5)
    drawn(tab, street_names=["Große Straße", "Şirin Çeşme"])
    assert page.evaluate(SEEN) == SCALE
    assert tab.faults() == []
    # As long as the credit of many rasters.
    page.evaluate(
        "document.querySelector('.maplibregl-ctrl-attrib-inner').append(', raster of heights'.repeat(9))"
    )
    assert page.evaluate(SEEN) == SCALE
    summary = page.locator(".legend summary")
    if page.locator(".legend").get_attribute("open") is None:
        summary.click()
    assert page.evaluate(SEEN) == SCALE
    identity = named.client.get("/collections/segments/items?limit=1").json()["features"][0]["id"]
    page.goto(f"{named.base}/map?segment={identity}")
    tab.await_true(RESTS)
    page.locator(".panel h2").wait_for()
    page.wait_for_timeout(400)  # the sheet has come up
    assert page.evaluate(SEEN) == SCALE


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
            import_roads(web.sessions, town(tmp_path / "town.osm"), tmp_path / "dem")
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
