"""What a page shows is in its address: Back, Forward, reload and a link lead through every state of every page."""

from __future__ import annotations

import json
import re
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pytest

from app.core import databases
from app.core.settings import Settings
from app.embedded.cluster import EmbeddedPostgres
from app.exports.run import EXPORT
from app.jobs.requests.run import perform
from app.jobs.task import Work
from app.map.derived.following import follow_all
from browser_fixtures import PATIENCE_MS, Tab
from fusion.roads.table import RoadTable
from many_drives import make_drives
from road_support import replace_roads
from web_fixtures import SOUTH, STEP, WEST, Web, add_drive, fill_roads, served

if TYPE_CHECKING:
    from playwright.sync_api import Page

MANY = 55
"""Drives: more than fit on one page of the list."""
AT = f"at=14.00/{SOUTH + 3.5 * STEP:.5f}/{WEST + 3.5 * STEP:.5f}"
"""The whole grid."""

MAP = """() => {
  const map = window.versantMap;
  if (!map || map.isMoving() || !map.loaded() || !document.querySelector('.total')) return null;
  const { lng, lat } = map.getCenter();
  const panel = document.querySelector('aside.panel');
  const all = (some) => [...document.querySelectorAll(some)];
  return {
    at: [map.getZoom().toFixed(2), lat.toFixed(5), lng.toFixed(5)],
    panel: panel && panel.getAttribute('aria-label'),
    colours: document.querySelector('.legend .choice select').value,
    layer: all('input[name=layer]').findIndex((one) => one.checked),
    classes: all('.classes [aria-pressed=true] .name').map((one) => one.textContent),
    sliders: all('.slider input').map((one) => one.value),
    moment: document.querySelector('.kept')?.textContent ?? '',
    tool: all('.tool .panel-actions button').map((one) => one.textContent),
  };
}"""
"""Null while the map moves or loads."""
DRIVES = """() => {
  if (!document.querySelector('main table:not([aria-busy=true])')) return null;
  return {
    names: [...document.querySelectorAll('tbody th')].map((one) => one.textContent),
    filters: [...document.querySelectorAll('.filters input, .filters select')].map((one) => one.value),
    sorted: document.querySelector('th[aria-sort]')?.textContent,
  };
}"""
DRIVE = """() => {
  const choice = document.querySelector('#compare-with');
  if (!choice || document.querySelectorAll('.u-over').length < 2) return null;
  const heading = document.querySelector('h1').textContent;
  const beside = document.querySelector('#compare ~ p[role=status]')?.textContent ?? '';
  const looked = [...document.querySelectorAll('[aria-pressed=true].name')].map((one) => one.textContent);
  return Boolean(choice.value) === Boolean(beside) ? { heading, with: choice.value, beside, looked } : null;
}"""
ADMIN = """() => {
  const days = document.querySelector('.reading select')?.value;
  if (!days || !document.querySelector('details.part')) return null;
  return { days, open: [...document.querySelectorAll('details.part[open]')].map((one) => one.id) };
}"""
DOCS = """() => {
  const heading = document.querySelector('h1')?.textContent;
  if (!heading || !document.querySelector('article.guide, details.operation')) return null;
  const [search, all] = [document.querySelector('#search')?.value, document.querySelectorAll('details.operation')];
  return { heading, search, all: all.length, open: [...all].filter((one) => one.open).map((one) => one.id) };
}"""
OTHERS = "() => document.querySelector('main h1')?.textContent ?? null"


@dataclass
class Filled:
    """A service in which every page has something to choose."""

    web: Web
    drive: uuid.UUID
    segment: int


@pytest.fixture(scope="module")
def filled(
    cluster: EmbeddedPostgres,
    template_db: str,
    new_database: Callable[[str], str],
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Filled]:
    """Two regions, drives over the grid, many others, and an export as a map; tests only read."""
    name = new_database(template_db)
    settings = Settings(database_url=cluster.url_of(name), data_dir=tmp_path_factory.mktemp("address"))
    with served(settings) as web:
        ids = fill_roads(web.sessions)
        with web.sessions.begin() as session:
            replace_roads(session, far_street(), "far.osm", "1" * 64, region="far")
        drive = add_drive(web.sessions, [0, 1, 2], 5.0, 0.2)
        add_drive(web.sessions, [2, 3, 4, 5], 0.5, 1.2)
        follow_all(web.sessions)
        make_drives(web.sessions, MANY)
        export = web.client.post("/v1/exports", json={"format": "pmtiles"}).json()["id"]
        assert perform(EXPORT, web.context, uuid.UUID(export), Work(bool, nullcontext)) == "done"
        yield Filled(web, drive, ids[0])
    databases.drop_database(cluster.url, name)


def far_street() -> RoadTable:
    """One street, a degree east of the grid."""
    return RoadTable.from_columns(
        osm_way_id=[950, 950],
        from_node=[2000, 2001],
        to_node=[2001, 2002],
        lon0_deg=[WEST + 1, WEST + 1 + STEP],
        lat0_deg=[SOUTH, SOUTH],
        lon1_deg=[WEST + 1 + STEP, WEST + 1 + 2 * STEP],
        lat1_deg=[SOUTH, SOUTH],
        oneway=[0, 0],
        bridge=[False, False],
        tunnel=[False, False],
        layer=[0, 0],
        highway=["residential"] * 2,
        name=[None, None],
    )


def click_road(page: Page) -> None:
    """On the middle of the grid's first segment."""
    place: dict[str, float] = page.evaluate(
        "(at) => window.versantMap.project(at)", [WEST + 2.5 * STEP, SOUTH + 2 * STEP]
    )
    frame = page.locator("canvas.maplibregl-canvas").bounding_box()
    assert frame is not None
    page.mouse.click(frame["x"] + place["x"], frame["y"] + place["y"])


def searched(written: str, option: str) -> Callable[[Page], None]:
    """Look for it on the map, and choose what is found."""

    def search(page: Page) -> None:
        page.get_by_role("combobox", name="Search the map").fill(written)
        page.get_by_role("option", name=re.compile(option)).first.click()

    return search


def chosen(label: str, **option: Any) -> Callable[[Page], None]:
    """In the list whose name begins so."""
    name = re.compile(f"^{label}")
    return lambda page: void(page.get_by_role("combobox", name=name).select_option(**option))


def pressed(role: Any, name: str, exact: bool = False) -> Callable[[Page], None]:
    return lambda page: page.get_by_role(role, name=name, exact=exact).first.click()


def written(label: str, text: str) -> Callable[[Page], None]:
    return lambda page: page.get_by_label(label).fill(text)


def void(_: object) -> None:
    """For what answers something."""


def draw_a_line(page: Page) -> None:
    """Along the grid's first street."""
    page.get_by_role("button", name="Draw on the map").click()
    for j in (1, 2):
        place = page.evaluate("(at) => window.versantMap.project(at)", [WEST, SOUTH + j * STEP])
        page.locator("canvas.maplibregl-canvas").click(position=place)
    page.get_by_role("button", name="Finish").click()


@dataclass
class Step:
    """From one state of a page to another by what a person does."""

    start: str
    shown: str
    act: Callable[[Page], None]
    address: str
    """A part of the second state's."""


STEPS = {
    "map: a road": Step(f"/map?{AT}", MAP, click_road, r"segment=\d+"),
    "map: the panel is closed": Step(
        f"/map?{AT}&segment=SEGMENT", MAP, pressed("button", "Close"), r"^(?!.*segment)"
    ),
    "map: another road": Step(f"/map?{AT}&segment=SEGMENT", MAP, click_road, r"segment=\d+"),
    "map: the whole way": Step(
        f"/map?{AT}&segment=SEGMENT", MAP, pressed("button", "The whole way"), r"way=\d+"
    ),
    "map: a region": Step(f"/map?{AT}", MAP, chosen("Region", value="far"), r"at=[\d.]+/49.0\d+/9.4"),
    "map: a place that was searched": Step(
        f"/map?{AT}", MAP, searched("49.1, 8.6", "49.1"), r"at=16.00/49.\d+/8.(59|6)"
    ),
    "map: a segment that was searched": Step(
        f"/map?{AT}", MAP, searched("segment 3", "Segment 3"), r"segment=3"
    ),
    "map: a way that was searched by name": Step(
        f"/map?{AT}", MAP, searched("Straße 30", "Straße 30"), r"way=\d+"
    ),
    "map: nearer": Step(
        "/map?at=4.00/49.00000/8.40000", MAP, lambda page: page.locator(".hint button").click(), r"at=6.2"
    ),
    "map: colours": Step(
        f"/map?{AT}&classes=4", MAP, chosen("Colours show", value="difference"), "colour=difference"
    ),
    "map: a class": Step(f"/map?{AT}", MAP, pressed("button", "4 to 6 %"), "classes=4"),
    "map: the uncertainty": Step(
        f"/map?{AT}", MAP, lambda page: page.get_by_role("slider", name="Uncertainty").fill("5"), "sigma=1"
    ),
    "map: everything": Step(
        f"/map?{AT}&classes=4&sigma=1&drives=1",
        MAP,
        pressed("button", "Show everything"),
        r"^(?!.*(sigma|cl))",
    ),
    "map: ways": Step(
        f"/map?{AT}&classes=4", MAP, lambda page: page.get_by_label("ways").check(), "layer=ways"
    ),
    "map: a kept one": Step(
        f"/map?{AT}",
        MAP,
        chosen("Map of", index=1),
        "export=[0-9a-f-]+",
    ),
    "map: a tool": Step(f"/map?{AT}", MAP, pressed("button", "Steepest streets"), "tool=steepest"),
    "map: another tool": Step(
        f"/map?{AT}&segment=SEGMENT", MAP, pressed("button", "Export this view"), "tool=export"
    ),
    "map: a tool is closed": Step(f"/map?{AT}&tool=profile", MAP, pressed("button", "Close"), r"^(?!.*tool)"),
    "map: a street of the steepest": Step(
        f"/map?{AT}&tool=steepest",
        MAP,
        lambda page: page.locator("ol.segments button").first.click(),
        r"segment=\d+.*tool=steepest",
    ),
    "map: a line": Step(f"/map?{AT}&tool=profile", MAP, draw_a_line, "line="),
    "drives: a status": Step(
        "/drives",
        DRIVES,
        chosen("Status", value="failed"),
        "status=failed",
    ),
    "drives: a search": Step("/drives", DRIVES, written("Search by", "log 5"), r"q=log"),
    "drives: another search": Step("/drives?q=log+4", DRIVES, written("Search by", "log 5"), r"q=log\+5"),
    "drives: a day": Step("/drives", DRIVES, written("Uploaded from", "2026-02-01"), "created_after"),
    "drives: an order": Step("/drives", DRIVES, pressed("button", "Length"), "sort=distance_m"),
    "drives: the next page": Step("/drives", DRIVES, pressed("link", "Next"), "after="),
    "drives: all": Step("/drives?status=failed", DRIVES, pressed("link", "All drives"), "drives$"),
    "drive: beside another": Step("/drives/DRIVE", DRIVE, chosen("Beside this", index=1), "with="),
    "drive: the steepest stretch": Step(
        "/drives/DRIVE", DRIVE, pressed("button", "uphill"), "stretch=steepest"
    ),
    "admin: a section": Step("/admin", ADMIN, pressed("link", "Coverage", True), "#coverage"),
    "admin: another section": Step("/admin#coverage", ADMIN, pressed("link", "Elevation"), "#terrain"),
    "admin: a section by its head": Step(
        "/admin", ADMIN, lambda page: page.locator("#coverage > summary").click(), "#coverage"
    ),
    "admin: the days": Step("/admin", ADMIN, chosen("Figures by day", value="7"), "days=7"),
    "docs: a search": Step("/docs", DOCS, written("Search guides", "webhooks"), "q=webhooks"),
    "docs: an operation": Step(
        "/docs", DOCS, lambda page: page.locator("#get-v1-changes > summary").click(), "#get-v1-changes"
    ),
    "docs: another operation": Step(
        "/docs#get-v1-changes",
        DOCS,
        lambda page: page.locator("#get-v1-drives > summary").click(),
        "#get-v1-changes,get-v1-drives",
    ),
    "docs: a guide": Step("/docs", DOCS, pressed("link", "Record a drive"), "/docs/how-to/record"),
    "upload: drives": Step("/upload", OTHERS, pressed("link", "Drives"), "/drives"),
    "keys: an owner": Step("/keys", OTHERS, pressed("link", "operator"), "/owner"),
}


USUAL = 3
"""Steps of a page that are tried every time: all pages write their addresses by the same code."""


def state(page: Page, shown: str, like: object = None, unlike: object = None) -> object:
    """What the page shows, once it is so or no longer so."""
    ends = time.monotonic() + PATIENCE_MS / 1000
    before: object = None
    while True:
        now = page.evaluate(shown)
        done = now is not None and now == before and (like is None or now == like) and now != unlike
        if done or time.monotonic() > ends:
            assert done, (
                f"{json.dumps(now)} is not {json.dumps(like)} or still {json.dumps(unlike)} at {page.url}"
            )
            return now
        before = now
        page.wait_for_timeout(200)


def tried() -> Iterator[Any]:
    """The first steps of each page, and the others where there is time."""
    so_far = Counter[str]()
    for name in STEPS:
        so_far[name.split(":")[0]] += 1
        usual = so_far[name.split(":")[0]] <= USUAL
        marks = () if usual else (pytest.mark.long("seven seconds of a browser for each of two dozen steps"),)
        yield pytest.param(name, marks=marks)


@pytest.mark.parametrize("name", [*tried()])
def test_back_forward_reload_and_a_link(filled: Filled, tab_maker: Callable[..., Tab], name: str) -> None:
    step = STEPS[name]
    base = filled.web.base
    start = step.start.replace("SEGMENT", str(filled.segment)).replace("DRIVE", str(filled.drive))
    tab = tab_maker(viewport={"width": 1280, "height": 800})
    page = tab.page
    page.goto(f"{base}/healthz")
    page.goto(base + start)
    first = state(page, step.shown)
    first_address = page.url
    step.act(page)
    page.wait_for_url(re.compile(step.address))
    second = state(page, step.shown, unlike=first)
    second_address = page.url
    assert re.search(step.address, second_address.removeprefix(base))
    page.go_back()
    state(page, step.shown, like=first)
    assert page.url == first_address
    page.go_forward()
    state(page, step.shown, like=second)
    assert page.url == second_address
    page.reload()
    state(page, step.shown, like=second)
    page.go_back()
    state(page, step.shown, like=first)
    page.go_back()
    assert page.url == f"{base}/healthz"
    other = tab_maker(viewport={"width": 1280, "height": 800})
    other.page.goto(second_address)
    state(other.page, step.shown, like=second)
