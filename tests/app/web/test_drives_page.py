"""The list of drives as people use it: search, order, pages, what runs, and what is done with several."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest
from sqlalchemy import text

from app.drives import claims
from browser_fixtures import Tab
from many_drives import execute, make_drives
from processing_support import HEADER
from web_fixtures import Web

MANY = 60


def names(tab: Tab) -> list[str]:
    tab.page.wait_for_selector("table:not([aria-busy=true])")
    return [str(one) for one in tab.page.locator("tbody th").all_text_contents()]


def opened(tab: Tab, web: Web, path: str = "/drives") -> Tab:
    tab.page.goto(f"{web.base}{path}", wait_until="networkidle")
    return tab


@pytest.fixture
def many(web: Web) -> Web:
    make_drives(web.sessions, MANY)
    execute(web.sessions, "UPDATE drives SET distance_m = 100 * CAST(substr(filename, 5) AS integer)")
    return web


def test_search_order_and_pages_live_in_the_address(many: Web, tab: Tab) -> None:
    opened(tab, many)
    newest = [f"log {k}" for k in range(MANY - 1, -1, -1)]
    assert names(tab) == newest[:50]
    tab.page.get_by_role("link", name="Next").click()
    tab.page.wait_for_url(re.compile("after="))
    tab.page.get_by_role("link", name="log 0", exact=True).wait_for()
    assert names(tab) == newest[50:]
    tab.page.reload(wait_until="networkidle")
    assert names(tab) == newest[50:]
    tab.page.get_by_role("link", name="Previous").click()
    tab.page.get_by_role("link", name="log 59", exact=True).wait_for()
    assert names(tab) == newest[:50]
    tab.page.get_by_role("button", name="Length").click()
    tab.page.wait_for_url(re.compile("sort=distance_m"))
    tab.page.get_by_role("button", name="Length").click()
    tab.page.wait_for_url(re.compile("order=asc"))
    tab.page.get_by_role("link", name="log 0", exact=True).wait_for()
    assert names(tab) == newest[::-1][:50]
    assert tab.page.get_by_role("columnheader", name="Length").get_attribute("aria-sort") == "ascending"
    tab.page.get_by_label("Search by file name or id").fill("log 5")
    tab.page.wait_for_url(re.compile("q=log"))
    tab.page.get_by_role("link", name="log 40", exact=True).wait_for(state="detached")
    assert names(tab) == ["log 5", *[f"log {k}" for k in range(50, 60)]]
    tab.page.get_by_label("Search by file name or id").fill("nothing like it")
    tab.page.get_by_text("No drive is like that.").wait_for()
    tab.page.go_back()
    tab.page.get_by_role("link", name="log 0", exact=True).wait_for()


def test_links_from_elsewhere(many: Web, tab: Tab) -> None:
    opened(tab, many, "/drives?status=failed&failure=no-match")
    assert names(tab) == [f"log {k}" for k in range(59, -1, -4)]
    assert tab.page.get_by_label("Reason").input_value() == "no-match"
    tab.page.get_by_text("Why, and what to do").first.click()
    assert tab.page.get_by_text("No road.").first.is_visible()
    tab.page.get_by_label("Uploaded from").fill("2026-02-01")
    tab.page.get_by_role("link", name="log 3", exact=True).wait_for(state="detached")
    tab.page.get_by_label("to", exact=True).fill("2026-02-08")
    tab.page.get_by_role("link", name="log 59", exact=True).wait_for(state="detached")
    assert names(tab) == ["log 35", "log 31"]


def test_two_are_compared_and_several_computed_again_and_deleted_by_keyboard(many: Web, tab: Tab) -> None:
    opened(tab, many, "/drives?q=log+4&sort=filename")
    keys = tab.page.keyboard
    for name in ("log 40", "log 41"):
        tab.page.get_by_label(f"Choose {name}").focus()
        keys.press("Space")
    address = tab.page.get_by_role("link", name="Compare both").get_attribute("href")
    ids = re.fullmatch(r"/drives/([0-9a-f-]{36})\?with=([0-9a-f-]{36})", address or "")
    assert ids
    chosen = [many.client.get(f"/v1/drives/{one}").json()["filename"] for one in ids.groups()]
    assert chosen == ["log 40", "log 41"]
    tab.page.get_by_role("button", name="Compute again").focus()
    keys.press("Enter")
    tab.page.get_by_role("dialog").get_by_role("button", name="Compute again").press("Enter")
    tab.page.get_by_text("2 drives wait to be computed again.").wait_for()
    tab.page.get_by_role("cell", name="Waits").nth(1).wait_for()
    tab.page.get_by_label("Choose all on this page").check()
    tab.page.get_by_role("button", name="Delete").press("Enter")
    asked = tab.page.get_by_role("dialog")
    assert "Together 44.9 km" in asked.inner_text()
    keys.press("Escape")
    before = len(many.client.get("/v1/drives").json()["drives"])
    tab.page.get_by_role("button", name="Delete").press("Enter")
    asked.get_by_role("button", name="Delete").press("Enter")
    tab.page.get_by_text("11 drives are being removed.").wait_for()
    assert len(many.client.get("/v1/drives").json()["drives"]) == before - 11


def test_what_runs_is_shown_as_it_goes_on(web: Web, tab_maker: Callable[..., Tab]) -> None:
    tab = tab_maker(viewport={"width": 390, "height": 844})
    web.client.post("/v1/drives?filename=monday.csv", content=HEADER + b"1,49,8\n")
    opened(tab, web)
    tab.page.locator("tbody").get_by_text("Waits").wait_for()
    assert tab.faults() == []

    def change(act: Callable[[Any, Any], None]) -> None:
        with web.sessions.begin() as session:
            act(session, session.execute(text("SELECT id FROM drives")).scalar_one())

    change(lambda session, drive: claims.mark_running(session, drive, 1))
    change(lambda session, drive: claims.set_progress(session, drive, 1, "match", 0.4))
    tab.page.get_by_text("Matching it to the roads").wait_for()
    assert (
        tab.page.get_by_role("progressbar", name="Computation of monday.csv").evaluate("e => e.value") == 0.4
    )
    change(
        lambda session, drive: claims.mark_failed(
            session, drive, 1, kind="no-match", reason="<b>Nothing</b> near.", stage="match"
        )
    )
    tab.page.locator("tbody").get_by_text("No road near").wait_for()
    tab.page.get_by_text("Why, and what to do").click()
    assert tab.page.get_by_text("<b>Nothing</b> near.").is_visible()


def test_what_goes_wrong_is_said(web: Web, tab: Tab) -> None:
    tab.expected.append("422")
    opened(tab, web, "/drives?after=nonsense&colour=red")
    assert "no place in the list" in tab.page.get_by_role("alert").inner_text()
    tab.page.get_by_role("alert").get_by_role("link", name="All drives").click()
    tab.page.get_by_text("There are no drives yet.").wait_for()
    assert tab.faults() == []
