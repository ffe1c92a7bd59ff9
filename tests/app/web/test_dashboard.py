"""The operators' page in a browser: what it says, where its figures lead, and what can be done from it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from app.core import databases
from app.core.settings import Settings
from app.embedded.cluster import EmbeddedPostgres
from app.jobs.context import JobContext
from app.jobs.requests.run import perform
from app.jobs.task import Work
from app.map import figures
from app.operations.run import OPERATION
from browser_fixtures import Tab
from fusion.simulate.scene.town import Town
from fusion.simulate.write.osm_file import write_osm
from many_drives import execute, make_drives, rows
from web_fixtures import Web, add_drive, fill_roads, served

if TYPE_CHECKING:
    from playwright.sync_api import Page

DRIVES = 40
FAILED = DRIVES // 4
# Drives of many_drives.py are of January: as if they were of the last days.
_RECENT = """
    UPDATE drives SET (created_at, queued_at, started_at, finished_at) = (
        created_at + age, queued_at + age, started_at + age, finished_at + age)
    FROM (SELECT now() - max(created_at) AS age FROM drives WHERE filename LIKE 'log %') AS late
    WHERE filename LIKE 'log %'
"""


def fill(web: Web) -> None:
    """Roads, drives over some of them, and many that are over; every fourth failed."""
    fill_roads(web.sessions)
    add_drive(web.sessions, [0, 1, 2], 3.0)
    add_drive(web.sessions, [2, 3, 4, 5], -1.0)
    make_drives(web.sessions, DRIVES, days=0.5)
    execute(web.sessions, _RECENT)
    while figures.renew_one(web.sessions):
        pass


@pytest.fixture(scope="module")
def looked_at(
    cluster: EmbeddedPostgres,
    template_db: str,
    new_database: Callable[[str], str],
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Web]:
    """One filled service for all tests that change nothing."""
    name = new_database(template_db)
    settings = Settings(database_url=cluster.url_of(name), data_dir=tmp_path_factory.mktemp("looked_at"))
    with served(settings) as running:
        fill(running)
        yield running
    databases.drop_database(cluster.url, name)


@pytest.fixture
def worked_on(web: Web) -> Web:
    """A filled service of this test alone."""
    fill(web)
    return web


def opened(tab: Tab, web: Web, *sections: str) -> Page:
    """The dashboard, with these sections opened besides those that are."""
    page = tab.page
    page.goto(f"{web.base}/admin")
    page.get_by_role("table", name="Failures by reason").wait_for()
    for section in sections:
        page.locator(f"#{section} > summary").click()
    page.wait_for_load_state("networkidle")
    return page


FOLDED = ("coverage", "agreement", "repeats", "terrain", "roads", "bulk", "room", "audit")


def test_every_link_leads_somewhere(looked_at: Web, tab: Tab) -> None:
    page = opened(tab, looked_at, *FOLDED)
    found = page.locator("main a[href]").evaluate_all("all => all.map(a => a.getAttribute('href'))")
    assert len(set(found)) > 25
    for address in sorted(set(found)):
        if address.startswith("#"):
            assert page.locator(address).count() == 1, address
        else:
            answer = looked_at.client.get(
                address, headers={"Accept": "text/html, */*"}, follow_redirects=True
            )
            assert answer.status_code == 200, (address, answer.text)
    page.get_by_role("table", name="Failures by reason").get_by_role(
        "link", name=str(FAILED), exact=True
    ).click()
    page.wait_for_url("**/drives?status=failed&failure=no-match&created_after=*")


def test_what_is_folded_is_not_read(looked_at: Web, tab: Tab) -> None:
    asked: list[str] = []
    tab.page.on("request", lambda request: asked.append(request.url.removeprefix(looked_at.base)))
    page = opened(tab, looked_at)
    assert any(one.startswith("/v1/admin/failures") for one in asked)
    assert not [one for one in asked if re.search("coverage|terrain|sigmas|storage|regions", one)]
    page.get_by_label("Figures by day").select_option("7")
    page.get_by_role("navigation", name="Sections").get_by_role("link", name="Coverage").click()
    page.get_by_role("table", name="Coverage by region").wait_for()
    assert "/v1/admin/failures?days=7" in asked
    assert "days=7" in page.url
    assert page.url.endswith("#coverage")


def test_a_busy_service_is_left_in_peace(looked_at: Web, tab: Tab) -> None:
    page = opened(tab, looked_at)
    asked: list[str] = []

    def busy(route: Any) -> None:
        asked.append(route.request.url)
        route.fulfill(status=503, json={"title": "Busy", "detail": "Too many ask.", "status": 503})

    tab.expected.append("503")
    page.route("**/v1/**", busy)
    page.get_by_role("button", name="Read now").click()
    page.get_by_text("too busy to answer").wait_for()
    page.wait_for_timeout(1500)
    assert 1 <= len(asked) <= 3
    assert page.get_by_role("table", name="Failures by reason").is_visible()
    page.unroute("**/v1/**")
    page.get_by_role("button", name="Read now").click()
    page.get_by_text("again every 10 seconds").wait_for()


def test_by_keyboard_alone(looked_at: Web, tab: Tab) -> None:
    page = opened(tab, looked_at)
    page.get_by_role("navigation", name="Sections").get_by_role("link", name="Failures").focus()
    page.keyboard.press("Enter")
    page.locator("#failures > summary:focus").wait_for()
    for state in ("#failures:not([open])", "#failures[open]"):
        page.keyboard.press("Enter")
        page.locator(state).wait_for()
    button = page.get_by_role("button", name="Retry all that failed: No road near")
    button.wait_for()
    for _ in range(10):
        page.keyboard.press("Tab")
        if button.evaluate("it => it === document.activeElement"):
            break
    page.keyboard.press("Enter")
    question = page.get_by_role("dialog")
    question.wait_for()
    page.keyboard.press("Escape")
    question.wait_for(state="detached")
    assert rows(looked_at.sessions, "SELECT count(*) FROM drives WHERE status = 'queued'") == [(0,)]


def test_failures_are_tried_again_and_the_batch_is_cancelled(worked_on: Web, tab: Tab) -> None:
    page = opened(tab, worked_on)
    page.get_by_role("button", name="Retry all that failed: No road near").click()
    question = page.get_by_role("dialog", name=f"Compute {FAILED} drives again?")
    assert "“No road near”" in question.inner_text()
    assert rows(worked_on.sessions, "SELECT count(*) FROM drives WHERE status = 'queued'") == [(0,)]
    question.get_by_role("button", name=f"Compute {FAILED} again").click()
    card = page.get_by_role("region", name="Batch")
    card.get_by_role("progressbar").wait_for()
    waiting = card.get_by_role("link", name=str(FAILED), exact=True)
    assert re.fullmatch(r"/drives\?status=queued&batch=\d+", waiting.get_attribute("href") or "")
    page.reload()
    card.get_by_role("button", name="Cancel").click()
    question = page.get_by_role("dialog", name="Cancel batch")
    assert f"{FAILED} drives" in question.inner_text()
    question.get_by_role("button", name="Cancel …").click()
    card.get_by_role("heading", name="cancelled").wait_for()
    failed = "SELECT count(*) FROM drives WHERE status = 'failed' AND failure_kind = 'no-match'"
    assert rows(worked_on.sessions, failed) == [(FAILED,)]
    card.get_by_role("button", name="Hide").click()
    card.wait_for(state="detached")


def test_names_are_text_and_all_may_have_failed(web: Web, tab: Tab) -> None:
    make_drives(web.sessions, 8)
    execute(web.sessions, _RECENT)
    markup = "<img src=x onerror=alert(1)>"
    execute(
        web.sessions,
        "UPDATE drives SET status = 'failed', failure_kind = 'internal', failure_reason = :said",
        said=markup,
    )
    page = opened(tab, web)
    assert page.get_by_text(markup).first.is_visible()
    assert page.get_by_role("link", name="8", exact=True).first.is_visible()
    page.get_by_role("heading", name="Failed drives").wait_for()


def test_figures_by_day_have_days_and_begin_at_0(looked_at: Web, tab: Tab) -> None:
    page = opened(tab, looked_at)
    chart = page.get_by_role("figure", name="Drives that ended")
    slider = chart.get_by_role("slider")
    slider.focus()
    page.keyboard.press("Home")
    told = slider.get_attribute("aria-valuetext") or ""
    assert re.match(r"\d{1,2} [A-Z][a-z]{2} \d{4};", told), told


def test_nothing_needs_anybody(web: Web, tab: Tab) -> None:
    execute(web.sessions, "INSERT INTO procrastinate_workers DEFAULT VALUES")
    tab.page.goto(f"{web.base}/admin")
    tab.page.get_by_text("Nothing needs you.", exact=True).wait_for()


def test_many_drives_are_removed_after_a_look(worked_on: Web, tab: Tab) -> None:
    page = opened(tab, worked_on, "bulk", "audit")
    form = page.locator("#bulk")
    form.get_by_role("combobox", name="Drives", exact=True).select_option("all")
    form.get_by_label("Uploaded before this day (UTC)").fill("2000-01-01")
    form.get_by_role("button", name="Remove").click()
    form.get_by_text("No drive would be removed.").wait_for()
    form.get_by_label("Uploaded before this day (UTC)").fill("")
    form.get_by_role("button", name="Remove").click()
    question = page.get_by_role("dialog", name=f"Remove {DRIVES + 2} drives?")
    assert "cannot be undone" in question.inner_text()
    question.get_by_role("button", name="Cancel").click()
    assert rows(worked_on.sessions, "SELECT count(*) FROM audit_log") == [(0,)]
    form.get_by_role("combobox", name="Drives", exact=True).select_option("failed")
    form.get_by_label("Failed for the reason").select_option("no-match")
    form.get_by_role("button", name="Remove").click()
    page.get_by_role("dialog").get_by_role("button", name=f"Remove {FAILED}").click()
    page.get_by_role("table", name="Who asked for what").get_by_text("drives removed").wait_for()


def test_a_region_is_imported_once_its_plan_is_approved_and_removed_again(
    web: Web, tab: Tab, town: Town, tmp_path: Path
) -> None:
    write_osm(town, tmp_path / "town.osm")

    def work() -> None:
        context = JobContext(web.settings, web.sessions, lambda _: 0)
        waiting = "SELECT id FROM operations WHERE status = 'queued'"
        for (number,) in rows(web.sessions, waiting):
            perform(OPERATION, context, number, Work(bool, nullcontext))

    page = tab.page
    page.goto(f"{web.base}/admin#roads")
    form = page.locator("form", has=page.get_by_role("heading", name="Import roads"))
    form.get_by_label("File", exact=True).set_input_files(tmp_path / "town.osm")
    page.get_by_label("Region (empty").fill("here")
    page.get_by_role("button", name="Send and plan").click()
    card = page.get_by_role("region", name="Import of roads: town.osm")
    card.get_by_role("heading", name="Waiting").wait_for()
    work()
    card.get_by_role("heading", name="Planned").wait_for()
    assert "Region here would have" in card.inner_text()
    assert web.client.get("/v1/regions").json()["regions"] == []
    assert "Added" in card.inner_text()
    page.get_by_role("link", name="Read and decide").click()  # the way from the problem to its action
    assert page.url.endswith("#operations")
    card.get_by_role("button", name="Carry it out").click()  # the plan was the question
    card.get_by_role("heading", name="Waiting").wait_for()
    work()
    page.goto(f"{web.base}/admin#roads")  # the way to the action has folded it
    regions = page.get_by_role("table", name="Regions of the road network")
    regions.get_by_role("link", name="here").wait_for()
    regions.get_by_role("button", name="Remove here").click()
    card = page.get_by_role("region", name="Removal of a region: here")
    card.get_by_role("heading", name="Waiting").wait_for()
    work()
    figures = card.locator(".figures").inner_text()
    card.get_by_role("button", name="Carry it out").click()
    question = page.get_by_role("dialog", name="Carry it out: here?")
    assert figures not in question.inner_text(), "they were read already"
    question.get_by_role("button", name="Cancel").click()
    card.get_by_role("button", name="Drop the plan").click()
    card.wait_for(state="detached")
    assert [one["name"] for one in web.client.get("/v1/regions").json()["regions"]] == ["here"]
