"""The page that makes addresses for phones, as somebody uses it who has one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from browser_fixtures import Tab
from live_senders import BEGAN_S, osmand, owntracks, way
from web_fixtures import Web


def address(tab: Tab) -> str:
    """What is to be typed."""
    return str(tab.page.locator(".made pre code").inner_text())


@pytest.mark.parametrize("viewport", [{"width": 1280, "height": 900}, {"width": 390, "height": 844}])
def test_an_address_is_made_tried_and_revoked(
    asking: Web,
    tab_maker: Callable[..., Tab],
    key_maker: Callable[..., str],
    enter: Callable[[Tab, str], None],
    words: dict[str, Any],
    viewport: dict[str, int],
) -> None:
    tab = tab_maker(locale=words["locale"], viewport=viewport)
    page, says = tab.page, words["phones"]
    enter(tab, key_maker("desk", "own", "bus fleet"))
    page.goto(f"{asking.base}/phones", wait_until="networkidle")
    page.get_by_text(says["none"]).wait_for()
    page.get_by_label(says["label"]).fill("my <b>phone</b>")
    page.get_by_role("button", name=says["make"]).click()
    page.get_by_role("heading", name=says["made"].format(label="my <b>phone</b>")).wait_for()
    assert page.evaluate("document.activeElement.className").endswith("made")
    page.get_by_role("img", name=says["scan"]).wait_for()
    link = page.get_by_role("link", name=says["open_link"]).get_attribute("href")
    assert link is not None
    assert link.startswith("owntracks:///config?inline=")
    page.get_by_text(says["steps"]["owntracks"]).wait_for()
    page.get_by_text(says["waits"]).wait_for()
    assert tab.faults() == []

    where = address(tab)
    assert where.startswith(f"{asking.base}/v1/live/owntracks/vsk_")
    (sent,) = owntracks(way(1), "pixel")
    assert sent.to(asking.client, where).status_code == 200
    page.get_by_text(says["works"]).wait_for()
    row = page.get_by_role("row").filter(has_text="my <b>phone</b>")
    point = "48,1000, 8,2000" if words["locale"].startswith("de") else "48.1000, 8.2000"
    assert point in row.inner_text()
    assert says["under_way"] in row.inner_text()
    assert tab.faults() == []

    page.get_by_role("button", name=says["kept"]).click()
    assert where not in page.content()
    page.get_by_role("button", name=says["revoke_named"].format(label="my <b>phone</b>")).click()
    page.get_by_role("dialog").get_by_role("button", name=says["revoke"]).click()
    row.filter(has_text=says["revoked"]).wait_for()
    assert sent.to(asking.client, where).status_code == 401


def test_each_program_has_its_own_form(
    asking: Web,
    tab_maker: Callable[..., Tab],
    key_maker: Callable[..., str],
    enter: Callable[[Tab, str], None],
    words: dict[str, Any],
) -> None:
    tab = tab_maker(locale=words["locale"])
    page, says = tab.page, words["phones"]
    enter(tab, key_maker("desk", "own", "bus fleet"))
    page.goto(f"{asking.base}/phones", wait_until="networkidle")
    for title, word, typed in (
        ("OsmAnd", "osmand", "lat={0}&lon={1}&timestamp={2}"),
        ("GPSLogger", "gpslogger", "lat=%LAT&lon=%LON&time=%TIME"),
        ("Traccar", "traccar", "<entry key='forward.type'>json</entry>"),
    ):
        page.get_by_label(title, exact=True).check()
        page.get_by_role("button", name=says["make"]).click()
        page.get_by_text(says["steps"][word]).wait_for()
        assert typed in address(tab)
    assert (
        page.get_by_role("img", name=says["scan"]).count() == 0
    )  # a server's settings are no phone's to scan


def test_what_could_not_be_used_is_told(
    asking: Web,
    tab_maker: Callable[..., Tab],
    key_maker: Callable[..., str],
    enter: Callable[[Tab, str], None],
    words: dict[str, Any],
) -> None:
    secret = key_maker("bus 7", "live", "bus fleet")
    good, bad = osmand(way(2), "x")
    late = bad.params | {"timestamp": BEGAN_S + 10**9}
    path = f"/v1/live/gpslogger/{secret}"
    for params in (good.params, late):
        assert asking.client.get(path, params=params).status_code == 200
    tab = tab_maker(locale=words["locale"])
    enter(tab, key_maker("desk", "own", "bus fleet"))
    tab.page.goto(f"{asking.base}/phones", wait_until="networkidle")
    told = words["phones"]["unusable"]["one"].format(n=1, why=f"point 1: time: {BEGAN_S + 10**9}")
    tab.page.get_by_text(told).wait_for()
