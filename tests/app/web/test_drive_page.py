"""A drive's page, as people use it: map and profile linked, contradictions, comparison, failure, removal."""

from __future__ import annotations

import re
import uuid
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass

import pytest
from playwright.sync_api import Locator, Page, expect
from sqlalchemy import text

from app.core import databases
from app.core.settings import Settings
from app.drives.trials.run import TRIAL
from app.embedded.cluster import EmbeddedPostgres
from app.jobs.requests.run import perform
from app.jobs.task import Work
from app.roads import imports as road_imports
from app.terrain import imports as dem_imports
from browser_fixtures import PATIENCE_MS, Tab
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import write_csv
from fusion.simulate.write.dem_file import write_dem
from fusion.simulate.write.osm_file import write_osm
from page_states.logs import changed, elsewhere, upside_down
from processing_support import accept_upload, carry_out_removals, drive_now, process_drive
from server_support import wait_until
from web_fixtures import Web, served

SECONDS = 75


@dataclass
class Drives:
    """A service that knows the town, and what became of each log."""

    web: Web
    ids: dict[str, uuid.UUID]

    def address(self, name: str) -> str:
        return f"{self.web.base}/drives/{self.ids[name]}"


@pytest.fixture(scope="module")
def drives(
    cluster: EmbeddedPostgres,
    template_db: str,
    new_database: Callable[[str], str],
    town: Town,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Drives]:
    """Two drives that agree, one that contradicts them, one that failed; all over one route."""
    folder = tmp_path_factory.mktemp("drives")
    write_osm(town, folder / "town.osm")
    write_dem(town, folder / "town.tif")
    write_csv(simulate_drive(town, 0, duration_s=SECONDS + 5, receiver="m8"), folder / "log.csv")
    log = (folder / "log.csv").read_bytes()
    name = new_database(template_db)
    settings = Settings(database_url=cluster.url_of(name), data_dir=folder / "data")
    with served(settings) as web:
        road_imports.import_roads(web.sessions, folder / "town.osm", web.context.dem_dir)
        dem_imports.import_dem(web.sessions, [folder / "town.tif"], web.context.dem_dir)
        logs = {
            "first.csv": changed(log, 0),
            "second.csv": changed(log, 1),
            "<i>wrong</i>.csv": changed(log, 3, upside_down),
            "far.csv": changed(log, 4, elsewhere),
        }
        ids = {}
        for filename, content in logs.items():
            drive, _ = accept_upload(web.sessions, web.blobs, [content], filename=filename, method="profile")
            process_drive(web.context, drive.id, drive.generation)
            ids[filename] = drive.id
        yield Drives(web, ids)
    databases.drop_database(cluster.url, name)


def opened(tab: Tab, address: str) -> Page:
    """The page of a drive with its charts and its map."""
    tab.expected.append("GPU stall due to ReadPixels")
    tab.page.goto(address)
    expect(tab.page.locator(".u-over")).to_have_count(2)
    # Sensors come a little later, and charts are drawn anew with them.
    expect(tab.page.locator(".chart-key.points")).not_to_have_count(0)
    return tab.page


def test_hovering_links_profile_and_map(drives: Drives, tab: Tab) -> None:
    page = opened(tab, drives.address("first.csv"))
    marker = page.locator(".track-marker")
    drawn = page.get_by_role("region", name="Map of the drive").last
    expect(drawn).to_be_visible()
    heights = page.locator(".u-over").first
    heights.scroll_into_view_if_needed()
    heights.hover(position={"x": 300, "y": 60})
    expect(marker).to_have_count(1)
    sliders = page.get_by_role("slider")
    said = sliders.nth(1).get_attribute("aria-valuetext")
    assert "grade" in (said or "")
    assert sliders.nth(0).input_value() == sliders.nth(1).input_value() != "0"
    # Back from the map: the place of the marker is a place of the track.
    spot, all_of_it = marker.bounding_box(), drawn.bounding_box()
    assert spot is not None
    assert all_of_it is not None
    heights.hover(position={"x": 500, "y": 60})
    page.mouse.move(0, 0)
    before = sliders.nth(0).input_value()
    place = {axis: spot[axis] - all_of_it[axis] for axis in ("x", "y")}
    drawn.hover(
        position={"x": place["x"] + spot["width"] / 2, "y": place["y"] + spot["height"] / 2}, force=True
    )
    expect(sliders.nth(0)).not_to_have_value(before)


def under(page: Page, credit: Locator) -> list[int]:
    """Which twentieths of the drive lie under the credit of its map."""
    slider = page.get_by_role("slider").first
    most = int(slider.get_attribute("max") or "0")
    box = credit.bounding_box()
    assert box is not None
    found = []
    for k in range(21):
        slider.fill(str(most * k // 20))
        spot = page.locator(".track-marker").bounding_box()
        assert spot is not None
        x, y = spot["x"] + spot["width"] / 2, spot["y"] + spot["height"] / 2
        if box["x"] <= x <= box["x"] + box["width"] and box["y"] <= y <= box["y"] + box["height"]:
            found.append(k)
    return found


def test_lines_can_be_hidden_and_charts_zoom_together(drives: Drives, tab: Tab) -> None:
    page = opened(tab, drives.address("first.csv"))
    altitude = page.get_by_role("button", name="GNSS altitude")
    expect(altitude).to_have_attribute("aria-pressed", "true")
    expect(page.get_by_role("button", name="vertical Doppler")).to_have_attribute("aria-pressed", "false")
    altitude.click()
    expect(altitude).to_have_attribute("aria-pressed", "false")
    heights, grades = page.get_by_role("slider").all()
    whole = grades.get_attribute("max")
    page.locator(".u-over").first.hover(position={"x": 200, "y": 60})
    heights.press("+")
    expect(grades).not_to_have_attribute("max", whole or "")
    heights.press("0")
    expect(grades).to_have_attribute("max", whole or "")


def test_by_keyboard_alone(drives: Drives, tab: Tab) -> None:
    page = opened(tab, drives.address("first.csv"))
    slider = page.get_by_role("slider").first
    for _ in range(60):
        page.keyboard.press("Tab")
        if slider.evaluate("one => one === document.activeElement"):
            break
    else:
        pytest.fail("the chart cannot be reached by the tabulator")
    before = slider.get_attribute("aria-valuetext")
    for _ in range(9):
        page.keyboard.press("ArrowRight")
    expect(slider).not_to_have_attribute("aria-valuetext", before or "")
    expect(page.locator(".track-marker")).to_have_count(1)


def test_where_it_contradicts_others(drives: Drives, tab: Tab) -> None:
    page = opened(tab, drives.address("<i>wrong</i>.csv"))
    table = page.get_by_role("region", name="Where it contradicts other drives").get_by_role("table")
    expect(table.get_by_role("row").nth(1)).to_be_visible()
    link = table.get_by_role("link").first
    expect(link).to_have_attribute("href", re.compile(r"^/map\?"))
    whole = page.get_by_role("slider").first.get_attribute("max")
    table.get_by_role("button", name="Here").first.click()
    expect(page.get_by_role("slider").first).not_to_have_attribute("max", whole or "")
    expect(page.locator(".track-marker")).to_have_count(1)
    page.locator(".drive-remarks summary").click()
    expect(page.get_by_text("contradicts other drives on").first).to_be_visible()


def test_two_drives_side_by_side(drives: Drives, tab: Tab) -> None:
    page = opened(tab, drives.address("first.csv"))
    page.get_by_label("Beside this drive show").select_option(f"drive {drives.ids['second.csv']}")
    table = page.get_by_role("table", name="Slopes of common segments")
    expect(table.get_by_role("row").nth(1)).to_contain_text("±")
    expect(page.get_by_role("button", name="second.csv")).to_have_count(2)
    assert f"with={drives.ids['second.csv']}" in page.url
    page.reload()
    expect(table.get_by_role("row").nth(1)).to_contain_text("±")
    page.get_by_role("button", name="Stop comparing").click()
    expect(table).to_have_count(0)


def test_a_trial_is_made_beside_the_drive(drives: Drives, tab: Tab) -> None:
    page = opened(tab, drives.address("first.csv"))
    page.get_by_text("Another method or other options").click()
    page.get_by_label("Method", exact=True).select_option("raw")
    page.get_by_role("button", name="Try it beside").click()
    trials = page.get_by_role("region", name="Compare").get_by_role("listitem")
    expect(trials).to_have_count(1)
    address = f"/v1/drives/{drives.ids['first.csv']}/trials"
    trial = drives.web.client.get(address).json()["trials"][0]
    perform(TRIAL, drives.web.context, uuid.UUID(trial["id"]), Work(bool, nullcontext))
    page.get_by_role("button", name="Compare with raw").click()
    table = page.get_by_role("table", name="Slopes of common segments")
    expect(table.get_by_role("row").nth(1)).to_contain_text("±")
    expect(page.get_by_text("over the same instants")).to_be_visible()
    page.get_by_role("button", name="Forget raw").click()
    expect(trials).to_have_count(0)
    assert drives.web.client.get(address).json()["trials"] == []


def test_files_are_to_be_had_without_the_ends_of_the_trip(drives: Drives, tab: Tab) -> None:
    page = opened(tab, drives.address("first.csv"))
    address = f"/v1/drives/{drives.ids['first.csv']}"
    files = page.get_by_role("region", name="Files")
    expect(files.get_by_role("link", name="Track as GPX")).to_have_attribute("href", f"{address}/track?f=gpx")
    files.get_by_role("checkbox", name="Without the ends of the trip").check()
    for name, part in (("Track as GPX", "track?f=gpx"), ("Profile as PNG", "profile?f=png")):
        link = files.get_by_role("link", name=name)
        expect(link).to_have_attribute("href", f"{address}/{part}&ends=hidden")
    expect(files.get_by_role("link", name="The log")).to_have_attribute("href", f"{address}/log")


def test_one_that_failed_says_why_and_is_tried_again(drives: Drives, tab: Tab) -> None:
    page = tab.page
    page.goto(drives.address("far.csv"))
    expect(page.get_by_role("heading", name="Waits for roads")).to_be_visible()
    expect(page.get_by_text("latitude and longitude may be swapped")).to_be_visible()
    with drives.web.sessions.begin() as session:  # as on roads that are there
        session.execute(text("UPDATE drives SET stage = 'match' WHERE filename = 'far.csv'"))
    page.goto(drives.address("far.csv"))
    expect(page.get_by_role("heading", name="could not be processed")).to_be_visible()
    expect(page.get_by_text("No roads are imported where it was driven")).to_be_visible()
    page.get_by_role("button", name="Process it again").click()
    expect(page.get_by_role("heading", name="Waiting for a worker")).to_be_visible()
    # The page follows the run by itself.
    drive = drives.web.client.get(f"/v1/drives/{drives.ids['far.csv']}").json()
    assert drive["status"] == "queued"
    process_again(drives, "far.csv")
    expect(page.get_by_role("heading", name="Waits for roads")).to_be_visible()


def process_again(drives: Drives, name: str) -> None:
    drive = drive_now(drives.web.context, drives.ids[name])
    process_drive(drives.web.context, drive.id, drive.generation)


def test_one_that_is_not_there(drives: Drives, tab: Tab) -> None:
    tab.expected.append("404")
    tab.page.goto(f"{drives.web.base}/drives/{uuid.uuid4()}")
    expect(tab.page.get_by_role("heading", name="There is no such drive")).to_be_visible()
    assert tab.faults() == []


def test_on_a_phone_the_map_comes_first_and_its_credit_hides_no_track(
    drives: Drives, tab_maker: Callable[..., Tab]
) -> None:
    tab = tab_maker(viewport={"width": 390, "height": 844})
    page = opened(tab, drives.address("<i>wrong</i>.csv"))
    track = page.locator(".track-map")
    credit = track.locator(".maplibregl-ctrl-attrib")
    expect(credit).to_contain_text("OpenStreetMap")
    wait_until(lambda: not under(page, credit), within_s=PATIENCE_MS / 1000)
    remarks = page.locator("details.drive-remarks")
    tops = [one.bounding_box()["y"] for one in (track, remarks, page.locator("#figures"))]  # type: ignore[index]
    assert tops == sorted(tops)
    assert tops[1] < 844


def test_what_is_removed_is_said_before_and_after(drives: Drives, tab: Tab) -> None:
    page = opened(tab, drives.address("second.csv"))
    page.get_by_role("button", name="Remove this drive").click()
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text(re.compile(r"what it says of \d+ segments"))
    dialog.get_by_role("button", name="Cancel").click()
    expect(dialog).to_have_count(0)
    page.get_by_role("button", name="Remove this drive").click()
    page.get_by_role("dialog").get_by_role("button", name="Remove").click()
    expect(page.get_by_role("heading", name="This drive was removed")).to_be_visible()
    carry_out_removals(drives.web.sessions, drives.web.blobs)
    assert drives.web.client.get(f"/v1/drives/{drives.ids['second.csv']}").status_code == 404
