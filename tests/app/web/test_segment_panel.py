"""What a click on the map opens, and the map's search, as people use them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from typing import Any

import pytest

from app.map.derived.following import follow_all
from app.network import extracts as roads
from browser_fixtures import Tab
from network_support import drive_over, new_drive, pass_over, publish
from page_states.map_states import SEEN
from web_fixtures import SOUTH, WEST, Web

ENTER_AT_ONCE = """async (field, text) => {
  field.value = text;
  field.dispatchEvent(new InputEvent('input', { bubbles: true }));
  await Promise.resolve();
  field.dispatchEvent(new KeyboardEvent('keydown', { key: 'Enter', bubbles: true }));
}"""
"""Text and Enter with no paint between, as where the browser is busy."""
FIRST = 56  # row of the grid at which the southernmost street, 146 m a segment, begins


@pytest.fixture
def street(filled: Web) -> list[int]:
    """Ids of a street's segments; 0, 1 and 3 were driven, 0 by three drives, one of which contradicts."""
    with filled.sessions() as session:
        table, ids = roads.all_roads(session)
    for slope in (2.0, 2.1):
        drive_over(filled.sessions, table, ids, dict.fromkeys((FIRST, FIRST + 1, FIRST + 3), (slope, 0.4)))
    odd = new_drive(filled.sessions)
    publish(filled.sessions, odd, ids, [pass_over(table, FIRST, 9.0, 0.3)])
    follow_all(filled.sessions)
    return [int(i) for i in ids[FIRST : FIRST + 7]]


def search(tab: Tab, web: Web, written: str) -> Any:
    """Look for it on the map; the field."""
    if not tab.page.url.startswith(f"{web.base}/map"):
        tab.page.goto(f"{web.base}/map")
    field = tab.page.get_by_role("combobox", name="Search the map")
    field.fill(written)
    return field


def opened(tab: Tab, web: Web, segment: int) -> Any:
    """The panel of a segment, by keyboard alone."""
    field = search(tab, web, f"segment {segment}")
    field.press("Enter")  # before anything is found: it goes there when it is
    panel = tab.page.get_by_role("complementary", name=f"Segment {segment}")
    panel.get_by_role("heading", level=2).wait_for()
    return panel


def test_a_segment_is_told_whole(filled: Web, street: list[int], tab: Tab) -> None:
    panel = opened(tab, filled, street[0])
    panel.get_by_text(re.compile(r"^Rises 2\.\d %\s±\s0\.\d from A to B, towards the ")).wait_for()
    rows = panel.get_by_role("region", name="The drives behind it").get_by_role("row")
    rows.nth(3).wait_for()
    assert rows.count() == 4
    assert panel.get_by_role("cell", name="rejected", exact=True).count() == 1
    assert panel.get_by_role("cell", name="accepted", exact=True).count() == 2
    shares = panel.get_by_role("cell", name=re.compile(r"^\d+ %$")).all_inner_texts()
    assert sorted(shares) == ["0 %", "50 %", "50 %"]
    (behind, *_) = panel.get_by_role("rowheader").get_by_role("link").all()
    assert re.search(r"/drives/[0-9a-f-]{36}$", behind.get_attribute("href") or "")
    profile = panel.get_by_role("slider", name="Read off: Heights from A to B")
    profile.press("ArrowRight")
    read = profile.get_attribute("aria-valuetext") or ""
    assert re.fullmatch(
        r"\d+\.\d m; measured -?[\d,]+\.\d m", read
    )  # these drives know next to nothing of heights
    panel.get_by_text("their band is not drawn", exact=False).wait_for()
    history = panel.get_by_role("figure", name="How the slope came together")
    assert history.get_by_role("button", name="drive, rejected").is_visible()


def test_two_dates_of_a_street(filled: Web, street: list[int], tab: Tab) -> None:
    panel = opened(tab, filled, street[0])
    first, second = panel.get_by_label("One date"), panel.get_by_label("The other date")
    first.wait_for()
    (odd,) = [one for one in first.get_by_role("option").all() if "(rejected)" in (one.text_content() or "")]
    others = [
        one for one in first.get_by_role("option").all() if "(rejected)" not in (one.text_content() or "")
    ]
    ids = [one.get_attribute("value") for one in (odd, *others)]
    first.select_option(ids[1])
    second.select_option(ids[2])
    said = panel.get_by_role("region", name="Compare two dates").get_by_role("status")
    said.get_by_text(
        re.compile(r"changes by [+−]?0\.\d ± 0\.\d %\. That is 0\.\d sigma; up to 1\.96")
    ).wait_for()
    assert f"dates={ids[1]},{ids[2]}" in tab.page.url
    second.select_option(ids[0])
    said.get_by_text(
        re.compile(r"changes by [+−]\d\.\d ± 0\.\d %\. That is 1\d\.\d sigma, more than")
    ).wait_for()
    tab.page.go_back()
    said.get_by_text("it may be chance").wait_for()
    tab.page.reload()
    said.get_by_text("it may be chance").wait_for()
    second.select_option(ids[1])
    said.get_by_text("Choose two different dates.").wait_for()
    tab.page.get_by_role("button", name="Close").click()
    tab.await_true("!location.search.includes('dates')")


def test_unknown_is_said_in_words(filled: Web, street: list[int], tab: Tab) -> None:
    gap = opened(tab, filled, street[2])
    gap.get_by_text("The slope follows from the roads on both sides.").wait_for()
    gap.get_by_text("Drives", exact=True).wait_for()
    assert gap.get_by_role("table").count() == 0
    unknown = opened(tab, filled, street[5])
    unknown.get_by_text("Slope unknown").wait_for()
    unknown.get_by_text("Unknown is not flat.", exact=False).wait_for()
    assert not re.search(r"\b0(\.0)? (%|m)", unknown.inner_text())
    assert tab.faults() == []


def test_focus_comes_into_the_panel_and_goes_back(filled: Web, street: list[int], tab: Tab) -> None:
    panel = opened(tab, filled, street[0])
    assert panel.evaluate("panel => panel === document.activeElement")
    tab.page.keyboard.press("Escape")
    panel.wait_for(state="detached")
    field = tab.page.get_by_role("combobox", name="Search the map")
    assert field.evaluate("field => field === document.activeElement")


def test_copied_as_json(filled: Web, street: list[int], tab: Tab) -> None:
    panel = opened(tab, filled, street[1])
    tab.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    panel.get_by_role("slider").first.wait_for()
    panel.get_by_role("button", name="Copy as JSON").click()
    tab.page.get_by_text("Copied as JSON.").wait_for()
    copied = json.loads(tab.page.evaluate("navigator.clipboard.readText()"))
    assert copied["segment"]["id"] == copied["profile"]["segment_id"] == street[1]
    assert copied["segment"]["properties"]["drives"] == 2


def test_a_way_and_its_segments_on_a_phone(
    filled: Web, street: list[int], tab_maker: Callable[..., Tab]
) -> None:
    tab = tab_maker(viewport={"width": 390, "height": 844}, has_touch=True)
    opened(tab, filled, street[0]).get_by_role("button", name="The whole way").click()
    way = tab.page.get_by_role("complementary", name=re.compile("^Way "))
    way.get_by_text("Measured share").wait_for()
    way.get_by_text("7 segments of 7.").wait_for()
    assert way.get_by_role("listitem").filter(has_text="unknown").count() >= 1
    assert tab.faults() == []
    assert tab.page.evaluate("document.documentElement.scrollWidth") <= 390
    third = way.get_by_role("button", name=f"Segment {street[3]} ")
    third.focus()
    tab.page.locator(".pointed").wait_for()  # on the map
    third.click()
    tab.page.get_by_role("complementary", name=f"Segment {street[3]}").wait_for()


def test_on_a_phone_a_chosen_segment_is_seen_above_its_sheet(
    filled: Web, street: list[int], tab_maker: Callable[..., Tab]
) -> None:
    """Chosen by a tap low on the map, by a link and by the search, with the map's credit beside it."""
    tab = tab_maker(viewport={"width": 390, "height": 844}, has_touch=True)
    at = f"at=15.50/{SOUTH + 0.002:.5f}/{WEST + 0.001:.5f}"
    tab.page.goto(f"{filled.base}/map?{at}")
    tab.await_true("Boolean(window.versantMap?.loaded())")
    place = tab.page.evaluate("(at) => window.versantMap.project(at)", [WEST + 0.001, SOUTH])
    frame = tab.page.locator("canvas").bounding_box()
    assert frame is not None
    tab.page.touchscreen.tap(frame["x"] + place["x"], frame["y"] + place["y"])
    panel = tab.page.get_by_role("complementary", name=f"Segment {street[0]}")
    panel.get_by_text("Steepest 20 m").wait_for()
    tab.await_true(SEEN)
    tab.page.goto(f"{filled.base}/map?segment={street[0]}")
    tab.await_true(SEEN)
    opened(tab, filled, street[3])
    tab.await_true(SEEN)


def test_a_segment_that_is_there_before_the_map_is_seen_when_the_map_is(
    filled: Web, street: list[int], tab_maker: Callable[..., Tab]
) -> None:
    tab = tab_maker(viewport={"width": 390, "height": 844})
    held: list[Any] = []

    def hold(route: Any) -> None:
        held.append(route)

    tab.page.route("**/canvas*.js", hold)
    at = f"at=15.50/{SOUTH + 0.002:.5f}/{WEST + 0.001:.5f}"
    tab.page.goto(f"{filled.base}/map?{at}&segment={street[0]}", wait_until="commit")
    tab.page.locator("aside.panel .facts").first.wait_for()
    (route,) = held
    route.continue_()
    tab.await_true(SEEN)


def test_enter_is_of_the_text_that_stands_there(filled: Web, street: list[int], tab: Tab) -> None:
    """Also where what was found for the text before is still listed."""
    field = search(tab, filled, f"segment {street[1]}")
    tab.page.get_by_role("option", name=f"Segment {street[1]}").wait_for()
    field.evaluate(ENTER_AT_ONCE, f"segment {street[0]}")
    tab.page.get_by_role("complementary", name=f"Segment {street[0]}").wait_for()


def test_what_search_finds(filled: Web, street: list[int], tab: Tab) -> None:
    """Each of the forms that people write, as a list that is chosen from by keyboard."""
    for written, label in (
        ("49.0, 8.41", "49.00000°, 8.41000°"),
        ("49° 0' N 8° 24.6' E", "49.00000°, 8.41000°"),
        ("https://www.openstreetmap.org/way/9", "Way 9"),
        ("9", "Segment 9"),
        ("straße 3", "Straße 30"),
        ("Straße 30", "Straße 30"),
    ):
        search(tab, filled, "")
        tab.page.get_by_role("listbox").wait_for(state="hidden")
        field = search(tab, filled, written)
        tab.page.get_by_role("option").filter(has_text=label).first.wait_for()
        field.press("ArrowDown")
        chosen = tab.page.locator(f"[id='{field.get_attribute('aria-activedescendant')}']")
        assert chosen.get_attribute("aria-selected") == "true"
    assert tab.faults() == []
    field.press("Escape")
    assert field.get_attribute("aria-expanded") == "false"


def test_why_search_finds_nothing(filled: Web, tab: Tab) -> None:
    tab.expected.append("404 (Not Found)")  # of the segment that is not there
    for written, said in (
        ("segment 99999", "There is no segment 99999."),
        ("way 99999", "There is no way 99999 here."),
        ("95, 200", "These are no coordinates."),
        ("<b>x</b>", "No road is called “<b>x</b>”"),
    ):
        search(tab, filled, written)
        tab.page.get_by_text(said, exact=False).wait_for()
        assert tab.page.get_by_role("listbox").get_by_role("option").count() == 0
    tab.page.get_by_role("button", name="Go to where I am").click()
    tab.page.get_by_text("The browser was not allowed to say where you are.", exact=False).wait_for()
