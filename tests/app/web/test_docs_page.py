"""The documentation page, the plain pages beside it, and where an answer 401 leads."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from html.parser import HTMLParser
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest

from app.core.settings import Settings
from app.web.docs import MOVED
from browser_fixtures import Tab
from web_fixtures import Web

THEMES = ("light", "dark")
PHONE = {"width": 390, "height": 844}


@pytest.mark.parametrize("theme", THEMES)
def test_api_and_guides_are_without_faults(web: Web, tab_maker: Callable[..., Tab], theme: str) -> None:
    tab = tab_maker(color_scheme=theme)
    tab.page.goto(f"{web.base}/docs")
    tab.page.get_by_role("heading", name="segments", exact=True).wait_for()
    for name in ("GET /v1/drives List drives", "POST /v1/webhooks Be told of events"):
        tab.page.locator("summary", has_text=name).click()
    assert tab.faults() == []
    tab.page.goto(f"{web.base}/docs/reference/methods")
    tab.page.get_by_role("heading", name="Methods and their options").wait_for()
    tab.page.get_by_role("link", name="The plan of the house").wait_for()
    assert tab.faults() == []


def test_an_operation_is_found_read_and_tried(filled: Web, tab: Tab) -> None:
    page = tab.page
    page.goto(f"{filled.base}/docs")
    page.get_by_label("Search guides and API").fill("segment observations")
    page.get_by_text(re.compile(r"^\d+ operations? and \d+ guides$")).wait_for()
    assert page.locator("details.operation").count() < 10
    page.get_by_label("Search guides and API").fill("One segment")
    entry = page.locator("#get-v1-segments-segment_id")
    entry.locator("summary").first.click()
    page.wait_for_url(re.compile(r"/docs\?q=One\+segment#get-v1-segments-segment_id$"))
    assert f"curl '{filled.base}/v1/segments/" in entry.inner_text()
    entry.get_by_label("segment_id (required)").fill("1")
    entry.get_by_role("button", name="Send").click()
    said = entry.get_by_role("status")
    said.get_by_text(re.compile("^200 application/geo[+]json")).wait_for()
    assert '"osm_way_id"' in said.inner_text()


def test_an_address_opens_what_it_names(web: Web, tab: Tab) -> None:
    tab.page.goto(f"{web.base}/docs#get-v1-changes")
    entry = tab.page.locator("#get-v1-changes")
    entry.get_by_role("heading", name="Parameters").wait_for()
    assert entry.bounding_box()["y"] < 400  # type: ignore[index]


def test_guides_lead_to_each_other_and_to_files(web: Web, tab_maker: Callable[..., Tab]) -> None:
    tab = tab_maker(viewport=PHONE)
    tab.page.goto(f"{web.base}/docs/how-to/record")
    tab.page.locator("article a[href='/docs/reference/log-formats']").first.click()
    tab.page.wait_for_url("**/docs/reference/log-formats")
    tab.page.goto(f"{web.base}/docs/explanation/security#under-attack")
    tab.page.locator("#under-attack").wait_for()
    tab.await_true("document.getElementById('under-attack').getBoundingClientRect().top < 300")
    tab.await_true("document.title === 'Security – Versant'")  # the page says it once its text is there
    # Wide tables scroll by themselves; the page does not.
    assert tab.page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    tab.page.goto(f"{web.base}/docs/published/al-assaad-2020")
    picture = tab.page.locator("article img").first
    picture.wait_for()
    assert picture.evaluate("one => one.decode().then(() => one.naturalWidth)") > 100
    tab.page.goto(f"{web.base}/docs/reference/monitoring")
    file = tab.page.locator("article a[href$='.json']").first
    assert web.client.get(str(file.get_attribute("href"))).json()["panels"]


def test_a_guide_is_in_the_answer_itself(reading: Any) -> None:
    answer = reading.client.get("/docs/how-to/record")
    assert answer.status_code == 200
    assert '<article lang="en" class="guide"><h1 id="record-a-drive">' in answer.text
    again = reading.client.get("/docs/how-to/record", headers={"If-None-Match": answer.headers["etag"]})
    assert again.status_code == 304
    assert "unsafe" not in answer.headers["content-security-policy"]


def test_every_page_is_listed_shown_and_leads_somewhere(reading: Any) -> None:
    listed = [
        page for section in reading.client.get("/docs/contents.json").json() for page in section["pages"]
    ]
    assert len(listed) > 30
    known: dict[str, int] = {}
    for name in (page["name"] for page in listed):
        answer = reading.client.get(f"/docs/{name}")
        assert answer.status_code == 200, name
        text = answer.text.partition('class="guide">')[2].partition("</article>")[0]
        assert not re.search(r"<script|<style|<iframe|\sstyle=|\son\w+=", text), name
        page = Links(text)
        for address in {one.partition("#")[0] for one in (*page.links, *page.loaded)} - {""}:
            if not address.startswith("http"):
                known.setdefault(address, reading.client.get(address).status_code)
                assert known[address] == 200, f"{name}: {address}"


@pytest.mark.parametrize("name", MOVED)
def test_old_addresses_lead_to_the_new_ones(reading: Any, name: str) -> None:
    answer = reading.client.get(f"/docs/{name}", follow_redirects=False)
    assert answer.status_code == 301
    assert reading.client.get(answer.headers["location"]).status_code == 200


@pytest.mark.parametrize(
    "path", ["../pyproject.toml", "%2e%2e/pyproject.toml", "conf.py", "files", "index.md/x"]
)
def test_nothing_beside_the_documents_is_served(reading: Any, path: str) -> None:
    assert reading.client.get(f"/docs/{path}").status_code == 404


def test_a_guide_that_there_is_not(web: Web, tab: Tab) -> None:
    tab.expected.append("404")
    tab.page.goto(f"{web.base}/docs/nothing%3Cb%3E")
    tab.page.get_by_role("heading", name="There is no such guide").wait_for()
    tab.page.get_by_role("link", name="The plan of the house").wait_for()


class Links(HTMLParser):
    """Where a page leads, and what it loads."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        (self.links if tag == "a" else self.loaded).extend(
            str(found[name]) for name in ("href", "src") if name in found
        )


def test_the_documentation_says_all_routes_without_scripts(reading: Any) -> None:
    answer = reading.client.get("/docs", headers={"Accept": "text/html,*/*;q=0.8"})
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    page = Links(answer.text)
    assert set(page.links) >= {"/openapi.json?f=html", "/openapi.json?f=html#drives"}
    assert all(address.startswith("/web/") for address in page.loaded)
    for address in {address.partition("#")[0] for address in (*page.links, *page.loaded)}:
        assert reading.client.get(address).status_code == 200, address
    plain = reading.client.get("/openapi.json?f=html").text
    parts = [
        address.partition("#")[2] for address in page.links if address.startswith("/openapi.json?f=html#")
    ]
    assert parts
    assert all(f'id="{part}"' in plain for part in parts)
    for path in reading.client.get("/openapi.json").json()["paths"]:
        assert path in answer.text


@pytest.mark.parametrize("theme", THEMES)
def test_pages_of_the_ogc_api_are_without_faults(
    filled: Web, tab_maker: Callable[..., Tab], theme: str
) -> None:
    tab = tab_maker(color_scheme=theme, viewport=PHONE)
    for path in ("/", "/collections", "/collections/segments/items", "/openapi.json"):
        answer = tab.page.goto(f"{filled.base}{path}")
        assert answer is not None
        assert "unsafe" not in answer.headers["content-security-policy"]
        # Its style is applied: without it the ground would be white.
        assert tab.page.evaluate("getComputedStyle(document.body).backgroundColor") != "rgba(0, 0, 0, 0)"
        assert tab.faults() == []


def test_the_front_door_leads_to_every_page(web: Web, tab: Tab) -> None:
    tab.page.goto(f"{web.base}/")
    cards = tab.page.locator("main .pages a")
    assert [one.get_attribute("href") for one in cards.all()] == [
        "/map",
        "/upload",
        "/record",
        "/drives",
        "/admin",
        "/docs",
    ]
    cards.last.click()
    tab.page.get_by_role("heading", name="Documentation").wait_for()


@pytest.fixture
def settings(settings: Settings, request: pytest.FixtureRequest) -> Settings:
    """With a login where a test asks for one."""
    return settings.model_copy(update={"login_url": getattr(request, "param", None)})


@pytest.mark.parametrize("settings", ["/login?app=1"], indirect=True)
def test_an_answer_401_leads_to_the_login_and_back(web: Web, tab: Tab) -> None:
    problem = {"type": "about:blank", "title": "Unauthorised", "status": 401, "detail": "Log in first."}
    tab.expected.append("401")
    tab.page.route(
        "**/openapi.json",
        lambda route: route.fulfill(
            status=401, content_type="application/problem+json", body=json.dumps(problem)
        ),
    )
    tab.page.route(
        "**/login?*", lambda route: route.fulfill(content_type="text/html", body="<h1>Who are you?</h1>")
    )
    tab.page.goto(f"{web.base}/docs#drives")
    tab.page.get_by_role("heading", name="Who are you?").wait_for()
    asked = parse_qs(urlsplit(tab.page.url).query)
    assert asked == {"app": ["1"], "return_to": [f"{web.base}/docs#drives"]}


def test_without_a_login_an_answer_401_says_what_is_wrong(web: Web, tab: Tab) -> None:
    tab.expected.append("401")
    tab.page.route(
        "**/openapi.json",
        lambda route: route.fulfill(
            status=401, content_type="application/json", body='{"detail": "Log in first."}'
        ),
    )
    tab.page.goto(f"{web.base}/docs")
    tab.page.get_by_text("Log in first.").wait_for()
    assert urlsplit(tab.page.url).path == "/docs"
