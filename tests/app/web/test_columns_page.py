"""On a drive's page: what the columns of its CSV were taken as, corrected, and heights above the ellipsoid."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from app.roads import imports as road_imports
from app.terrain import imports as dem_imports
from browser_fixtures import Tab
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import write_csv
from fusion.simulate.write.dem_file import write_dem
from fusion.simulate.write.osm_file import write_osm
from geoid_support import installed_grid
from page_states.logs import by_other_names
from processing_support import accept_upload, drive_now, process_drive
from web_fixtures import Web


@pytest.fixture
def drive(web: Web, town: Town, tmp_path: Path) -> Iterator[uuid.UUID]:
    """A drive by another program's names, with its heights above the ellipsoid; a geoid is installed."""
    write_osm(town, tmp_path / "town.osm")
    write_dem(town, tmp_path / "town.tif")
    write_csv(simulate_drive(town, 0, duration_s=60, receiver="m8"), tmp_path / "log.csv")
    road_imports.import_roads(web.sessions, tmp_path / "town.osm", web.context.dem_dir)
    dem_imports.import_dem(web.sessions, [tmp_path / "town.tif"], web.context.dem_dir)
    content = by_other_names((tmp_path / "log.csv").read_bytes())
    with installed_grid(tmp_path):
        made, _ = accept_upload(web.sessions, web.blobs, [content], filename="ride.csv", method="profile")
        compute(web, made.id)
        yield made.id


def compute(web: Web, drive_id: uuid.UUID) -> dict[str, Any]:
    now = drive_now(web.context, drive_id)
    process_drive(web.context, drive_id, now.generation)
    done: dict[str, Any] = web.client.get(f"/v1/drives/{drive_id}").json()
    assert done["status"] == "done", done["failure"]
    return done


def row(page: Page, name: str) -> Any:
    return page.get_by_role("row", name=name)


def test_heights_and_columns_are_put_right(web: Web, drive: uuid.UUID, tab: Tab) -> None:
    page = tab.page
    page.goto(f"{web.base}/drives/{drive}")
    heights = page.get_by_role("region", name="Are these heights above the sea?")
    expect(heights).to_contain_text("above the elevation model all along")
    expect(heights).to_contain_text(
        "The geoid EGM96 turns them into heights above the sea. Slopes hardly change"
    )
    page.get_by_text("5 were guessed by their names").click()
    altitude = row(page, "Altitude (ft)")
    expect(altitude.get_by_role("combobox")).to_have_value("alt_msl_m")
    expect(altitude.get_by_role("cell", name="ft", exact=True)).to_be_visible()
    expect(row(page, "Comment").get_by_role("combobox")).to_have_value("")
    expect(row(page, "Comment")).to_contain_text("x · x · x")
    again = page.get_by_role("button", name="Compute the drive again with these columns")
    expect(again).to_be_disabled()
    row(page, "Comment").get_by_role("combobox").select_option("height above the sea")
    expect(page.get_by_role("alert")).to_contain_text(
        "Only one column can be each of these: height above the sea"
    )
    row(page, "Comment").get_by_role("combobox").select_option("not used")
    row(page, "Pressure").get_by_role("combobox").select_option("not used")
    assert tab.faults() == []
    again.click()
    expect(page.get_by_role("heading", name="Waiting for a worker")).to_be_visible()
    assert compute(web, drive)["options"] == {"columns": {"pressure_hpa": "-"}}
    heights.get_by_role("button", name="Take them as heights above the ellipsoid").click()
    expect(page.get_by_role("heading", name="Waiting for a worker")).to_be_visible()
    done = compute(web, drive)
    assert done["options"] == {"columns": {"pressure_hpa": "-"}, "heights": "ellipsoid"}
    assert (done["report"]["geoid"], done["report"]["height_doubt"]) == ("EGM96", None)
    expect(heights).to_have_count(0)
    expect(page.get_by_text("4 were guessed by their names")).to_be_visible()
