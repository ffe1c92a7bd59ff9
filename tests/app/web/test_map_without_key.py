"""The map for who has shown no key: all of it where it is public, the way to log in where it is not."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

from app.network import extracts
from browser_fixtures import Tab
from web_fixtures import Web, add_drive

OFF = pytest.mark.parametrize("asking", ["off"], indirect=True)


def segment_of(web: Web) -> int:
    """A segment that a drive of the operator's went over."""
    add_drive(web.sessions, [0, 1, 2], 3.0)
    with web.sessions() as session:
        return int(extracts.all_roads(session)[1][0])


def test_a_public_map_asks_for_nothing_that_needs_a_key(grid_database: str, asking: Web, tab: Tab) -> None:
    segment = segment_of(asking)
    answers: list[tuple[int, str]] = []
    tab.page.on("response", lambda answer: answers.append((answer.status, answer.url)))
    tab.page.goto(f"{asking.base}/map?segment={segment}")
    panel = tab.page.get_by_role("complementary")
    panel.get_by_role("heading", name="The drives behind it").wait_for()
    tab.page.locator(".total").wait_for(state="attached")
    assert [one for one in answers if one[0] >= 400] == []
    assert [url for _, url in answers if re.search("/v1/(drives|exports|admin)|observations", url)] == []
    assert any("/tiles/" in url for _, url in answers)
    panel.get_by_role("link", name="Log in to see your drives here.").click()
    tab.page.wait_for_url(re.compile(rf"/login\?return_to=%2Fmap.*segment%3D{segment}"))


def test_whoever_logs_in_sees_the_drives(
    grid_database: str,
    asking: Web,
    tab: Tab,
    key_maker: Callable[..., str],
    enter: Callable[[Tab, str], None],
) -> None:
    segment = segment_of(asking)
    enter(tab, key_maker("desk", "operate"))
    tab.page.goto(f"{asking.base}/map?segment={segment}")
    tab.page.get_by_role("complementary").get_by_role("table").first.wait_for()


@OFF
def test_a_map_that_is_not_public_leads_to_the_login_and_back(
    grid_database: str,
    asking: Web,
    tab: Tab,
    key_maker: Callable[..., str],
    enter: Callable[[Tab, str], None],
) -> None:
    tab.page.goto(f"{asking.base}/map?at=14.00/49.00500/8.40500")
    tab.page.wait_for_url("**/login?return_to=%2Fmap%3Fat%3D*")
    enter(tab, key_maker("desk", "own"))
    assert tab.page.url.startswith(f"{asking.base}/map?at=14.00")
    tab.page.locator(".total").wait_for(state="attached")

    tab.expected += ["401", "Failed to load"]
    tab.page.context.clear_cookies()  # as when the session is over: the next tile leads to the login
    tab.page.evaluate("window.versantMap.jumpTo({ center: [8.41, 49.012], zoom: 16 })")
    tab.page.wait_for_url("**/login?return_to=%2Fmap%3Fat%3D*")
