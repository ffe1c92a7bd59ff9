"""What every page keeps to, with nothing in the service."""

from __future__ import annotations

import uuid
from collections.abc import Callable

import pytest

from browser_fixtures import Tab
from web_fixtures import Web

PAGES = ("map", "upload", "drives", "admin", "docs", "phones")
THEMES = ("light", "dark")


@pytest.mark.parametrize("theme", THEMES)
@pytest.mark.parametrize("name", PAGES)
def test_it_opens_on_nothing_without_a_fault(
    web: Web, tab_maker: Callable[..., Tab], name: str, theme: str
) -> None:
    tab = tab_maker(color_scheme=theme)
    tab.page.goto(f"{web.base}/{name}", wait_until="networkidle")
    assert tab.page.title().endswith("– Versant")
    assert tab.page.locator("main").is_visible()
    assert tab.page.locator("html").get_attribute("data-theme") == theme
    if theme == "dark":
        assert tab.white_boxes() == []
    if name != "docs":  # whose many operations test_docs_page.py looks at, with some of them open
        assert tab.faults() == []


@pytest.mark.parametrize("name", PAGES)
def test_a_second_language(web: Web, tab_maker: Callable[..., Tab], name: str) -> None:
    tab = tab_maker(locale="de-DE")
    tab.page.goto(f"{web.base}/{name}", wait_until="networkidle")
    assert tab.page.locator("html").get_attribute("lang") == "de"
    assert tab.page.get_by_role("link", name="Karte", exact=True).is_visible()


def test_policy_allows_this_host_alone(web: Web) -> None:
    for name in (*PAGES, f"drives/{uuid.uuid4()}"):
        answer = web.client.get(f"/{name}")
        policy = answer.headers["Content-Security-Policy"]
        assert answer.status_code == 200
        assert "unsafe" not in policy
        assert "http" not in policy


@pytest.mark.parametrize("name", ["nothing.js", "../pages.py", "%2e%2e/pages.py", "map.html", "assets"])
def test_no_other_file_is_served(web: Web, name: str) -> None:
    assert web.client.get(f"/web/{name}").status_code == 404
