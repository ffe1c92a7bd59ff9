"""Clients of the tiles: GDAL's MVT driver, and MapLibre in a browser without a screen, on the service's own style."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import numpy as np
import pandas
import pyogrio

from clients.truth import DRAWN, EXPECTED_KINDS, Reading

ZOOM = 13
"""From which on tiles hold every segment (VERSANT_TILE_FULL_ZOOM)."""
NAMES = ("id", *DRAWN)
LIMIT_S = 600.0
SIDE_PX = 1024
"""Of the browser's map: two tiles each way."""

Box = tuple[float, float, float, float]


def in_gdal(address: str, folder: Path, suffix: str = "mvt") -> Reading:
    """GDAL's MVT driver on all tiles of one zoom, by the TileJSON. A segment comes once by its id, whole or cut."""
    began = time.perf_counter()
    frame = pyogrio.read_dataframe(
        f"MVT:{address}/tiles/{ZOOM}",
        layer="segments",
        read_geometry=False,
        METADATA_FILE=f"{address}/tiles.json",
        TILE_EXTENSION=suffix,
        CLIP="NO",
    )
    seconds = time.perf_counter() - began
    rows = {int(row["mvt_id"]): {**row, "id": int(row["mvt_id"])} for row in frame.to_dict("records")}
    gdal = ".".join(map(str, pyogrio.__gdal_version__))
    summary = f"{len(frame)} parts of lines in tiles of zoom {ZOOM}, .{suffix}"
    return Reading(rows.values(), NAMES, gdal, _kinds(frame), summary, seconds)


def _kinds(frame: pandas.DataFrame) -> dict[str, str]:
    """Of what kind each property is; a TileJSON knows numbers, and no whole ones."""
    expected = {name: EXPECTED_KINDS[name] for name in DRAWN}
    return {
        name: kind if pandas.api.types.is_numeric_dtype(frame[name]) == (kind != "text") else "text"
        for name, kind in expected.items()
    }


PAGE = """<!doctype html><meta charset="utf-8"><link rel="stylesheet" href="/maplibre/maplibre-gl.css">
<body style="margin:0"><div id="map" style="width:SIDEpx;height:SIDEpx"></div><script type="module">
const said = [], asked = [];
const complain = (what) => said.push(String(what));
for (const level of ['error', 'warn']) {
  const usual = console[level].bind(console);
  console[level] = (...what) => { complain(what.join(' ')); usual(...what); };
}
addEventListener('error', (event) => complain(event.message));
addEventListener('unhandledrejection', (event) => complain(event.reason));
const finish = (result) => fetch('/result', {method: 'POST', body: JSON.stringify({...result, said, asked})});
try {
  const library = await import('/maplibre/maplibre-gl.mjs');
  const maplibre = library.default ?? library;
  const version = (library.getVersion ?? maplibre.getVersion)();
  const map = new maplibre.Map({
    container: 'map', style: 'STYLE', center: PLACES[0], zoom: ZOOM, fadeDuration: 0, maxZoom: ZOOM,
    transformRequest: (url) => { asked.push(url); return {url}; },
  });
  map.on('error', (event) => complain(event.error?.message ?? event.error));
  const rows = new Map(), drawn = new Set();
  const PROPERTIES = NAMES;
  for (const place of PLACES) {
    const idle = new Promise((done) => map.once('idle', done));
    map.jumpTo({center: place, zoom: ZOOM});
    map.triggerRepaint();
    await idle;
    for (const one of map.querySourceFeatures('slopes', {sourceLayer: 'segments'})) {
      if (!rows.has(one.id)) rows.set(one.id, PROPERTIES.map((name) => one.properties[name] ?? null));
    }
    for (const one of map.queryRenderedFeatures()) drawn.add(one.id);
  }
  await finish({version, rows: [...rows], drawn: [...drawn]});
} catch (error) { complain(error.stack ?? error); await finish({rows: [], drawn: []}); }
</script>"""


def in_browser(address: str, folder: Path, maplibre: Path) -> Reading:
    """MapLibre in Chromium: walks over the whole extent and says which segments it has and which it draws."""
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        raise FileNotFoundError("chromium is not installed")
    tile_json = httpx.get(f"{address}/tiles.json", trust_env=False).json()
    page = PAGE
    for name, value in {
        "SIDE": SIDE_PX, "STYLE": f"{address}/style.json", "PLACES": json.dumps(places(tile_json["bounds"])),
        "ZOOM": ZOOM, "NAMES": json.dumps(DRAWN),
    }.items():  # fmt: skip
        page = page.replace(name, str(value))
    began = time.perf_counter()
    net_log = folder / "net.json"
    with page_server(page, maplibre) as (here, results), browser(program, here, folder, net_log) as process:
        result = results(process)
    seconds = time.perf_counter() - began
    if result["said"]:
        raise RuntimeError(f"the browser's console: {result['said'][:3]}")
    hosts = hosts_of(result["asked"]) | hosts_in(net_log)
    if others := hosts ^ {"127.0.0.1"}:
        raise RuntimeError(f"it asked other hosts: {sorted(others)}")
    drawn = set(result["drawn"])
    rows = [{"id": number, **dict(zip(DRAWN, values, strict=True))} for number, values in result["rows"]]
    undrawn = [row["id"] for row in rows if row["id"] not in drawn]
    if undrawn:
        raise RuntimeError(f"{len(undrawn)} segments are in tiles and not drawn, such as {undrawn[:3]}")
    summary = f"{len(drawn)} drawn, {len(result['asked'])} requests, all to this service"
    return Reading(rows, NAMES, f"{result['version']}", remarks=summary, seconds=seconds)


def places(bounds: Box) -> list[tuple[float, float]]:
    """Centres of views that cover a box in degrees, from one to the next of them."""
    west, south, east, north = bounds
    step = SIDE_PX / 512 * 0.9 / 2**ZOOM  # a tenth over each other; shares of the world's width

    def down(lat_deg: float) -> float:
        return 0.5 - math.asinh(math.tan(math.radians(lat_deg))) / math.tau

    across = np.arange(west / 360 + step / 2 - 1e-9, east / 360 + step / 2 + 1e-9, step)
    along = np.arange(down(north) + step / 2 - 1e-9, down(south) + step / 2 + 1e-9, step)
    return [
        (360 * float(x), math.degrees(math.atan(math.sinh((0.5 - float(y)) * math.tau))))
        for y in along
        for x in across
    ]


Results = Callable[["subprocess.Popen[bytes]"], dict[str, Any]]


@contextmanager
def page_server(page: str, maplibre: Path) -> Iterator[tuple[str, Results]]:
    """Serves the page and the library on the loopback, and takes what the page found."""
    arrived, received = threading.Event(), {}

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            name = urlsplit(self.path).path.removeprefix("/maplibre/")
            file = maplibre / Path(name).name
            if self.path == "/":
                self._answer(page.encode(), "text/html; charset=utf-8")
            elif file.is_file() and name != self.path:
                self._answer(file.read_bytes(), "text/css" if file.suffix == ".css" else "text/javascript")
            else:
                self.send_error(204 if self.path == "/favicon.ico" else 404)

        def do_POST(self) -> None:
            received.update(json.loads(self.rfile.read(int(self.headers["content-length"]))))
            self._answer(b"", "text/plain")
            arrived.set()

        def _answer(self, content: bytes, media_type: str) -> None:
            self.send_response(200)
            self.send_header("content-type", media_type)
            self.send_header("content-length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: object) -> None:
            """Says nothing."""

    def results(process: subprocess.Popen[bytes]) -> dict[str, Any]:
        ends = time.monotonic() + LIMIT_S
        while not arrived.wait(0.1):
            if process.poll() is not None or time.monotonic() > ends:
                raise RuntimeError("the browser ended without a result")
        return received

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=partial(server.serve_forever, poll_interval=0.05))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/", results
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


@contextmanager
def browser(program: str, address: str, folder: Path, net_log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Chromium without a screen on a page, with a profile of its own and without errands of its own."""
    command = [
        program, "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
        "--ignore-gpu-blocklist", "--no-first-run", "--disable-background-networking", "--disable-component-update",
        "--disable-sync", "--disable-default-apps", "--disable-features=OptimizationHints,MediaRouter",
        f"--user-data-dir={folder / 'profile'}", f"--log-net-log={net_log}", f"--window-size={SIDE_PX},{SIDE_PX}",
        "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1", address,
    ]  # fmt: skip
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()


def hosts_of(addresses: list[str]) -> set[str]:
    """The hosts of absolute addresses."""
    return {host for address in addresses if (host := urlsplit(address).hostname)}


def hosts_in(net_log: Path) -> set[str]:
    """The hosts that pages asked for, by Chromium's own log. Errands of its own, which go nowhere, are no page's."""
    hosts = set()
    for text in net_log.read_text(errors="replace").splitlines():
        if '"initiator":"http' in text and '"url":' in text:
            params = json.loads(text.strip().removesuffix("]}").removesuffix(",")).get("params", {})
            hosts |= hosts_of([params["url"]] if "url" in params else [])
    return hosts
