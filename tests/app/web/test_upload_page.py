"""The upload page as people use it: from a file to the drive, and what happens to files that are no logs."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import text

from app.roads.imports import import_roads
from browser_fixtures import Tab, named
from fusion.roads.table import RoadTable
from page_states.logs import rides, zip_of
from processing_support import HEADER
from region_support import bring
from ride_archive import make_archive, zipped
from upload_support import choose, opened, row
from web_fixtures import Web

MANY = 80
LOG = HEADER + b"".join(b"%d,%.5f,8.4\n" % (k, 49 + k * 1e-4) for k in range(40))
# Drops a tree of files as a file manager would; entries of folders are what no test may make otherwise.
_DROP = """
(tree) => {
  const entry = (name, content) => content === null || typeof content === 'string'
    ? {name, isFile: true, isDirectory: false, file: (done) => done(new File([content ?? ''], name))}
    : {name, isFile: false, isDirectory: true, createReader: () => {
        const parts = Object.entries(content).map(([n, c]) => entry(n, c));
        return {readEntries: (done) => done(parts.splice(0, 2))};
      }};
  const items = Object.entries(tree).map(([n, c]) => ({kind: 'file', webkitGetAsEntry: () => entry(n, c)}));
  const drop = new Event('drop', {bubbles: true, cancelable: true});
  Object.defineProperty(drop, 'dataTransfer', {value: {items, files: [], types: ['Files']}});
  document.querySelector('main').dispatchEvent(drop);
}
"""

_COUNT = """
  window.sent = window.now = window.most = 0;
  const open = XMLHttpRequest.prototype.open;
  XMLHttpRequest.prototype.open = function (...how) {
    window.sent += 1;
    window.now += 1;
    window.most = Math.max(window.most, window.now);
    this.addEventListener('load', () => { window.now -= 1; });
    return open.apply(this, how);
  };
"""


def test_a_log_from_the_drop_to_the_map_and_again(
    web: Web, tab: Tab, files: Path, computing: None, tmp_path: Path
) -> None:
    import_roads(web.sessions, files / "town.osm", tmp_path / "dem")
    opened(tab, web).page.evaluate(
        _DROP,
        {
            "logs": {
                "0.csv": (files / "0.csv").read_bytes().decode(),
                ".hidden": "x",
                "deep": {".git": {"a": "b"}},
            }
        },
    )
    done = row(tab, "0.csv")
    done.get_by_text("Done:").wait_for()
    tab.page.get_by_text("2 hidden files or folders were left out.").wait_for()
    tab.page.get_by_text("1 of 1 drive is done.").first.wait_for()
    [drive] = web.client.get("/v1/drives").json()["drives"]
    assert (
        done.get_by_role("link", name="Open the drive 0.csv").get_attribute("href")
        == f"/drives/{drive['id']}"
    )
    west, south, east, north = (
        float(part)
        for part in done.get_by_role("link", name="on the map").get_attribute("href").split("=")[1].split(",")
    )
    assert [west, south, east, north] == pytest.approx(drive["bbox"], abs=1e-4)
    assert tab.faults() == []
    # The same bytes under another name.
    choose(tab, named("again.csv", (files / "0.csv").read_bytes()))
    row(tab, "again.csv").get_by_text("Already uploaded").wait_for()
    assert len(web.client.get("/v1/drives").json()["drives"]) == 1


def test_what_is_refused_says_why_and_can_be_tried_again(web: Web, tab: Tab) -> None:
    opened(tab, web)
    tab.expected += ["415", "422", "413"]
    choose(tab, named("holiday.jpg", b"\xff\xd8\xff" * 300), named("big.csv", LOG + b" " * 300_000))
    row(tab, "holiday.jpg").get_by_text("looks like a JPEG picture").wait_for()
    row(tab, "big.csv").get_by_text("larger than 200000 bytes").wait_for()
    row(tab, "big.csv").get_by_role("button", name="Try big.csv again").wait_for()
    # A CSV by other names: people say what its columns are.
    header, rows = LOG.split(b"\n", 1)
    assert header == b"time_s,lat_deg,lon_deg"
    choose(tab, named("ours.csv", b"when;Breite;Laenge\n" + rows.replace(b",", b";")))
    form = row(tab, "ours.csv")
    form.get_by_text(
        "No column of the file was found to be this: date and time, latitude, longitude."
    ).wait_for()
    assert "--columns" not in form.inner_text()
    for ours, theirs in (("latitude", "Breite"), ("longitude", "Laenge"), ("seconds since 1970", "when")):
        form.get_by_label(theirs, exact=True).select_option(ours)
    form.get_by_role("button", name="Upload with these columns").click()
    form.get_by_text("Waits to be computed").wait_for()
    [drive] = web.client.get("/v1/drives").json()["drives"]
    assert drive["options"] == {"columns": {"lat_deg": "Breite", "lon_deg": "Laenge", "time_s": "when"}}
    row(tab, "holiday.jpg").get_by_role("button", name="Remove holiday.jpg").click()
    row(tab, "holiday.jpg").wait_for(state="detached")


def test_a_failure_is_told_and_computed_again(
    web: Web, tab: Tab, computing: None, chain: Callable[..., RoadTable]
) -> None:
    bring(web.sessions, chain(3, lon=8.4027), "beside", dem_dir=web.context.dem_dir)
    opened(tab, web)
    log = HEADER + b"".join(b"%d,%.5f,8.4\n" % (1_700_000_000 + k, 49 + k * 1e-4) for k in range(40))
    choose(tab, named("far.csv", log))
    far = row(tab, "far.csv")
    far.get_by_text("Could not be computed").wait_for()
    [drive] = web.client.get("/v1/drives").json()["drives"]
    said, _, what_to_do = drive["failure"]["reason"].partition(". ")
    assert far.get_by_text(said).is_visible()
    assert "--columns" in what_to_do and "--columns" not in far.inner_text()
    far.get_by_role("button", name="Try far.csv again").click()
    for _ in range(100):
        with web.sessions() as session:
            query = text("SELECT generation, status FROM drives")
            generation, status = session.execute(query).one()
        if generation == 2 and status == "failed":
            break
        tab.page.wait_for_timeout(50)
    assert generation == 2
    far.get_by_text("Could not be computed").wait_for()


def test_uploads_survive_a_reload_and_lists_follow_other_tabs(web: Web, tab: Tab) -> None:
    opened(tab, web)
    beside = tab.page.context.new_page()
    beside.goto(f"{web.base}/drives", wait_until="networkidle")
    choose(tab, named("monday.csv", LOG), named("tuesday.csv", LOG + b"40,49.1,8.4\n"))
    for name in ("monday.csv", "tuesday.csv"):
        row(tab, name).get_by_text("Waits to be computed").wait_for()
        beside.get_by_role("link", name=name).wait_for()
    tab.page.reload(wait_until="networkidle")
    row(tab, "tuesday.csv").get_by_text("Waits to be computed").wait_for()
    row(tab, "monday.csv").get_by_role("button", name="Cancel monday.csv").click()
    tab.page.get_by_role("dialog").get_by_role("button", name="Remove the drive").click()
    beside.get_by_role("link", name="monday.csv").wait_for(state="detached")
    assert beside.get_by_role("link", name="tuesday.csv").is_visible()
    tab.page.reload(wait_until="networkidle")
    row(tab, "tuesday.csv").wait_for()
    assert row(tab, "monday.csv").count() == 0
    assert tab.faults() == []
    [drive] = web.client.get("/v1/drives").json()["drives"]
    web.client.delete(f"/v1/drives/{drive['id']}")
    tab.expected.append("404")
    tab.page.reload(wait_until="networkidle")
    row(tab, "tuesday.csv").wait_for(state="detached")


def test_files_of_one_drive_a_method_and_the_keyboard_alone(web: Web, tab: Tab) -> None:
    opened(tab, web)
    keys = tab.page.keyboard
    tab.page.get_by_text("How drives are computed").focus()
    keys.press("Enter")
    tab.page.get_by_label("Method").focus()
    keys.type("particle")
    keys.press("Tab")
    keys.press("Enter")  # unfolds its options
    particles = tab.page.get_by_label("particles", exact=True)
    particles.fill("5")
    tab.page.get_by_text("Out of range").first.wait_for()
    particles.fill("700")
    tab.page.get_by_text("Out of range").first.wait_for(state="detached")
    tab.page.get_by_label("resampling", exact=True).select_option("systematic")
    tab.page.get_by_label("Positions").select_option("receiver")
    assert tab.faults() == []
    with tab.page.expect_file_chooser() as chooser:
        tab.page.get_by_role("button", name="Choose files").focus()
        keys.press("Enter")
    chooser.value.set_files([named("rover.csv", LOG), named("brdc.26n", HEADER + b"1,2,3\n")])
    tab.page.get_by_text("Do these 2 files belong together?").wait_for()
    # The page moves the focus there when it has drawn the question.
    tab.await_true("document.activeElement.textContent === 'They are one drive'")
    keys.press("Enter")
    row(tab, "rover.csv, brdc.26n").get_by_text("Waits to be computed").wait_for()
    [drive] = web.client.get("/v1/drives").json()["drives"]
    assert drive["filename"] == "rover.csv, brdc.26n"
    assert drive["method"] == "particle"
    assert drive["options"] == {"particles": 700, "resampling": "systematic", "gnss": "receiver"}
    tab.page.get_by_role("button", name="Cancel rover.csv").focus()
    keys.press("Enter")
    tab.page.get_by_role("dialog").get_by_role("button", name="Remove the drive").focus()
    keys.press("Enter")
    tab.page.get_by_text("Removed from the service").wait_for()
    assert web.client.get(f"/v1/drives/{drive['id']}").status_code == 404


def test_a_zip_of_rides_has_a_row_for_each_and_asks_where_it_is_unclear(web: Web, tab: Tab) -> None:
    opened(tab, web)
    choose(tab, named("rides.zip", zip_of(**rides())))
    for name in ("monday.csv, monday2.csv", "tuesday.csv", "friday.csv"):
        row(tab, name).get_by_text("Waits to be computed").wait_for()
    notes = row(tab, "notes.csv")
    notes.get_by_text("Not used").wait_for()
    assert notes.get_by_text("in no format that is known").is_visible()
    joined = row(tab, "monday.csv, monday2.csv")
    joined.get_by_text("Is this one drive?").wait_for()
    assert len(web.client.get("/v1/drives").json()["drives"]) == 3
    joined.get_by_role("button", name="Make several drives of it").click()
    for name in ("monday.csv", "monday2.csv"):
        row(tab, name).get_by_text("Waits to be computed").wait_for()
    joined.wait_for(state="detached")
    tab.page.get_by_text("0 of 4 drives are done.").first.wait_for()
    drives = web.client.get("/v1/drives").json()["drives"]
    assert sorted(drive["filename"] for drive in drives) == [
        "friday.csv", "monday.csv", "monday2.csv", "tuesday.csv",
    ]  # fmt: skip


def test_many_files(web: Web, tab: Tab) -> None:
    """None is lost, no more than two are sent at once, and leaving meanwhile is warned of."""
    tab.page.add_init_script(_COUNT)
    opened(tab, web)
    choose(tab, *[named(f"{k}.csv", LOG + b"%d,49,8\n" % (1000 + k)) for k in range(MANY)])
    asked = tab.page.evaluate("() => !window.dispatchEvent(new Event('beforeunload', {cancelable: true}))")
    assert asked
    tab.page.get_by_text("you may leave this page").wait_for(timeout=60_000)
    assert tab.page.evaluate("[window.sent, window.most]") == [MANY, 2]
    with web.sessions() as session:
        assert session.execute(text("SELECT count(*) FROM drives")).scalar_one() == MANY
    assert uuid.UUID(web.client.get("/v1/drives?q=79").json()["drives"][0]["id"])


def test_a_zip_of_years_is_told_file_by_file(web: Web, tab: Tab, tmp_path: Path) -> None:
    """The browser opens it, zips in it too, and the service says of each file what it is."""
    made = make_archive(tmp_path / "years", 40)
    paths = [path for path in made.root.rglob("*") if path.is_file()]
    files = {path.relative_to(made.root).as_posix(): path.read_bytes() for path in paths}
    archive = tmp_path / "export_1.zip"
    archive.write_bytes(zipped({**files, "media/holiday.jpg": b"\xff\xd8\xff"}))
    tab.expected += ["415", "422"]
    opened(tab, web)
    choose(tab, archive)
    tab.page.get_by_text("you may leave this page").wait_for()
    again = made.kinds["repeated"]  # in a form the same bytes twice are refused, and each file goes by itself
    tab.page.get_by_text(f"0 of {made.drives + again} drives are done.").first.wait_for()
    assert len(web.client.get("/v1/drives?limit=100").json()["drives"]) == made.drives
    assert tab.page.locator(".upload-row").filter(has_text="Already uploaded").count() == again
    not_used = tab.page.locator(".upload-row.refused")
    assert not_used.count() == made.files - made.drives - again  # the picture is shown, Strava's list is not
    not_used.filter(has_text="15.fit").get_by_text("It was recorded as swimming").wait_for()
    not_used.filter(has_text="holiday.jpg").get_by_text("no log of a drive").wait_for()
    not_used.filter(has_text="19.gpx").get_by_text("It was recorded as jogging").wait_for()
    assert not_used.get_by_role("button", name="Try").count() == 0
    assert tab.page.locator(".upload-row.queued").first.get_by_text("in export_1.zip").is_visible()
