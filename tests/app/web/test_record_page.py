"""The page that records in a phone's browser: kept through a reload, sent, on the map; what it says where it fails."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import expect

from app.roads.imports import import_roads
from browser_fixtures import Tab
from fusion.formats import read_log
from page_states.logs import rows_of
from phone_browser import BEGAN_S, COUNTED, Phone
from web_fixtures import Web

PHONE = {"width": 390, "height": 844}
FIRST, ALL = 15, 50


@pytest.fixture
def phone(tab_maker: Callable[..., Tab]) -> Phone:
    return Phone(tab_maker(viewport=PHONE))


@pytest.fixture
def rows(files: Path) -> list[dict[str, str]]:
    """A drive along the roads of the town, a position a second."""
    return rows_of((files / "0.csv").read_bytes())[8 : 8 + ALL]


def started(phone: Phone, web: Web, rows: list[dict[str, str]]) -> None:
    phone.stand(rows[0])
    phone.tab.page.goto(f"{web.base}/record", wait_until="networkidle")
    phone.tab.page.get_by_role("button", name="Start recording").click()
    phone.tab.await_true(f"{COUNTED} > 0")
    phone.drive(rows[1:])


def stopped(phone: Phone) -> None:
    phone.tab.page.get_by_role("button", name="Stop").click()
    phone.tab.page.get_by_role("button", name="Send the recording").wait_for()


def test_a_drive_is_recorded_through_a_reload_sent_and_on_the_map(
    web: Web, phone: Phone, rows: list[dict[str, str]], files: Path, computing: None, tmp_path: Path
) -> None:
    import_roads(web.sessions, files / "town.osm", tmp_path / "dem")
    page = phone.tab.page
    started(phone, web, rows[:FIRST])
    page.get_by_role("heading", name="Recording").wait_for()
    figures = page.locator(".figures")
    expect(figures).to_contain_text("± 3 m")
    expect(figures).to_contain_text("deliver")
    for _ in range(5):
        phone.second()  # a chunk is kept every five
    n = phone.counted
    page.on("dialog", lambda dialog: dialog.accept())
    page.reload(wait_until="networkidle")

    expect(page.locator(".recordings")).to_contain_text(f"{n} positions")
    page.get_by_role("button", name="Go on with the recording").click()
    phone.tab.await_true(f"{COUNTED} > {n}")
    phone.drive(rows[FIRST:])
    n = phone.counted
    stopped(phone)
    expect(page.locator(".recordings")).to_contain_text(f"{n} positions")
    assert phone.tab.faults() == []

    page.get_by_role("button", name="Send the recording").click()
    page.get_by_text("It was deleted from this device.").wait_for()
    done = page.locator(".upload-row")
    done.get_by_text("Done:").wait_for()
    assert page.locator(".recordings").count() == 0
    [drive] = web.client.get("/v1/drives").json()["drives"]
    assert done.get_by_role("link", name="Open the drive").get_attribute("href") == f"/drives/{drive['id']}"
    page.reload(wait_until="networkidle")
    done.get_by_text("Done:").wait_for()
    assert page.locator(".recordings").count() == 0

    log = read_log(web.client.get(f"/v1/drives/{drive['id']}/log").content)
    assert log.source_format == "sensor-logger"
    assert len(log.fix) == n
    assert np.isfinite(log.fix.height_ell_m).all()
    assert log.fix.time_s[0] == pytest.approx(BEGAN_S, abs=60)
    segments = web.client.get(f"/v1/drives/{drive['id']}/segments").json()["features"]
    slopes = [one["properties"]["slope_percent"] for one in segments]
    assert len(slopes) > 3
    assert all(slope is not None for slope in slopes)
    link = done.get_by_role("link", name="on the map").get_attribute("href") or ""
    assert link.startswith("/map?bbox=7.85")
    for one in segments:
        on_map = web.client.get(f"/v1/segments/{one['id']}").json()["properties"]
        assert on_map["slope_percent"] == pytest.approx(one["properties"]["slope_percent"], abs=0.01)


def test_what_no_answer_came_for_is_kept_and_sent_again_as_the_same_drive(
    web: Web, phone: Phone, rows: list[dict[str, str]]
) -> None:
    page = phone.tab.page
    started(phone, web, rows[:5])
    stopped(phone)
    with page.expect_download() as downloads:
        page.get_by_role("button", name="Download the recording").click()
    name = downloads.value.suggested_filename
    assert name.startswith("versant-2023-11-14T22-13-")
    downloaded = Path(downloads.value.path()).read_bytes()
    with zipfile.ZipFile(io.BytesIO(downloaded)) as archive:
        assert archive.namelist() == ["Location.csv", "TotalAcceleration.csv", "Gyroscope.csv"]

    phone.tab.expected.append("ERR_")
    page.context.set_offline(True)
    page.get_by_role("button", name="Send the recording").click()
    page.get_by_text("The transfer broke off.").wait_for()
    page.context.set_offline(False)
    assert web.client.get("/v1/drives").json()["drives"] == []

    # The service stores it, and its answer is lost on the way.
    def lose(route: Any) -> None:
        route.fetch()
        route.abort()

    page.route("**/v1/drives?*", lose)
    with page.expect_event("requestfailed"):
        page.get_by_role("button", name="Send the recording").click()
    page.get_by_text("The transfer broke off.").wait_for()
    page.unroute("**/v1/drives?*")
    [drive] = web.client.get("/v1/drives").json()["drives"]
    page.get_by_text("It was sent before").wait_for()
    assert page.get_by_role("button", name="Go on with the recording").count() == 0

    page.reload(wait_until="networkidle")
    page.get_by_role("button", name="Send the recording").click()
    page.get_by_text("Already uploaded").wait_for()
    page.get_by_text("It was deleted from this device.").wait_for()
    assert [one["id"] for one in web.client.get("/v1/drives").json()["drives"]] == [drive["id"]]
    assert web.client.get(f"/v1/drives/{drive['id']}/log").content == downloaded


_SIGHT = """(hidden) => {
  Object.defineProperty(document, 'hidden', {get: () => hidden, configurable: true});
  document.dispatchEvent(new Event('visibilitychange'));
}"""
_LOCKS = """
  window.locks = [];
  navigator.wakeLock.request = async () => {
    window.locks.push(Object.assign(new EventTarget(), {released: false, release: async () => {}}));
    return window.locks.at(-1);
  };
"""
_LET_GO = "Object.assign(locks.at(-1), {released: true}).dispatchEvent(new Event('release'))"


def test_a_page_out_of_sight_says_what_it_missed_and_asks_for_the_screen_again(
    web: Web, phone: Phone, rows: list[dict[str, str]]
) -> None:
    page = phone.tab.page
    page.add_init_script(_LOCKS)
    started(phone, web, rows[:3])
    figures = page.locator(".figures")
    expect(figures).to_contain_text("stays on")
    page.evaluate(_SIGHT, True)
    page.evaluate(_LET_GO)
    expect(figures).to_contain_text("may go off")
    page.clock.run_for(20_000)
    page.evaluate(_SIGHT, False)
    page.get_by_text("The page was not in front for 0:00:2").wait_for()
    expect(figures).to_contain_text("stays on")
    assert page.evaluate("locks.length") == 2
    phone.drive(rows[3:5])
    assert phone.tab.faults() == []


_FULL = """() => {
  window.add = IDBObjectStore.prototype.add;
  IDBObjectStore.prototype.add = () => { throw new DOMException('no room', 'QuotaExceededError'); };
}"""
_ROOM = "() => { IDBObjectStore.prototype.add = window.add; }"


def test_where_there_is_no_room_it_says_so_and_ends_when_there_is(
    web: Web, phone: Phone, rows: list[dict[str, str]]
) -> None:
    page = phone.tab.page
    started(phone, web, rows[:7])
    page.evaluate(_FULL)
    phone.drive(rows[7:14])
    n = phone.counted
    page.get_by_text("cannot be stored: no room.").wait_for()
    page.get_by_role("button", name="Stop").click()
    phone.second()
    page.get_by_role("heading", name="Recording").wait_for()
    page.evaluate(_ROOM)
    stopped(phone)
    expect(page.locator(".recordings")).to_contain_text(f"{n} positions")
    with page.expect_download() as downloads:
        page.get_by_role("button", name="Download the recording").click()
    assert len(read_log(Path(downloads.value.path())).fix) == n


def test_a_gap_is_told_and_a_recording_can_be_deleted(
    web: Web, phone: Phone, rows: list[dict[str, str]]
) -> None:
    page = phone.tab.page
    started(phone, web, rows[:3])
    for _ in range(8):
        phone.second()
    page.get_by_text("No position for more than 5 seconds").wait_for()
    phone.drive(rows[10:12])
    assert page.get_by_text("No position for more than 5 seconds").count() == 0
    expect(page.locator(".figures")).to_contain_text("1, of 0:00:0")
    stopped(phone)
    page.get_by_role("button", name="Delete the recording").click()
    page.get_by_role("dialog").get_by_text("positions over").wait_for()
    page.get_by_role("dialog").get_by_role("button", name="Delete").click()
    page.locator(".recordings").wait_for(state="detached")
    page.reload(wait_until="networkidle")
    assert page.locator(".recordings").count() == 0


def test_only_one_tab_records(web: Web, phone: Phone, rows: list[dict[str, str]]) -> None:
    started(phone, web, rows[:2])
    beside = phone.tab.page.context.new_page()
    beside.goto(f"{web.base}/record", wait_until="networkidle")
    beside.get_by_text("Another tab of this browser is recording.").wait_for()
    assert beside.locator(".recordings").count() == 0
    stopped(phone)
    beside.get_by_role("button", name="Send the recording").wait_for()


def test_without_https_it_says_what_to_do(web: Web, tab: Tab) -> None:
    tab.page.add_init_script("Object.defineProperty(window, 'isSecureContext', {value: false})")
    tab.page.goto(f"{web.base}/record", wait_until="networkidle")
    tab.page.get_by_text("This page cannot record here").wait_for()
    assert tab.page.get_by_role("button", name="Start recording").count() == 0
    link = tab.page.get_by_role("link", name="better ways to record").first
    assert web.client.get(link.get_attribute("href") or "").status_code == 200


def test_who_may_not_know_the_place_is_told(web: Web, tab: Tab) -> None:
    """Also that nothing is kept of nothing."""
    tab.page.goto(f"{web.base}/record", wait_until="networkidle")
    tab.page.get_by_role("button", name="Start recording").click()
    tab.page.get_by_text("does not let this page know where it is").wait_for()
    tab.page.get_by_text("not allowed").wait_for()
    tab.page.get_by_role("button", name="Stop").click()
    tab.page.get_by_role("button", name="Start recording").wait_for()
    assert tab.page.locator(".recordings").count() == 0


def test_who_is_logged_in_no_more_loses_nothing(
    asking: Web,
    phone: Phone,
    key_maker: Callable[..., str],
    enter: Callable[[Tab, str], None],
    rows: list[dict[str, str]],
) -> None:
    page = phone.tab.page
    secret = key_maker("phone", "own", "bus fleet")
    page.goto(f"{asking.base}/record")
    page.wait_for_url("**/login?return_to=%2Frecord")
    enter(phone.tab, secret)
    started(phone, asking, rows[:3])
    stopped(phone)
    page.context.clear_cookies()
    phone.tab.expected.append("401")
    page.get_by_role("button", name="Send the recording").click()
    page.wait_for_url("**/login?return_to=%2Frecord")
    enter(phone.tab, secret)
    page.get_by_role("button", name="Send the recording").click()
    page.get_by_text("Waits to be computed").wait_for()
    page.locator(".recordings").wait_for(state="detached")
    owned = asking.client.get("/v1/drives", headers={"Authorization": f"Bearer {secret}"}).json()["drives"]
    assert len(owned) == 1
