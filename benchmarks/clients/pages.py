"""How fast the pages are in a real browser: the map's first view, panning it, a drive of eight hours.

    PYTHONPATH=.:benchmarks python -m clients.pages [MAP.osm.pbf] [--rounds 5] [--maplibre FOLDER] [--json FILE]

A service on the roads of MAP (default: Heidelberg, beside the repository), of which nine in ten ways have slopes, is
opened in Debian's Chromium without a screen, which draws by the processor. Medians of the rounds:

    first view    from the address to a map that is drawn and at rest, with an empty cache
    next view     the same once more, in the same browser
    transferred   bytes of the first view as they came over the connection, headers and all
    panning       frames a second while the map is moved over the town for four seconds, beside a plain example of
                  MapLibre in the same window: the same tiles and segments, lines of one colour and width
    long drive    from the address of a drive of eight hours (30,000 points, computed by a worker before) to its curves

The plain example needs MapLibre by itself: ``npm ci`` in ``app/web``, or FOLDER with ``maplibre-gl.mjs``; without,
panning is measured alone. Aims: 2 s, 0.7 s, 1 MB, 30 frames a second or as many as the plain example, 2 s.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from shutil import which
from typing import TYPE_CHECKING, Any

import httpx

from accuracy.logs import write_columns
from accuracy.scoring import show_progress, write_json
from clients.scene import Scene, scene
from fusion.roads.osm import read_roads
from profile_speed import record
from service.logs import columns_of

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Route

HERE = Path(__file__).resolve().parents[2]
HEIDELBERG = HERE.parent / "shared/data/maps/heidelberg-2024-09.test.osm.pbf"
MAPLIBRE = HERE / "app/web/node_modules/maplibre-gl/dist"
FLAGS = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-sync",
)
WINDOW = {"width": 1280, "height": 800}
PATIENCE_MS = 120_000
HOURS = 8.4
"""Recorded at 1 Hz: some 30,000 points."""
ZOOM = 13.0
AIMS = {"first view s": 2.0, "next view s": 0.7, "transferred MB": 1.0, "long drive s": 2.0}

RESTS = "() => window.versantMap !== undefined && window.versantMap.loaded() && !window.versantMap.isMoving()"
IS_DRAWN = "() => document.querySelector('.uplot canvas') !== null"
PAN = """async (steps) => {
  const map = window.versantMap;
  let frames = 0, on = true;
  const count = () => { frames += 1; if (on) requestAnimationFrame(count); };
  requestAnimationFrame(count);
  const began = performance.now();
  for (const [x, y] of steps) {
    const ended = new Promise((done) => map.once("moveend", done));
    map.panBy([x, y], { duration: 1000, easing: (share) => share });
    await ended;
  }
  on = false;
  return (1000 * frames) / (performance.now() - began);
}"""
STEPS = [[700, 0], [0, 500], [-700, 0], [0, -500]]
PLAIN = """<!doctype html><meta charset="utf-8"><link rel="stylesheet" href="/plain/maplibre-gl.css">
<body style="margin:0"><div id="map" style="width:100vw;height:100vh"></div><script type="module">
import { Map } from "/plain/maplibre-gl.mjs";
window.versantMap = new Map({ container: "map", center: [LON, LAT], zoom: ZOOM, style: { version: 8,
  sources: { slopes: { type: "vector", url: location.origin + "/tiles.json" } },
  layers: [{ id: "roads", type: "line", source: "slopes", "source-layer": "segments",
             paint: { "line-color": "#333", "line-width": 2 } }] } });
</script>"""


@dataclass
class Figures:
    """What each round measured."""

    rounds: dict[str, list[float]] = field(default_factory=dict)

    def add(self, name: str, value: float) -> None:
        """One more."""
        self.rounds.setdefault(name, []).append(value)

    def median(self, name: str) -> float:
        """Of all rounds; NaN where there is none."""
        return statistics.median(self.rounds[name]) if name in self.rounds else float("nan")


def main() -> None:
    """Make the scene, measure, print, write JSON."""
    chosen = _arguments()
    figures = Figures()
    with scene(chosen.map) as here, _browser() as browser:
        place = _middle(here)
        for number in range(chosen.rounds):
            show_progress(f"round {number + 1} of {chosen.rounds}")
            _views(browser, here.address, figures)
            figures.add("panning, frames/s", _panning(browser, f"{here.address}/map", place, None))
            if (chosen.maplibre / "maplibre-gl.mjs").is_file():
                plain = _panning(browser, f"{here.address}/plain/", place, chosen.maplibre)
                figures.add("plain, frames/s", plain)
        show_progress("a drive of eight hours")
        address, points = _long_drive(here, chosen.map)
        for _ in range(chosen.rounds):
            figures.add("long drive s", _seconds(browser, address, IS_DRAWN))
    show_progress("")
    medians = {name: figures.median(name) for name in figures.rounds}
    for name, value in medians.items():
        aim = f"{AIMS[name]:g} asked" if name in AIMS else ""
        print(f"{name:<20} {value:8.2f}  {aim}")
    print(f"The drive has {points:,} points.")
    write_json(chosen.json, {"medians": medians, "rounds": figures.rounds, "points": points})


@contextmanager
def _browser() -> Iterator[Browser]:
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - `--help` needs no browser

    program = which("chromium") or which("chromium-browser")
    if program is None:
        raise SystemExit("Chromium is missing: install Debian's package chromium.")
    with sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=program, args=list(FLAGS))
        yield started
        started.close()


def _views(browser: Browser, address: str, figures: Figures) -> None:
    """The map with an empty cache and with a full one, and what came over the connection."""
    context = browser.new_context(viewport=WINDOW)  # type: ignore[arg-type]
    try:
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        wire = context.new_cdp_session(page)
        wire.send("Network.enable")
        received: list[float] = []
        wire.on("Network.loadingFinished", lambda event: received.append(event["encodedDataLength"]))
        figures.add("first view s", _timed(page, f"{address}/map", RESTS))
        figures.add("transferred MB", sum(received) / 1e6)
        page.goto("about:blank")
        figures.add("next view s", _timed(page, f"{address}/map", RESTS))
    finally:
        context.close()


def _timed(page: Page, address: str, condition: str) -> float:
    began = time.perf_counter()
    page.goto(address, wait_until="commit")
    _until(page, condition)
    return time.perf_counter() - began


def _until(page: Page, condition: str) -> None:
    """Ask until it is so: the driver's own way of waiting is what the pages' policy forbids."""
    ends = time.monotonic() + PATIENCE_MS / 1000
    while not page.evaluate(condition):
        if time.monotonic() > ends:
            raise SystemExit(f"{page.url} did not get ready.")
        time.sleep(0.01)


def _seconds(browser: Browser, address: str, condition: str) -> float:
    context = browser.new_context(viewport=WINDOW)  # type: ignore[arg-type]
    try:
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        return _timed(page, address, condition)
    finally:
        context.close()


def _panning(browser: Browser, address: str, place: tuple[float, float], maplibre: Path | None) -> float:
    """Frames a second over the town; of the plain example where ``maplibre`` is given."""
    context = browser.new_context(viewport=WINDOW)  # type: ignore[arg-type]
    try:
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        if maplibre is not None:
            folder = maplibre

            def answer(route: Route) -> None:
                name = route.request.url.split("?")[0].rsplit("/", 1)[1]
                if name:
                    route.fulfill(path=folder / name)
                else:
                    text = PLAIN.replace("LON", str(place[0])).replace("LAT", str(place[1]))
                    route.fulfill(body=text.replace("ZOOM", str(ZOOM)), content_type="text/html")

            context.route("**/plain/*", answer)
        page.goto(address)
        _until(page, RESTS)
        page.evaluate(
            "([lon, lat, zoom]) => window.versantMap.jumpTo({center: [lon, lat], zoom})", [*place, ZOOM]
        )
        _until(page, RESTS)
        page.evaluate(PAN, STEPS)  # what comes into view is fetched
        return float(page.evaluate(PAN, STEPS))
    finally:
        context.close()


def _middle(here: Scene) -> tuple[float, float]:
    west, south, east, north = _get(f"{here.address}/tiles.json")["bounds"]
    return (west + east) / 2, (south + north) / 2


def _long_drive(here: Scene, roads: Path) -> tuple[str, int]:
    """The page of a drive of eight hours that a worker has computed, and its number of points."""
    log = record(read_roads(roads), HOURS, 1)[0]
    with tempfile.TemporaryDirectory(prefix="versant-pages-") as name:
        columns = columns_of(log, 0.0, length_m=float("inf"))
        content = write_columns(columns, Path(name) / "log.csv").read_bytes()
    answer = httpx.post(
        f"{here.address}/v1/drives",
        params={"filename": "eight-hours.csv"},
        content=content,
        headers={"Content-Type": "text/csv"},
        timeout=60,
        trust_env=False,
    )
    answer.raise_for_status()
    drive = f"{here.address}/v1/drives/{answer.json()['id']}"
    with here.service.started(*here.service.worker):
        while (now := _get(drive))["status"] not in ("done", "failed"):
            time.sleep(0.5)
    if now["status"] == "failed":
        raise SystemExit(f"The drive failed: {now['failure']['reason']}")
    return f"{here.address}/drives/{now['id']}", int(now["epochs"])


def _get(address: str) -> Any:
    return httpx.get(address, trust_env=False, timeout=60).raise_for_status().json()


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=(__doc__ or "").split("\n", 1)[0], epilog=(__doc__ or "").split("\n\n", 2)[2],
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument(
        "map", type=Path, nargs="?", default=HEIDELBERG, help="road map: .osm.pbf, .osm or .osm.gz"
    )
    parser.add_argument("--rounds", type=int, default=5, help="of which medians are taken")
    parser.add_argument("--maplibre", type=Path, default=MAPLIBRE, help="folder with maplibre-gl.mjs")
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    return parser.parse_args()


if __name__ == "__main__":
    main()
