"""What the map page does with the part of the map that is shown: steepest streets, profiles, files, proposals."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

import pytest

from app.exports.run import EXPORT
from app.jobs.requests.run import perform
from app.jobs.task import Work
from app.web import guides
from browser_fixtures import Tab
from page_states.services import heights_where_it_is_steep
from web_fixtures import SOUTH, STEP, WEST, Web

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page

AT = f"at=14.00/{SOUTH + 3.5 * STEP}/{WEST + 3.5 * STEP}"
"""Over the whole grid."""
DESK, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
MARKS = """(kind) => {
  const map = window.versantMap;
  const some = map.querySourceFeatures('marks').filter((one) => one.properties.kind === kind);
  return some.length;
}"""
READY = "Boolean(window.versantMap?.loaded() && !window.versantMap.isMoving())"


@pytest.fixture
def steep(filled: Web, drive_maker: Callable[..., Any]) -> Web:
    """Two streets with names and one without, one of them driven twice, and heights along one of them."""
    drive_maker(filled.sessions, [0, 2], 9.0, 0.5)
    drive_maker(filled.sessions, [4], 7.0, 0.2)
    drive_maker(filled.sessions, [4], 7.0, 0.2)
    drive_maker(filled.sessions, [9], -8.0, 0.4)
    drive_maker(filled.sessions, [20], 12.0, 9.0)
    heights_where_it_is_steep(filled)
    return filled


def opened(tab: Tab, web: Web, query: str = AT) -> Page:
    tab.page.goto(f"{web.base}/map?{query}")
    tab.await_true(READY)
    return tab.page


def tool(page: Page, name: str) -> Locator:
    """The panel that the button of this name opens; on a phone the buttons are folded."""
    tools = page.locator("details.tools")
    if tools.get_attribute("open") is None:
        tools.locator("summary").click()
    tools.get_by_role("button", name=name).click()
    panel = page.get_by_role("complementary")
    panel.wait_for()
    return panel


def test_steepest_streets_follow_the_map_and_its_filters(steep: Web, tab_maker: Callable[..., Tab]) -> None:
    tab = tab_maker(viewport=DESK)
    asked: list[str] = []
    tab.page.on("request", lambda one: asked.append(one.url) if "sortby=-steepness" in one.url else None)
    page = opened(tab, steep)
    assert asked == []
    panel = tool(page, "Steepest streets")
    rows = panel.locator("ol.segments button")
    rows.nth(3).wait_for()
    # 12 % of 9 % sigma is nothing to lead a list with, and a street is there once.
    assert [re.search(r"\d[.]\d ± \d[.]\d %", one).group() for one in rows.all_inner_texts()] == [  # type: ignore[union-attr]
        "9.0 ± 0.5 %",
        "9.0 ± 0.5 %",
        "8.0 ± 0.4 %",
        "7.0 ± 0.1 %",
    ]
    assert len(asked) == 1
    rows.first.focus()
    tab.await_true(f"({MARKS})('street') > 0")
    rows.first.click()
    page.get_by_role("complementary", name=re.compile("Segment")).wait_for()
    assert "segment=" in page.url
    page.go_back()
    rows.nth(3).wait_for()
    assert "segment=" not in page.url
    page.goto(f"{steep.base}/map?{AT}&tool=steepest&drives=2")
    panel.get_by_text("1 street", exact=True).wait_for(state="attached")
    assert rows.count() == 1
    before = len(asked)
    page.evaluate("window.versantMap.jumpTo({ center: [8.9, 49.5], zoom: 14 })")
    panel.get_by_text("No street here was measured").wait_for()
    assert len(asked) == before + 1
    page.evaluate("window.versantMap.jumpTo({ zoom: 8 })")
    panel.get_by_text("Go nearer").wait_for()
    page.wait_for_timeout(600)
    assert len(asked) == before + 1
    panel.get_by_role("button", name="Close").click()
    panel.wait_for(state="detached")
    assert "tool=" not in page.url


def test_steepest_streets_follow_new_drives(filled: Web, drive_maker: Callable[..., Any], tab: Tab) -> None:
    page = opened(tab, filled, f"{AT}&tool=steepest")
    panel = page.get_by_role("complementary")
    panel.get_by_text("No street here was measured").wait_for()
    page.wait_for_timeout(300)  # the page hears of changes
    drive_maker(filled.sessions, [0], 9.0, 0.5)
    panel.get_by_role("button", name=re.compile(r"9\.0 ± 0\.5 %")).wait_for()


def drawn_by_clicks(tab: Tab, *places: tuple[float, float]) -> None:
    page = tab.page
    frame = page.locator("canvas.maplibregl-canvas").bounding_box()
    assert frame is not None
    for n, place in enumerate(places, 1):
        at = page.evaluate("(at) => window.versantMap.project(at)", list(place))
        press = page.mouse.dblclick if n == len(places) else page.mouse.click
        press(frame["x"] + at["x"], frame["y"] + at["y"])


def test_a_line_that_is_drawn_has_a_profile_and_an_address(steep: Web, tab_maker: Callable[..., Tab]) -> None:
    tab = tab_maker(viewport=DESK)
    page = opened(tab, steep)
    panel = tool(page, "Profile along a line")
    panel.get_by_role("button", name="Draw on the map").click()
    panel.get_by_text("0 points", exact=True).wait_for()
    tab.await_true(READY)
    drawn_by_clicks(tab, (WEST, SOUTH + 0.1 * STEP), (WEST, SOUTH + 0.5 * STEP), (WEST, SOUTH + 0.9 * STEP))
    panel.get_by_role("figure", name="Slopes along the line").wait_for()
    assert "line=" in page.url
    assert "segment=" not in page.url
    facts = panel.locator(".facts").inner_text()
    assert re.search(r"Length\s+1[78]\d m", facts), facts
    assert re.search(r"Ascent\s+1[56]\d ± ", facts), facts  # 200 m on 222 m, of which four fifths
    assert re.search(r"Measured\s+100 %", facts), facts
    reading = panel.get_by_role("slider", name="Read off: Heights along the line")
    reading.press("ArrowRight")
    assert re.search(r"measured 1\d\d\.\d ± \d\.\d m", reading.get_attribute("aria-valuetext") or "")
    page.locator(".pointed").wait_for()
    address = page.url
    page.go_back()
    panel.get_by_role("button", name="Draw on the map").wait_for()
    page.go_forward()
    panel.get_by_role("figure", name="Slopes along the line").wait_for()
    page.reload()
    panel.get_by_role("figure", name="Slopes along the line").wait_for()
    assert page.url == address
    tab.await_true(f"({MARKS})('line') > 0")


def aim_at(page: Page, lon: float, lat: float) -> None:
    """Move the map until the keyboard draws there; keys would take many steps."""
    page.evaluate(
        """([lon, lat]) => {
          const map = window.versantMap;
          const [aim] = map.querySourceFeatures('marks').filter((one) => one.properties.kind === 'aim');
          const [x, y] = aim.geometry.coordinates;
          const { lng, lat: middle } = map.getCenter();
          map.jumpTo({ center: [lng + lon - x, middle + lat - y] });
        }""",
        [lon, lat],
    )


def test_a_line_is_drawn_by_keys_and_left_by_escape(steep: Web, tab_maker: Callable[..., Tab]) -> None:
    tab = tab_maker(viewport=PHONE)
    page = opened(tab, steep, f"at=16.00/{SOUTH + 0.5 * STEP}/{WEST}&tool=profile")
    panel = page.get_by_role("complementary")
    panel.get_by_role("button", name="Draw on the map").press("Enter")
    panel.get_by_text("0 points", exact=True).wait_for()
    page.keyboard.press("ArrowUp")  # the keyboard is where it draws
    tab.await_true(f"{READY} && ({MARKS})('aim') > 0")
    aim_at(page, WEST, SOUTH + 0.3 * STEP)
    page.keyboard.press("Space")
    panel.get_by_text("1 point", exact=True).wait_for()
    aim_at(page, WEST, SOUTH + 0.7 * STEP)
    page.keyboard.press("Space")
    panel.get_by_text("2 points", exact=True).wait_for()
    page.keyboard.press("Backspace")
    panel.get_by_text("1 point", exact=True).wait_for()
    panel.get_by_role("button", name="Add a point in the middle").press("Enter")
    panel.get_by_text("2 points", exact=True).wait_for()
    page.locator("canvas.maplibregl-canvas").focus()
    page.keyboard.press("Enter")
    panel.get_by_role("figure", name="Heights along the line").wait_for()
    assert "line=" in page.url
    address = page.url
    panel.get_by_role("button", name="Draw another line").click()
    panel.get_by_text("0 points", exact=True).wait_for()
    page.keyboard.press("Escape")
    panel.get_by_role("figure", name="Heights along the line").wait_for()
    assert page.url == address
    page.keyboard.press("Escape")
    panel.wait_for(state="detached")


def gpx(points: int) -> bytes:
    """Up and down a street, in a file as recorders write them."""
    rows = "".join(
        f'<trkpt lat="{SOUTH + STEP * (0.1 + 0.8 * (n % 1000) / 1000):.7f}" lon="{WEST + n * 1e-9:.7f}"/>'
        for n in range(points)
    )
    head = '<?xml version="1.0"?><gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>'
    return f"{head}{rows}</trkseg></trk></gpx>".encode()


def test_a_line_out_of_a_file(steep: Web, tab_maker: Callable[..., Tab]) -> None:
    tab = tab_maker(viewport=DESK)
    page = opened(tab, steep, f"{AT}&tool=profile")
    panel = page.get_by_role("complementary")
    chooser = panel.locator("input[type=file]")
    short = {
        "type": "Feature",
        "properties": {},
        "geometry": {"type": "LineString", "coordinates": [[WEST, SOUTH], [WEST, SOUTH + STEP, 3]]},
    }

    def choose(name: str, content: bytes) -> None:
        chooser.set_input_files({"name": name, "mimeType": "", "buffer": content})

    choose("street.geojson", json.dumps(short).encode())
    panel.get_by_text("The line of street.geojson.").wait_for()
    panel.get_by_role("figure", name="Heights along the line").wait_for()
    assert "line=" in page.url
    choose("ride.gpx", gpx(6000))
    panel.get_by_text("It has 6,000 points, of which 5,000 evenly taken ones are used.").wait_for()
    panel.get_by_text("This line is too long for the page's address").wait_for()
    panel.get_by_role("figure", name="Heights along the line").wait_for()
    assert "line=" not in page.url
    assert tab.faults() == []
    choose("none.gpx", b"<gpx><wpt lat='1' lon='2'/></gpx>")
    page.get_by_text("none.gpx has no line with two points or more.").wait_for()
    panel.get_by_role("button", name="Close").click()
    panel.wait_for(state="detached")
    drop = page.evaluate_handle(
        """(text) => {
          const files = new DataTransfer();
          files.items.add(new File([text], 'dropped.gpx'));
          return files;
        }""",
        gpx(50).decode(),
    )
    page.locator(".maplibregl-map").dispatch_event("drop", {"dataTransfer": drop})
    panel.get_by_text("The line of dropped.gpx.").wait_for()
    panel.get_by_role("figure", name="Heights along the line").wait_for()


def made(web: Web, request: Any) -> None:
    """What a worker does with the export that the page asked for."""
    number = request.json()["id"]
    state = perform(EXPORT, web.context, number, Work(bool, nullcontext))
    assert state == "done"


def test_the_view_as_a_file_with_the_filters_of_the_page(steep: Web, tab_maker: Callable[..., Tab]) -> None:
    tab = tab_maker(viewport=PHONE)
    page = opened(tab, steep, f"{AT}&sigma=0.3&classes=5")
    panel = tool(page, "Export this view")
    panel.get_by_text("filters of the legend by uncertainty and drives are applied").wait_for()
    panel.get_by_text("classes chosen in the legend are not applied").wait_for()
    with page.expect_response(lambda one: one.request.method == "POST" and "/v1/exports" in one.url) as asked:
        panel.get_by_role("button", name="CSV table").click()
    body = asked.value.request.post_data_json
    assert body["most_sigma_percent"] == 0.3
    assert body["bbox"][0] < WEST < body["bbox"][2]
    with page.expect_download() as download:
        made(steep, asked.value)
    rows = download.value.path().read_text(encoding="utf-8").splitlines()
    assert len(rows) == 2  # a header, and the segment that two drives made sure
    link = panel.get_by_role("link", name="Save versant-csv.csv")
    assert re.search(r"/v1/exports/[0-9a-f-]+/file$", link.get_attribute("href") or "")


def test_proposals_of_incline_by_one_click(steep: Web, tab_maker: Callable[..., Tab]) -> None:
    tab = tab_maker(viewport=DESK)
    page = opened(tab, steep, f"{AT}&drives=3")
    with page.expect_response(lambda one: one.request.method == "POST" and "/v1/exports" in one.url) as asked:
        panel = tool(page, "Proposals of incline")
    body = asked.value.request.post_data_json
    assert (body["format"], body["options"]) == ("josm", {"min_drives": 3})
    panel.get_by_text("Open it in JOSM.", exact=False).wait_for()
    link = panel.get_by_role("link", name="Proposals of incline in full").get_attribute("href") or ""
    page_of_guide, part = link.removeprefix("/docs/").split("#")
    guide = guides.guide(page_of_guide)
    assert guide is not None
    assert part.startswith("proposals-of-incline")
    assert part in [heading.id for heading in guide.headings]
    posts: list[str] = []
    page.on("request", lambda one: posts.append(one.url) if one.method == "POST" else None)
    page.reload()
    panel.get_by_role("button", name="File for MapRoulette").wait_for()
    page.wait_for_timeout(300)
    assert posts == []  # a link makes no file


def test_who_shows_no_key_is_told_how_to_get_files(grid_database: str, asking: Web, tab: Tab) -> None:
    opened(tab, asking, f"{AT}&tool=export")
    panel = tab.page.get_by_role("complementary")
    panel.get_by_text("Files are made for whoever has a key.").wait_for()
    assert panel.get_by_role("link", name="Log in").is_visible()
