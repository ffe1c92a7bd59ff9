"""Logging in and out in a browser: by a key, by a login link, and what is refused."""

from __future__ import annotations

import re
import uuid
from collections.abc import Callable
from typing import Any
from urllib.parse import parse_qs, urlsplit

import httpx
import pytest

from app.access import store
from browser_fixtures import Tab
from web_fixtures import Web

DESK = {"width": 1280, "height": 800}
PHONE = {"width": 390, "height": 844}


def cookie(tab: Tab) -> dict[str, Any] | None:
    """The one that the service has set, if any."""
    found: list[Any] = tab.page.context.cookies()
    assert len(found) <= 1
    return dict(found[0]) if found else None


def owner_of(web: Web, held: dict[str, Any]) -> str | None:
    """Whom the service takes a cookie for."""
    cookies = {held["name"]: held["value"]}
    with httpx.Client(base_url=web.base, trust_env=False, cookies=cookies) as client:
        owner = client.get("/v1/session").json()["owner"]
        return None if owner is None else str(owner["name"])


def link_of(web: Web, key: str) -> str:
    """A login link of the key, as the command prints it."""
    with web.sessions.begin() as session:
        known = store.by_key(session, key)
        assert known is not None
        assert known.caller.key_id is not None
        return f"{web.base}/login#link={store.create_link(session, known.caller.key_id)}"


def test_a_key_logs_in_and_out(
    asking: Web, tab_maker: Callable[..., Tab], key_maker: Callable[..., str], words: dict[str, Any]
) -> None:
    page = (tab := tab_maker(viewport=DESK, locale=words["locale"])).page
    page.goto(f"{asking.base}/login", wait_until="networkidle")
    page.get_by_label(words["login"]["key"], exact=True).fill(f" {key_maker('desk', 'own', 'bus fleet')}\n")
    page.get_by_role("button", name=words["login"]["action"]).click()
    page.wait_for_url(f"{asking.base}/drives")
    header = page.get_by_role("banner")
    header.get_by_text("bus fleet").wait_for()
    assert header.get_by_role("link", name=words["page"]["keys"]).get_attribute("href") == "/keys"
    assert not header.get_by_role("link", name=words["page"]["admin"]).is_visible()
    held = cookie(tab)
    assert held is not None
    assert held["httpOnly"]
    assert page.evaluate("document.cookie") == ""

    header.get_by_role("button", name=words["page"]["log_out"]).click()
    page.wait_for_url(re.compile(r"/map"))
    header.get_by_role("link", name=words["page"]["log_in"]).wait_for()
    assert cookie(tab) is None
    assert owner_of(asking, held) is None


def test_what_does_not_log_in_is_said(
    asking: Web, tab_maker: Callable[..., Tab], key_maker: Callable[..., str], words: dict[str, Any]
) -> None:
    page = (tab := tab_maker(locale=words["locale"])).page
    tab.expected += ["401", "403", "422", "429"]
    page.goto(f"{asking.base}/login", wait_until="networkidle")
    said = page.get_by_role("alert")

    def shown(key: str) -> str:
        page.locator("input[type=password]").fill(key)
        with page.expect_response("**/v1/session"):
            page.keyboard.press("Enter")
        page.locator("button[type=submit]:enabled").wait_for()
        return said.inner_text()

    assert shown(f"vsk_{'x' * 43}") == words["login"]["wrong_key"]
    assert shown(key_maker("logger", "upload")) == words["login"]["upload_key"]
    assert page.evaluate("document.activeElement.type") == "password"
    before, after = words["login"]["too_often"].split("{wait}")
    for _ in range(20):
        if (text := shown("vsk_wrong")) != words["login"]["wrong_key"]:
            break
    assert re.fullmatch(rf"{re.escape(before)}\d+ (s|min){re.escape(after)}", text)
    assert cookie(tab) is None


def test_a_login_link_is_good_once_and_stands_nowhere(
    asking: Web, tab_maker: Callable[..., Tab], key_maker: Callable[..., str], words: dict[str, Any]
) -> None:
    link = link_of(asking, key_maker("desk", "operate"))
    token = link.split("=")[1]
    first, second = (tab_maker(viewport=DESK, locale=words["locale"]) for _ in range(2))
    asked: list[str] = []
    first.page.on("request", lambda request: asked.append(f"{request.url} {request.headers}"))
    first.page.goto(link)
    first.page.wait_for_url(re.compile("/map"))
    first.page.get_by_role("banner").get_by_text("operator").wait_for()
    assert any("/v1/session" in one for one in asked)
    assert [one for one in asked if token in one] == []
    first.page.go_back()  # to before the link: it is not in the history
    assert token not in first.page.url

    second.expected.append("401")
    second.page.goto(f"{asking.base}/login", wait_until="networkidle")
    second.page.goto(link)  # the fragment alone is another
    second.page.get_by_text(words["login"]["link_void"]).wait_for()
    assert second.page.url == f"{asking.base}/login"
    assert cookie(second) is None
    second.page.reload(wait_until="networkidle")
    assert second.page.get_by_role("alert").inner_text() == ""


def test_a_link_leads_to_where_it_says_within_this_site(
    asking: Web, tab_maker: Callable[..., Tab], key_maker: Callable[..., str]
) -> None:
    key = key_maker("desk", "own")
    for asked, reached in (
        ("/upload", "/upload"),
        ("//elsewhere.example/", "/drives"),
        ("/\\elsewhere.example/", "/drives"),
        ("https://elsewhere.example/", "/drives"),
    ):
        page = tab_maker().page
        page.goto(f"{asking.base}/login?return_to={asked}", wait_until="networkidle")
        page.locator("input[type=password]").fill(key)
        page.keyboard.press("Enter")
        page.wait_for_url(f"{asking.base}{reached}")
    page = tab_maker().page
    link = link_of(asking, key).replace("/login", "/login?return_to=/drives%3Fq=a")
    page.goto(link)
    page.wait_for_url(f"{asking.base}/drives?q=a")


def test_a_provider_of_logins_is_offered_and_its_refusal_said(
    asking: Web, tab_maker: Callable[..., Tab], words: dict[str, Any]
) -> None:
    page = (tab := tab_maker(locale=words["locale"])).page
    page.goto(f"{asking.base}/login", wait_until="networkidle")
    assert not page.get_by_role("link", name=words["login"]["provider"]).is_visible()

    def with_provider(route: Any) -> None:
        document = asking.client.get("/v1/session").json() | {"login_provider": True}
        route.fulfill(json=document)

    page.route("**/v1/session", with_provider)
    page.goto(f"{asking.base}/login?return_to=/map%3Fat=1/2/3&failed=provider", wait_until="networkidle")
    page.get_by_text(words["login"]["provider_failed"]).wait_for()
    link = page.get_by_role("link", name=words["login"]["provider"])
    assert link.get_attribute("href") == "/v1/session/oidc?return_to=%2Fmap%3Fat%3D1%2F2%2F3"
    assert tab.faults() == []
    page.goto(f"{asking.base}/login?return_to=//elsewhere.example", wait_until="networkidle")
    assert link.get_attribute("href") == "/v1/session/oidc"


def test_no_session_is_taken_over_that_was_there_before(
    asking: Web, tab: Tab, key_maker: Callable[..., str], enter: Callable[[Tab, str], None]
) -> None:
    """Somebody plants a cookie of theirs in a browser: whoever logs in there gets another."""
    enter(tab, key_maker("desk", "own", "somebody else"))
    planted = cookie(tab)
    assert planted is not None
    for value in (planted["value"], "chosen-by-somebody-else"):
        tab.page.goto("about:blank")
        tab.page.context.clear_cookies()
        tab.page.context.add_cookies([{"name": planted["name"], "value": value, "url": asking.base}])
        tab.page.goto(f"{asking.base}/login", wait_until="networkidle")
        enter(tab, key_maker("mine", "own", "bus fleet"))
        held = cookie(tab)
        assert held is not None
        assert held["value"] != value
        assert owner_of(asking, held) == "bus fleet"
    assert owner_of(asking, planted) != "bus fleet"


def test_who_has_shown_no_key_logs_in_and_comes_back(
    asking: Web, tab: Tab, key_maker: Callable[..., str], enter: Callable[[Tab, str], None]
) -> None:
    for path in ("/upload", "/admin", "/keys", f"/drives/{uuid.uuid4()}"):
        tab.page.goto(asking.base + path)
        tab.page.wait_for_url(f"**/login?return_to={path.replace('/', '%2F')}")
    tab.page.goto(f"{asking.base}/drives?q=a+b#content")
    tab.page.wait_for_url("**/login?*")
    assert parse_qs(urlsplit(tab.page.url).query) == {"return_to": ["/drives?q=a+b#content"]}
    enter(tab, key_maker("desk", "own"))
    assert tab.page.url == f"{asking.base}/drives?q=a+b#content"
    tab.page.get_by_text("No drive is like that.").wait_for()

    tab.expected.append("401")
    tab.page.context.clear_cookies()  # as when the session is over
    tab.page.get_by_label("Search by file name or id").fill("tuesday")
    tab.page.wait_for_url("**/login?*")
    assert parse_qs(urlsplit(tab.page.url).query) == {"return_to": ["/drives?q=tuesday"]}


def test_pages_for_operators_are_theirs(
    asking: Web,
    tab_maker: Callable[..., Tab],
    key_maker: Callable[..., str],
    enter: Callable[[Tab, str], None],
    words: dict[str, Any],
) -> None:
    page = (tab := tab_maker(viewport=DESK, locale=words["locale"])).page
    enter(tab, key_maker("desk", "own", "bus fleet"))
    page.goto(f"{asking.base}/admin", wait_until="networkidle")
    page.get_by_role("heading", name=words["page"]["for_operators"]).wait_for()
    enter_again = key_maker("desk of the operator", "operate")
    page.goto(f"{asking.base}/login?return_to=/admin", wait_until="networkidle")
    page.get_by_text(words["login"]["already"].format(owner="bus fleet")).wait_for()
    enter(tab, enter_again)
    page.get_by_role("banner").get_by_role("link", name=words["page"]["admin"]).wait_for()
    page.get_by_role("heading", name=words["admin"]["parts"]["attention"]).wait_for()


def test_a_service_that_asks_for_no_keys_shows_nothing_of_them(web: Web, tab: Tab) -> None:
    for path in ("/map", "/drives", "/admin"):
        tab.page.goto(web.base + path, wait_until="networkidle")
        header = tab.page.get_by_role("banner").inner_text()
        assert "Dashboard" in header
        assert not re.search("Log|Keys|operator", header)
    tab.page.goto(f"{web.base}/login")
    tab.page.wait_for_url(re.compile("/map"))


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("viewport", [DESK, PHONE], ids=["desk", "phone"])
def test_it_is_for_everybody(
    asking: Web, tab_maker: Callable[..., Tab], theme: str, viewport: dict[str, int]
) -> None:
    tab = tab_maker(color_scheme=theme, viewport=viewport)
    tab.expected.append("401")
    tab.page.goto(f"{asking.base}/login", wait_until="networkidle")
    assert tab.faults() == []
    tab.page.locator("input[type=password]").fill("vsk_wrong")
    tab.page.keyboard.press("Enter")
    tab.page.locator("[role=alert]:not(:empty)").wait_for()
    assert tab.faults() == []
    assert tab.page.evaluate("document.documentElement.scrollWidth") <= viewport["width"]
