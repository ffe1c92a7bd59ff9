"""The page of keys as owners and operators use it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from browser_fixtures import Tab
from web_fixtures import Web

COPYING = ["clipboard-read", "clipboard-write"]


def scope_of(web: Web, secret: str) -> str | None:
    """What the service takes the bearer of a secret for; None: nobody."""
    answer = web.client.get("/v1/session", headers={"Authorization": f"Bearer {secret}"})
    scope = answer.json()["scope"]
    return None if scope is None else str(scope)


def told(tab: Tab) -> str:
    """The secret that is shown."""
    return tab.page.locator(".secret code").inner_text()


def row(tab: Tab, label: str) -> Any:
    return tab.page.get_by_role("row").filter(has_text=label)


def test_an_operator_makes_an_owner_and_its_key(
    asking: Web,
    tab_maker: Callable[..., Tab],
    key_maker: Callable[..., str],
    enter: Callable[[Tab, str], None],
    words: dict[str, Any],
) -> None:
    tab = tab_maker(locale=words["locale"], permissions=COPYING, viewport={"width": 1280, "height": 900})
    page, says = tab.page, words["keys"]
    enter(tab, key_maker("desk", "operate"))
    page.goto(f"{asking.base}/keys", wait_until="networkidle")
    page.get_by_label(says["owner_name"], exact=True).fill("bus fleet")
    page.get_by_role("button", name=says["make_owner"]).click()
    page.get_by_role("rowheader", name="bus fleet").wait_for()

    making = page.get_by_role("form", name=says["make_title"])
    making.get_by_label(says["label"], exact=True).fill("bus <b>7</b>")
    making.get_by_role("combobox", name=says["owner"]).select_option("bus fleet")
    making.get_by_label(says["until"]).fill("2099-12-31")
    assert making.get_by_label("upload").is_checked()
    making.get_by_role("button", name=says["make"]).click()
    page.get_by_role("heading", name=says["secret"].format(label="bus <b>7</b>")).wait_for()
    page.get_by_text(says["once"]).wait_for()
    assert page.evaluate("document.activeElement.className").endswith("secret")
    secret = told(tab)
    assert scope_of(asking, secret) == "upload"
    page.get_by_role("button", name=says["copy"]).click()
    page.get_by_text(says["copied"]).wait_for()
    assert page.evaluate("navigator.clipboard.readText()") == secret
    made = row(tab, "bus <b>7</b>").first.inner_text()
    assert "bus fleet" in made
    assert says["is"]["active"] in made
    assert row(tab, "bus fleet").last.get_by_role("cell").nth(1).inner_text() == "1"

    page.reload(wait_until="networkidle")
    row(tab, "bus <b>7</b>").first.wait_for()
    assert secret not in page.content()


def test_a_key_is_rotated_and_revoked(
    asking: Web,
    tab_maker: Callable[..., Tab],
    key_maker: Callable[..., str],
    enter: Callable[[Tab, str], None],
    words: dict[str, Any],
) -> None:
    tab = tab_maker(locale=words["locale"], viewport={"width": 1280, "height": 800})
    page, says = tab.page, words["keys"]
    enter(tab, key_maker("desk", "own", "bus fleet"))
    first = key_maker("bus 7", "upload", "bus fleet")
    page.goto(f"{asking.base}/keys", wait_until="networkidle")
    asked = page.get_by_role("dialog")
    rotate = page.get_by_role("button", name=says["rotate_named"].format(label="bus 7"))
    rotate.click()
    asked.wait_for()
    page.keyboard.press("Escape")
    asked.wait_for(state="detached")
    assert scope_of(asking, first) == "upload"
    rotate.click()
    asked.get_by_role("button", name=says["rotate"]).click()
    page.get_by_text(says["rotated"].format(label="bus 7")).wait_for()
    second = told(tab)
    assert [scope_of(asking, one) for one in (first, second)] == [None, "upload"]

    page.get_by_role("button", name=says["revoke_named"].format(label="bus 7")).click()
    assert says["revoke_own"] not in asked.inner_text()
    asked.get_by_role("button", name=says["revoke"]).click()
    page.get_by_text(says["revoked"].format(label="bus 7")).wait_for()
    assert scope_of(asking, second) is None
    assert says["is"]["revoked"] in row(tab, "bus 7").inner_text()
    assert row(tab, "bus 7").get_by_role("button").count() == 0


def test_an_owner_sees_its_own_and_gives_no_more_than_it_has(
    asking: Web, tab: Tab, key_maker: Callable[..., str], enter: Callable[[Tab, str], None]
) -> None:
    key_maker("another's", "own", "taxis")
    enter(tab, key_maker("desk", "own", "bus fleet"))
    tab.page.goto(f"{asking.base}/keys", wait_until="networkidle")
    assert tab.page.get_by_role("row").count() == 2
    assert tab.page.get_by_role("radio").count() == 2
    assert not tab.page.get_by_role("heading", name="Owners").is_visible()
    assert not tab.page.get_by_role("combobox", name="Owner").is_visible()


def test_the_key_that_one_logged_in_with(
    asking: Web, tab: Tab, key_maker: Callable[..., str], enter: Callable[[Tab, str], None]
) -> None:
    """Rotating it shows the new secret, though the session is over; revoking it leads to where one logs in."""
    enter(tab, key_maker("desk", "own", "bus fleet"))
    tab.page.goto(f"{asking.base}/keys", wait_until="networkidle")
    asked = tab.page.get_by_role("dialog")
    tab.page.get_by_role("button", name="Rotate desk").click()
    assert "will be logged out" in asked.inner_text()
    asked.get_by_role("button", name="Rotate").click()
    tab.page.get_by_text("it is not shown again").wait_for()
    secret = told(tab)
    tab.page.goto(f"{asking.base}/keys")
    tab.page.wait_for_url("**/login?return_to=%2Fkeys")
    enter(tab, secret)
    tab.page.wait_for_url("**/keys")
    tab.page.get_by_role("button", name="Revoke desk").click()
    asked.get_by_role("button", name="Revoke").click()
    tab.page.wait_for_url("**/login?return_to=%2Fkeys")
    assert scope_of(asking, secret) is None


def test_what_is_refused_is_said(
    asking: Web, tab: Tab, key_maker: Callable[..., str], enter: Callable[[Tab, str], None]
) -> None:
    key_maker("bus 7", "upload", "bus fleet")
    enter(tab, key_maker("desk", "operate"))
    tab.expected += ["409", "422"]
    tab.page.goto(f"{asking.base}/keys", wait_until="networkidle")
    tab.page.get_by_label("Name", exact=True).fill("bus fleet")
    tab.page.get_by_role("button", name="Make the owner").click()
    tab.page.get_by_role("alert").get_by_text("bus fleet").wait_for()
    making = tab.page.get_by_role("form", name="Make a key")
    making.get_by_label("Label", exact=True).fill("   ")
    making.get_by_role("button", name="Make the key").click()
    making.locator("[role=alert]:not(:empty)").wait_for()
    assert tab.page.locator(".secret").count() == 0


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_it_is_for_everybody(
    asking: Web,
    tab_maker: Callable[..., Tab],
    key_maker: Callable[..., str],
    enter: Callable[[Tab, str], None],
    theme: str,
    width: int,
) -> None:
    tab = tab_maker(color_scheme=theme, viewport={"width": width, "height": 844})
    key_maker("a logger of some bus that has a long name", "upload", "a fleet that has a long name as well")
    enter(tab, key_maker("desk", "operate"))
    tab.page.goto(f"{asking.base}/keys", wait_until="networkidle")
    tab.page.get_by_label("Label", exact=True).fill("bus 7")
    tab.page.get_by_role("button", name="Make the key").click()
    tab.page.locator(".secret").wait_for()
    assert tab.faults() == []
    assert tab.page.evaluate("document.documentElement.scrollWidth") <= width
