"""States of a drive's page: a ride with climbs, remarks, contradictions, columns, odd heights."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from playwright.sync_api import expect

from page_states.table import Look, state

if TYPE_CHECKING:
    from playwright.sync_api import Page


def opened(look: Look, address: str) -> Page:
    """The page of a drive with its charts and its map."""
    page = look.go(address)
    expect(page.locator(".u-over")).to_have_count(2)
    page.locator(".track-map canvas").wait_for()
    return page


@state("5/11", "grid")
def a_ride_with_climbs(look: Look) -> None:
    """Figures and map are on the first screen; climbs have a category, and one is chosen."""
    page = opened(look, f"{look.service.drive('hill')}?stretch=1")
    figures = page.locator(".ride-figures")
    down = look.like("drive.ride.down")
    for name, value in (("ascent", r"\d+ ± 3 m"), ("descent", r"\d+ ± 3 m"), ("steepest", down)):
        term = figures.locator("div", has=page.get_by_text(look.t(f"drive.ride.{name}"), exact=True))
        expect(term.get_by_role("definition")).to_contain_text(re.compile(value))
    climb = page.get_by_role("button", name=f"{look.t('drive.ride.category', category='4')} · Bergstraße")
    expect(climb).to_have_attribute("aria-pressed", "true")
    expect(climb).to_contain_text(look.like("drive.ride.climb", **{"from": look.figure("0.0")}))
    top = page.locator(".track-map").bounding_box()
    assert top is not None
    assert top["y"] + top["height"] < (844 if look.is_phone else 800)


@state("7/10", "town")
def remarks(look: Look) -> None:
    """One line with how many, and how many to act on; on a phone on the first screen, below the map. Then unfolded."""
    page = opened(look, look.service.drive("wrong.csv"))
    folded = page.locator("details.drive-remarks")
    expect(folded.locator("summary")).to_contain_text(look.t("drive.remarks", n=1))
    expect(folded.locator(".warn-text")).to_have_text(look.t("drive.remarks_to_do", n=1))
    track, own = page.locator(".track-map").bounding_box(), folded.bounding_box()
    assert track is not None
    assert own is not None
    assert own["height"] < 60
    if look.is_phone:
        assert track["y"] < own["y"] < 844
    first = folded.get_by_role("listitem").first
    assert not first.is_visible()
    folded.locator("summary").click()
    expect(first).to_contain_text("contradicts" if look.how.language == "en" else "widerspricht")


@state("10/12", "town")
def two_drives_and_every_figure(look: Look) -> None:
    """Beside each other, with the report and the other ways to compute it unfolded."""
    page = opened(look, f"{look.service.drive('wrong.csv')}?with={look.service.places['first.csv']}")
    page.get_by_role("table", name=look.t("drive.compare.table")).wait_for()
    page.get_by_text(look.t("drive.report.all"), exact=True).click()
    page.get_by_text(look.t("drive.again.summary"), exact=True).click()
    page.get_by_role("button", name=look.t("drive.trial.action")).wait_for()
    page.get_by_role("heading", name=look.t("drive.segments.title")).wait_for()


@state("8", "town")
def columns_and_odd_heights(look: Look) -> None:
    """What each column was taken as, its unit and three values, one corrected; heights are said to be odd once."""
    page = opened(look, look.service.drive("columns.csv"))
    page.get_by_text(look.t("columns.were_guessed", n=5)).click()
    taken = page.get_by_label("Altitude (ft)", exact=True)
    expect(taken).to_have_value("alt_msl_m")
    row = page.get_by_role("row", name="Comment")
    expect(row).to_contain_text("x · x · x")
    again = page.get_by_role("button", name=look.t("columns.again"))
    expect(again).to_be_disabled()
    page.get_by_label("Pressure", exact=True).select_option(look.t("columns.not_used"))
    expect(again).to_be_enabled()
    heights = page.get_by_role("region", name=look.t("heights.title"))
    expect(heights).to_contain_text(look.like("heights.above_model"))
    expect(heights).to_contain_text(look.t("heights.by_geoid", name="EGM96"))
    expect(heights.get_by_role("button", name=look.t("heights.take"))).to_be_enabled()
    said = "all along" if look.how.language == "en" else "durchweg"
    assert said in heights.inner_text()
    assert said not in (page.locator("details.drive-remarks").text_content() or "")
