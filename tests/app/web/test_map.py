"""The map as its users meet it: what it draws, filters, selects, and what its address says."""

from __future__ import annotations

import re
import time
import uuid
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import pytest

from app.exports.run import EXPORT
from app.jobs.requests.run import perform
from app.jobs.task import Work
from app.map.derived.following import follow_all
from browser_fixtures import PATIENCE_MS, Tab
from web_fixtures import SOUTH, STEP, WEST, Web

Drive = Callable[..., uuid.UUID]
DRAWN = """() => {
  const map = window.versantMap;
  const layers = map.getLayersOrder().filter((id) => id.startsWith('slope-') || id.startsWith('unknown-'));
  return [...new Set(map.queryRenderedFeatures({ layers }).map((one) => one.id))].sort((a, b) => a - b);
}"""
AT = f"at=14.00/{SOUTH + 3.5 * STEP}/{WEST + 3.5 * STEP}"
"""Over the whole grid, near enough for single segments."""


def opened(tab: Tab, address: str) -> None:
    """Open the map and wait until it has come to rest with everything counted."""
    tab.page.goto(address)
    rest(tab)


def wait(tab: Tab, expression: str, arg: Any = None) -> None:
    """Until it is true; Playwright's own waiting would need what the pages' policy forbids."""
    ends = time.monotonic() + PATIENCE_MS / 1000
    while not tab.page.evaluate(expression, arg):
        assert time.monotonic() < ends, expression
        tab.page.wait_for_timeout(30)


def rest(tab: Tab) -> None:
    wait(tab, "Boolean(window.versantMap?.loaded() && !window.versantMap.isMoving())")
    tab.page.wait_for_selector(".total", state="attached")


def drawn(tab: Tab) -> list[int]:
    found: list[int] = tab.page.evaluate(DRAWN)
    return found


def total(tab: Tab, text: str) -> None:
    tab.page.get_by_text(text, exact=True).wait_for()


@pytest.fixture
def driven(filled: Web, drive_maker: Drive) -> Web:
    """The grid with flat and steep streets, one of them driven twice."""
    drive_maker(filled.sessions, [0, 1, 2], 0.5, 0.2)
    drive_maker(filled.sessions, [7, 8, 9, 10], 5.0, 1.2)
    drive_maker(filled.sessions, [7], 5.0, 1.2)
    return filled


def test_legend_and_sliders_filter_and_the_address_keeps_it(
    driven: Web, tab_maker: Callable[..., Tab]
) -> None:
    tab = tab_maker(viewport={"width": 1280, "height": 800})
    opened(tab, f"{driven.base}/map?{AT}")
    total(tab, "112 of 112 segments in view")
    every = drawn(tab)
    assert len(every) == 112
    page = tab.page
    steep = page.get_by_role("button", name=re.compile(r"4 to 6 %\s*4\s*in view"))
    steep.click()
    total(tab, "4 of 112 segments in view")
    assert steep.get_attribute("aria-pressed") == "true"
    wait(tab, f"({DRAWN})().length === 4")
    sigma = page.get_by_role("slider", name="Uncertainty at most")
    sigma.fill("5")
    total(tab, "1 of 112 segments in view")
    drives = page.get_by_role("slider", name="Drives at least")
    drives.fill("2")
    assert drives.get_attribute("aria-valuetext") == "2"
    total(tab, "1 of 112 segments in view")
    wait(tab, f"({DRAWN})().length === 1")
    said = page.url
    assert all(one in said for one in ("classes=4", "sigma=1", "drives=2"))
    twice = drawn(tab)

    other = tab_maker(viewport={"width": 1280, "height": 800})
    opened(other, said)
    total(other, "1 of 112 segments in view")
    wait(other, f"({DRAWN})().length === 1")
    assert drawn(other) == twice
    page.go_back()
    wait(tab, "!location.search.includes('drives')")
    page.get_by_role("button", name="Show everything").click()
    total(tab, "112 of 112 segments in view")
    page.get_by_role("button", name="Unknown").click()
    total(tab, "105 of 112 segments in view")


def test_modes_and_ways(driven: Web, tab: Tab) -> None:
    opened(tab, f"{driven.base}/map?{AT}")
    choice = tab.page.get_by_label("Colours show")
    for colour, known in (("elevation-model", 84), ("difference", 5), ("steepness", 7)):
        choice.select_option(colour)
        wait(
            tab,
            "(known) => window.versantMap.loaded() && window.versantMap.queryRenderedFeatures({layers: "
            "window.versantMap.getLayersOrder().filter((id) => id.startsWith('slope-'))}).length >= known",
            known,
        )
        rest(tab)
        assert ("colour=" in tab.page.url) == (colour != "steepness")
    tab.page.get_by_label("ways").check()
    assert choice.locator("option[value=difference]").is_disabled()
    tab.page.wait_for_url("**layer=ways**")
    wait(tab, "window.versantMap.getLayer('slope-minor')?.sourceLayer === 'ways'")


def test_click_and_enter_select_the_segment(driven: Web, tab: Tab) -> None:
    opened(tab, f"{driven.base}/map?{AT}")
    page = tab.page
    place: dict[str, Any] = page.evaluate(
        "(at) => window.versantMap.project(at)", [WEST + 0.5 * STEP, SOUTH + STEP]
    )
    frame = page.locator("canvas").bounding_box()
    assert frame is not None
    page.mouse.move(frame["x"] + place["x"], frame["y"] + place["y"] + 3)
    wait(tab, "window.versantMap.getCanvas().style.cursor === 'pointer'")
    page.mouse.click(frame["x"] + place["x"], frame["y"] + place["y"] + 3)
    page.wait_for_url("**segment=*")
    number = int(page.url.split("segment=")[1].split("&")[0])
    segment = driven.client.get(f"/v1/segments/{number}").json()
    assert segment["properties"]["slope_percent"] is not None or segment["id"] == number
    wait(tab, "window.versantMap.queryRenderedFeatures({layers: ['selected']}).length > 0")

    page.locator("canvas").focus()
    page.keyboard.press("Escape")
    wait(tab, "!location.search.includes('segment')")
    before = page.evaluate("window.versantMap.getCenter().lng")
    page.keyboard.press("ArrowRight")
    wait(tab, "(before) => window.versantMap.getCenter().lng > before", before)
    wait(tab, "!window.versantMap.isMoving()")
    page.evaluate("(at) => window.versantMap.jumpTo({center: at})", [WEST + 1.5 * STEP, SOUTH + 2 * STEP])
    wait(tab, "window.versantMap.loaded()")
    page.keyboard.press("Enter")
    page.wait_for_url("**segment=*")


def test_a_published_drive_appears_by_itself(filled: Web, drive_maker: Drive, tab: Tab) -> None:
    opened(tab, f"{filled.base}/map?{AT}")
    total(tab, "112 of 112 segments in view")
    tab.page.get_by_text("No road here has been measured yet.").wait_for()
    tab.page.wait_for_timeout(300)
    drive_maker(filled.sessions, [0, 1, 2], 7.0)
    began = time.monotonic()
    measured = (
        "window.versantMap.queryRenderedFeatures({layers: window.versantMap.getLayersOrder()"
        ".filter((id) => id.startsWith('slope-'))}).length >= 3"
    )
    wait(tab, measured)
    assert time.monotonic() - began < 3
    tab.page.get_by_role("button", name=re.compile(r"6 to 8 %\s*3\s*in view")).wait_for()


def exported(web: Web, kind: str = "pmtiles") -> str:
    """An export of the map as it is, done."""
    number = str(web.client.post("/v1/exports", json={"format": kind}).json()["id"])
    assert perform(EXPORT, web.context, uuid.UUID(number), Work(bool, nullcontext)) == "done"
    return number


def test_a_kept_map_in_place_of_today_s(driven: Web, drive_maker: Drive, tab: Tab) -> None:
    number = exported(driven)
    drive_maker(driven.sessions, [30, 31], 5.0, 0.5)
    opened(tab, f"{driven.base}/map?{AT}")
    page = tab.page
    page.get_by_role("button", name=re.compile(r"4 to 6 %\s*6\s*in view")).wait_for()
    choice = page.get_by_role("combobox", name=re.compile("^Map of"))
    choice.select_option(index=1)
    page.wait_for_url(f"**export={number}**")
    page.get_by_text("The map as it was on").wait_for()
    rest(tab)
    page.get_by_role("button", name=re.compile(r"4 to 6 %\s*4\s*in view")).click()
    total(tab, "4 of 112 segments in view")
    wait(tab, f"({DRAWN})().length === 4")
    assert f"export={number}" in page.url
    assert page.get_by_label("ways").is_disabled()
    drive_maker(driven.sessions, [33], 5.0, 0.5)
    total(tab, "4 of 112 segments in view")
    page.get_by_role("link", name="Today's map").click()
    total(tab, "7 of 112 segments in view")
    assert "export" not in page.url


def test_a_way_is_told_on_a_kept_map_and_segments_stay_drawn(driven: Web, tab: Tab) -> None:
    follow_all(driven.sessions)
    opened(tab, f"{driven.base}/map?{AT}&export={exported(driven)}&layer=ways")
    page = tab.page
    assert page.get_by_role("radio", name="segments").is_checked()
    field = page.get_by_role("combobox", name="Search the map")
    field.fill("way 3")
    field.press("Enter")
    page.get_by_text(re.compile("^Way 3 · ")).wait_for()
    assert page.get_by_role("radio", name="segments").is_checked()
    wait(tab, f"({DRAWN})().length > 0")


def test_what_is_no_kept_map_is_told_and_today_s_is_shown(driven: Web, tab: Tab) -> None:
    opened(tab, f"{driven.base}/map?{AT}&export={exported(driven, 'csv')}")
    tab.page.get_by_text(re.compile(r"^[\w.-]+\.csv is no map that can be shown")).wait_for()
    total(tab, "112 of 112 segments in view")
    assert "export" not in tab.page.url
    tab.expected.append("404")
    opened(tab, f"{driven.base}/map?{AT}&export={uuid.uuid4()}")
    tab.page.get_by_text("There is no export").first.wait_for()
    total(tab, "112 of 112 segments in view")


def test_from_too_far_it_says_so_and_leads_nearer(driven: Web, tab: Tab) -> None:
    opened(tab, f"{driven.base}/map?{AT.replace('14.00', '4.00')}")
    tab.page.get_by_text("Roads are drawn from nearer.").wait_for()
    assert drawn(tab) == []
    tab.page.locator(".hint").get_by_role("button").click()
    tab.page.get_by_text("Roads are drawn from nearer.").wait_for(state="detached")
    wait(tab, "window.versantMap.getZoom() >= 6")
