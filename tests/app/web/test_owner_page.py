"""The page of an owner's own data, as the owner and an operator use it."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from app.core.blobs import EXPORTS, BlobStore
from app.drives.person import removal
from browser_fixtures import Tab
from many_drives import execute, make_drives
from processing_support import HEADER, carry_out_removals
from web_fixtures import Web


def owner_id(web: Web, name: str) -> int:
    with web.sessions() as session:
        found = session.connection().exec_driver_sql("SELECT id FROM owners WHERE name = %s", (name,))
        return int(found.scalar_one())


def give_drives(web: Web, name: str, n: int = 4) -> None:
    make_drives(web.sessions, n)
    execute(web.sessions, "UPDATE drives SET owner_id = :id", id=owner_id(web, name))


def end_removals(web: Web) -> None:
    """What workers do."""
    carry_out_removals(web.sessions, web.blobs)
    removal.look_after(web.sessions, BlobStore(web.settings.blob_store_url, EXPORTS))


Show = Callable[..., Tab]


@pytest.fixture
def show(
    asking: Web,
    tab_maker: Callable[..., Tab],
    key_maker: Callable[..., str],
    enter: Callable[[Tab, str], None],
) -> Show:
    """``show(page, owner=..., **options)``: a page as that owner sees it, in a browser with these options."""

    def shown(page: str, owner: str = "bus fleet", **options: Any) -> Tab:
        tab = tab_maker(**options)
        enter(tab, key_maker("desk", "own", owner))
        tab.page.goto(f"{asking.base}/{page}", wait_until="networkidle")
        return tab

    return shown


@pytest.fixture
def opened(asking: Web, show: Show, words: dict[str, Any]) -> Tab:
    """The page of an owner that has drives, in each language."""
    tab = show("map", locale=words["locale"], viewport={"width": 1280, "height": 900})
    give_drives(asking, "bus fleet")
    tab.page.get_by_role("link", name=words["page"]["owner_named"].format(name="bus fleet")).click()
    tab.page.get_by_role("heading", name=words["owner"]["has"]).wait_for()
    return tab


def test_for_how_long_logs_are_kept(opened: Tab, words: dict[str, Any]) -> None:
    page, says = opened.page, words["owner"]
    form = page.get_by_role("form", name=says["keeping"])
    days, save = form.get_by_label(says["days"], exact=True), form.get_by_role("button", name=says["save"])
    assert form.get_by_role("radio", name=says["keep"]["as_all"]).is_checked()
    form.get_by_text(says["holds"]["good"]).wait_for()
    form.get_by_role("radio", name=says["keep"]["days"]).check()
    days.fill("7")
    save.click()
    asked = page.get_by_role("dialog")
    asked.get_by_text(says["keep_sure"]).wait_for()
    page.keyboard.press("Escape")
    form.get_by_text(says["holds"]["good"]).wait_for()
    save.click()
    asked.get_by_role("button", name=says["save"]).click()
    form.get_by_text(says["holds"]["days"]["other"].format(n=7)).wait_for()
    days.fill("30")  # for longer: nothing to be asked about
    save.click()
    form.get_by_text(says["holds"]["days"]["other"].format(n=30)).wait_for()
    page.reload(wait_until="networkidle")
    assert days.input_value() == "30"


def test_zones_are_kept(opened: Tab, words: dict[str, Any]) -> None:
    page, says = opened.page, words["owner"]
    form = page.get_by_role("form", name=says["zones"])

    def save_and_reload() -> None:
        form.get_by_role("button", name=says["save_zones"]).click()
        page.get_by_text(says["saved"]).first.wait_for()
        page.reload(wait_until="networkidle")

    form.get_by_text(says["zones_none"]).wait_for()
    for n, (name, lat, lon) in enumerate([("home", "49.4102", "8.6724"), ("work <b>", "49.42", "8.7")], 1):
        form.get_by_role("button", name=says["add_zone"]).click()
        zone = form.get_by_role("group", name=says["zone"].format(n=n))
        zone.get_by_label(says["zone_name"]).fill(name)
        zone.get_by_label(says["lat"]).fill(lat)
        zone.get_by_label(says["lon"]).fill(lon)
    save_and_reload()
    second = form.get_by_role("group", name=says["zone"].format(n=2))
    assert second.get_by_label(says["zone_name"]).input_value() == "work <b>"
    assert second.get_by_label(says["radius"]).input_value() == "300"
    form.get_by_role("button", name=says["drop_zone"].format(name="home")).click()
    save_and_reload()
    assert form.get_by_role("group").count() == 1


def test_the_archive_is_fetched(opened: Tab, words: dict[str, Any]) -> None:
    with opened.page.expect_download() as fetching:
        opened.page.get_by_role("link", name=words["owner"]["fetch"]).click()
    file = fetching.value
    assert file.suggested_filename == "bus fleet.zip"
    names = zipfile.ZipFile(io.BytesIO(Path(file.path()).read_bytes())).namelist()
    assert len([name for name in names if name.endswith("/drive.json")]) == 4


def test_all_is_removed_and_the_receipt_stays(asking: Web, opened: Tab, words: dict[str, Any]) -> None:
    page, says = opened.page, words["owner"]
    page.get_by_text(says["removal_what"]["other"].format(n=4)).wait_for()
    button = page.get_by_role("button", name=says["remove"])
    assert button.is_disabled()
    typed = page.get_by_label(says["type_name"].format(name="bus fleet"))
    typed.fill("bus fleets")
    assert button.is_disabled()
    typed.fill("bus fleet")
    button.click()
    asked = page.get_by_role("dialog")
    asked.get_by_text(says["remove_last"]).wait_for()
    page.keyboard.press("Escape")
    asked.wait_for(state="detached")
    assert owner_id(asking, "bus fleet")
    button.click()
    asked.get_by_role("button", name=says["remove"]).click()
    page.wait_for_url("**/owner?removal=*")
    page.get_by_role("heading", name=says["receipt"]).wait_for()
    page.get_by_text(says["receipt_running"]).wait_for()
    page.get_by_text(says["receipt_keep"]).wait_for()
    assert opened.faults() == []
    end_removals(asking)
    page.get_by_text(says["receipt_done"]).wait_for()  # by itself
    page.get_by_text(says["audit_kept"]["one"].partition(",")[0]).or_(
        page.get_by_text(says["audit_kept"]["other"].partition("{n}")[2].partition(",")[0])
    ).wait_for()
    assert opened.faults() == []
    page.goto(f"{asking.base}/owner")
    page.wait_for_url("**/login?return_to=%2Fowner")


def test_an_operator_sees_it_of_others_and_keeps_its_own(
    asking: Web, tab: Tab, key_maker: Callable[..., str], enter: Callable[[Tab, str], None]
) -> None:
    key_maker("logger", "upload", "taxis & co")
    enter(tab, key_maker("operator's desk", "operate"))
    page = tab.page
    page.goto(f"{asking.base}/keys", wait_until="networkidle")
    page.get_by_role("link", name="taxis & co").click()
    page.get_by_role("heading", name="Data of taxis & co").wait_for()
    assert not page.get_by_role("form", name="Zones that nobody is told about").is_visible()
    address = page.get_by_role("link", name="Fetch the archive").get_attribute("href")
    assert address == f"/v1/owners/{owner_id(asking, 'taxis & co')}/archive"
    page.get_by_label("Type “taxis & co” to confirm").fill("taxis & co")
    page.get_by_role("button", name="Remove everything").click()
    page.get_by_role("dialog").get_by_role("button", name="Remove everything").click()
    page.get_by_text("Nobody sees anything of it any more").wait_for()
    page.goto(f"{asking.base}/owner", wait_until="networkidle")
    page.get_by_text("This is the operator's owner: it cannot be removed.").wait_for()
    assert page.get_by_role("button", name="Remove everything").count() == 0
    tab.expected.append("404")
    page.goto(f"{asking.base}/owner?owner=999", wait_until="networkidle")
    page.get_by_role("alert").get_by_text("There is no owner 999").wait_for()


@pytest.mark.parametrize("asking", ["live", "off", "releases"], indirect=True)
def test_an_upload_says_who_will_see_what(asking: Web, show: Show, words: dict[str, Any]) -> None:
    tab = show("upload", locale=words["locale"])
    said = words["upload"]["seen"][asking.settings.shown_map].format(n=asking.settings.owners_needed)
    tab.page.get_by_text(said).wait_for()
    tab.page.get_by_role("link", name=words["upload"]["your_data"]).click()
    tab.page.get_by_role("heading", name=words["owner"]["title"]).wait_for()


def test_a_drive_without_its_log_says_so(
    asking: Web, show: Show, key_maker: Callable[..., str], words: dict[str, Any]
) -> None:
    sent = {"file": ("monday.csv", HEADER + b"1,49,8\n")}
    headers = {"Authorization": f"Bearer {key_maker('logger', 'own', 'bus fleet')}"}
    drive = asking.client.post("/v1/drives", files=sent, headers=headers).json()["id"]
    gone = "UPDATE drives SET status = 'failed', failure_kind = 'no-match', log_deleted_at = now(), finished_at = now()"
    execute(asking.sessions, gone)
    tab = show(f"drives/{drive}", locale=words["locale"])
    says = words["drive"]
    tab.page.get_by_text(says["log_deleted"].partition("{when}")[2]).wait_for()
    for text in (says["failed"]["retry"], says["again"]["summary"], says["download"]["log"]):
        assert tab.page.get_by_text(text, exact=True).count() == 0


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_it_is_for_everybody(show: Show, theme: str, width: int) -> None:
    owner = "a fleet that has a long name as well"
    tab = show("owner", owner, color_scheme=theme, viewport={"width": width, "height": 844})
    tab.page.get_by_role("button", name="Add a zone").click()
    tab.page.get_by_role("radio", name="For some days").check()
    assert tab.faults() == []
    assert tab.page.evaluate("document.documentElement.scrollWidth") <= width
