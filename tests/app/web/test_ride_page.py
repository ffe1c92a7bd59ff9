"""A ride's figures and climbs on its drive's page: pointed at, chosen, in the address, on a desk and on a phone."""

from __future__ import annotations

import io
import json
import re
import uuid
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect
from sqlalchemy import text

from app.drives import tracks
from browser_fixtures import PATIENCE_MS, Tab
from server_support import wait_until
from web_fixtures import Web, add_drive

STRETCH = (0xD4, 0xA9, 0x00)
"""The colour on the map of what is pointed at or chosen."""


@pytest.fixture
def hilly(filled: Web) -> str:
    """The address of a drive over seven segments of 222 m: four up by 10 %, one level, two down by 12 %."""
    drive = add_drive(filled.sessions, list(range(7)), 3.0)
    with filled.sessions.begin() as session:
        session.execute(text("UPDATE segments SET name = 'Bergstraße' WHERE id < 5"))
        track = tracks.read_track(session, drive)
        assert track is not None
        along = 222 * (np.arange(35) // 5 + np.tile(np.linspace(0.1, 0.9, 5), 7))
        height = np.interp(along, [0, 888, 1110, 1554], [100, 188.8, 188.8, 135.5])
        known = np.r_[np.full(35, 0.004), np.nan]
        hill = replace(track, alt_m=np.r_[height, np.nan], pitch_rad=0 * known, pitch_sigma_rad=known)
        tracks.save_track(session, uuid.UUID(str(drive)), tracks.EncodedTrack.of(hill, np.arange(1, 200)))
    return f"{filled.base}/drives/{drive}"


def opened(tab: Tab, address: str) -> Page:
    tab.expected.append("GPU stall due to ReadPixels")
    tab.page.goto(address)
    expect(tab.page.locator(".u-over")).to_have_count(2)
    return tab.page


def stands_out(page: Page) -> bool:
    """Whether the map shows a stretch that does."""
    with Image.open(io.BytesIO(page.locator(".track-map").screenshot())) as picture:
        colours = np.asarray(picture.convert("RGB"), int)
    return int((np.abs(colours - STRETCH).max(axis=2) < 12).sum()) > 100


def shown(page: Page) -> int:
    """Rows that the charts show."""
    slider = page.get_by_role("slider").first
    return int(slider.get_attribute("max") or 0) - int(slider.get_attribute("min") or 0)


def soon(holds: Callable[[], bool]) -> None:
    wait_until(holds, within_s=PATIENCE_MS / 1000)


def test_a_climb_is_pointed_at_chosen_and_in_the_address(hilly: str, tab: Tab) -> None:
    page = opened(tab, hilly)
    climb = page.get_by_role("button", name=re.compile("^Category 4 · Bergstraße"))
    expect(climb).to_contain_text(
        re.compile(r"From km 0.0 to 0\.\d: \d+ m, 8\d m up, \d\.\d ± 0\.\d % on average")
    )
    whole = shown(page)
    assert not stands_out(page)
    climb.focus()
    soon(lambda: stands_out(page))
    expect(page.locator(".track-marker")).to_have_count(1)
    climb.press("Enter")
    expect(page).to_have_url(f"{hilly}?stretch=1")
    expect(climb).to_have_attribute("aria-pressed", "true")
    soon(lambda: shown(page) < whole)
    near = shown(page)
    page.reload()
    soon(lambda: shown(page) == near and stands_out(page))
    page.go_back()
    expect(page).to_have_url(hilly)
    soon(lambda: shown(page) == whole)
    page.go_forward()
    soon(lambda: shown(page) == near)
    climb.click()
    expect(page).to_have_url(hilly)
    soon(lambda: shown(page) == whole)


def test_the_steepest_stretch_is_found_by_the_pointer(hilly: str, tab: Tab) -> None:
    page = opened(tab, hilly)
    steepest = page.get_by_role("button", name=re.compile(r"^1[12]\.\d ± 0\.4 % downhill$"))
    steepest.hover()
    expect(page.locator(".track-marker")).to_have_count(1)
    page.mouse.move(0, 0)
    expect(page.locator(".track-marker")).to_have_count(0)
    steepest.click()
    soon(lambda: stands_out(page))
    expect(page).to_have_url(f"{hilly}?stretch=steepest")
    expect(steepest).to_have_attribute("aria-pressed", "true")
    page.goto(f"{hilly}?stretch=99")
    expect(page.locator("button.climb")).to_have_attribute("aria-pressed", "false")


def test_a_ride_without_climbs_says_so(filled: Web, tab: Tab) -> None:
    page = opened(tab, f"{filled.base}/drives/{add_drive(filled.sessions, [0, 1], 3.0)}")
    expect(page.get_by_text("nowhere does the road gain 35 m")).to_be_visible()


def test_the_result_is_shown_while_its_slopes_are_on_their_way_to_the_map(
    hilly: str, filled: Web, tab: Tab
) -> None:
    drive = {"id": hilly.rsplit("/", 1)[1]}
    stage = "UPDATE drives SET status = 'running', stage = :stage, {} WHERE id = :id"
    with filled.sessions.begin() as session:
        report = session.execute(text("SELECT report FROM drives WHERE id = :id"), drive).scalar_one()
        session.execute(text(stage.format("report = NULL")), {**drive, "stage": "slopes"})
    tab.page.goto(hilly)
    expect(tab.page.get_by_text("This page shows the result by itself.")).to_be_visible()
    expect(tab.page.locator("button.climb")).to_have_count(0)
    with filled.sessions.begin() as session:
        session.execute(
            text(stage.format("report = cast(:report AS jsonb)")),
            {**drive, "stage": "publishing", "report": json.dumps(report)},
        )
    expect(tab.page.get_by_text("Below is the result.")).to_be_visible()
    expect(tab.page.locator("button.climb")).to_have_count(1)
    expect(tab.page.locator(".u-over")).to_have_count(2)
