"""The first minutes of a service without roads: what pages say, what a drive shows, and how that goes away."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from app.drives.batches.touched import queue_touched
from app.roads.imports import import_roads
from browser_fixtures import Tab, drives_computed
from web_fixtures import Web

PHONE = {"width": 390, "height": 844}


@pytest.fixture
def working(web: Web) -> Iterator[None]:
    """A worker beside the service: of drives, and of those that new roads touch."""
    with drives_computed(web, first=lambda: queue_touched(web.sessions)):
        yield


def uploaded(tab: Tab, web: Web, log: bytes) -> None:
    tab.page.goto(f"{web.base}/upload", wait_until="networkidle")
    with tab.page.expect_file_chooser() as chooser:
        tab.page.locator("button.primary").first.click()
    chooser.value.set_files([{"name": "ride.csv", "mimeType": "", "buffer": log}])


@pytest.mark.parametrize("words", ["de"], indirect=True)
def test_a_ride_before_there_are_roads_and_after(
    web: Web,
    tab_maker: Callable[..., Tab],
    files: Path,
    tmp_path: Path,
    working: None,
    words: dict[str, Any],
) -> None:
    said = words["roads"]
    tab = tab_maker(viewport=PHONE, locale=words["locale"])
    page = tab.page
    uploaded(tab, web, (files / "0.csv").read_bytes())
    row = page.locator(".upload-row.roads")
    row.get_by_text(said["waits"]).first.wait_for()
    drive = web.client.get("/v1/drives").json()["drives"][0]
    extract = drive["waits_for"]["extract"]
    assert row.get_by_role("link", name=extract, exact=True).is_visible()
    assert page.get_by_text(said["none"]).is_visible()
    assert page.get_by_text(words["upload"]["overall_roads"]["one"]).first.is_visible()
    assert page.locator(".upload-row .reason").count() == 0
    assert page.get_by_role("button", name=words["upload"]["process_again"]).count() == 0

    there = tab_maker(viewport=PHONE, locale=words["locale"])
    there.page.goto(f"{web.base}/drives/{drive['id']}")
    there.page.get_by_role("heading", name=said["waits"]).wait_for()
    there.page.locator(".track-map canvas").wait_for()
    heights = there.page.get_by_role("figure", name=words["drive"]["chart"]["heights"])
    assert heights.is_visible()
    assert heights.get_by_text(words["drive"]["chart"]["log_height"]).first.is_visible()
    assert there.page.get_by_role("figure", name=words["drive"]["chart"]["grades"]).count() == 0
    assert there.page.locator(".track-legend").count() == 0
    assert there.page.locator(".drive-status.failed, main .error-text").count() == 0
    assert there.page.get_by_role("link", name=extract, exact=True).is_visible()

    listed = tab_maker(viewport=PHONE, locale=words["locale"])
    listed.page.goto(f"{web.base}/drives?waits_for=roads")
    listed.page.locator("tbody .state.roads").wait_for()
    chosen = listed.page.locator(".filters select").evaluate_all("all => all.map((one) => one.value)")
    assert "roads" in chosen

    import_roads(web.sessions, files / "town.osm", tmp_path / "dem")
    row = page.locator(".upload-row.done")
    row.wait_for()
    there.page.get_by_role("figure", name=words["drive"]["chart"]["grades"]).wait_for()
    listed.page.locator("tbody .state.done").wait_for()
    for one in (tab, there, listed):
        one.page.locator(".roads-notice").wait_for(state="detached")
        assert one.page.locator(".state.roads, .upload-row.roads, .waits-for").count() == 0


@pytest.mark.parametrize("words", ["en"], indirect=True)
def test_every_page_says_so_and_leads_to_the_form(
    web: Web,
    tab_maker: Callable[..., Tab],
    files: Path,
    tmp_path: Path,
    words: dict[str, Any],
) -> None:
    said = words["roads"]
    tabs = []
    for name in ("map", "upload", "drives", "admin"):
        tab = tab_maker(locale=words["locale"])
        tab.page.goto(f"{web.base}/{name}")
        place = tab.page.locator(".nothing" if name == "map" else ".roads-notice")
        link = place.get_by_role("link", name=said["import"])
        link.wait_for()
        tabs.append(tab)
    page = tabs[1].page
    page.get_by_role("link", name=said["import"]).click()
    page.wait_for_url("**/admin#import")
    form = page.locator("form.import").first
    form.locator("input[type=file]").wait_for()
    assert form.locator("input[type=file]").is_visible()
    import_roads(web.sessions, files / "town.osm", tmp_path / "dem")
    tabs[0].page.locator(".maplibregl-canvas").wait_for()
    for tab in tabs:
        tab.page.locator(".roads-notice, .nothing.card h1").wait_for(state="detached")


def test_who_may_not_import_is_told_whom_to_ask(
    asking: Web, tab: Tab, key_maker: Callable[..., str], enter: Callable[[Tab, str], None]
) -> None:
    enter(tab, key_maker("mine", "own", "anna"))
    tab.page.goto(f"{asking.base}/upload")
    notice = tab.page.locator(".roads-notice")
    notice.get_by_text("Ask whoever runs this service").wait_for()
    assert notice.get_by_role("link").count() == 0
    tab.page.goto(f"{asking.base}/map")
    tab.page.locator(".nothing").get_by_text("Ask whoever runs this service").wait_for()


def test_the_dashboard_counts_what_waits_apart(web: Web, tab: Tab, files: Path, working: None) -> None:
    web.client.post("/v1/drives?method=raw", content=(files / "0.csv").read_bytes())
    tab.page.goto(f"{web.base}/admin")
    row = tab.page.locator(".attention li", has_text="Drives that wait for roads")
    row.wait_for()
    row.get_by_role("link", name="Import roads").click()
    tab.page.wait_for_url(re.compile("#import$"))
    assert tab.page.locator("#failures").get_by_text("No drive failed.").is_visible()
    cell = tab.page.locator("#throughput tr", has_text="Waits for roads").get_by_role("link")
    assert "waits_for=roads" in str(cell.first.get_attribute("href"))


def test_what_is_no_log_is_not_computed_again(web: Web, tab: Tab, working: None) -> None:
    uploaded(tab, web, b"time_s,lat_deg,lon_deg\n1,49,8.4\n")
    row = tab.page.locator(".upload-row.failed, .upload-row.refused, .upload-row.roads")
    row.wait_for()
    drives = web.client.get("/v1/drives").json()["drives"]
    assert [one["failure"]["kind"] for one in drives] == ["empty-log"]
    assert row.get_by_role("button", name="Compute ride.csv again").count() == 0
    assert row.get_by_role("button", name="Try ride.csv again").count() == 0
