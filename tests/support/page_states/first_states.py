"""States before there are roads: what every page says, what waits, what is uploaded and refused."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from playwright.sync_api import expect

from browser_fixtures import named
from page_states.logs import ride, rides, zip_of
from page_states.table import Look, state
from phone_browser import COUNTED, Phone
from processing_support import HEADER

if TYPE_CHECKING:
    from playwright.sync_api import FilePayload, Locator

MANY_DAYS_S = 10_000_000
PLACES = [{"lat_deg": f"{49 + k * 1e-4}", "lon_deg": "8.4", "alt_msl_m": "120"} for k in range(12)]
"""A way northwards, 11 m a second."""


def missing(look: Look, page: str) -> None:
    """The page says that roads are missing, once, and leads to the form."""
    look.go(f"/{page}")
    place = look.page.locator(".nothing" if page == "map" else ".roads-notice")
    place.get_by_role("link", name=look.t("roads.import")).wait_for()
    expect(look.page).to_have_title(f"{look.t(f'page.{page}')} – Versant")
    assert look.page.locator(".nothing, .roads-notice").count() == 1


@state("6", "bare")
def no_roads_on_the_map(look: Look) -> None:
    missing(look, "map")
    to_upload = look.page.get_by_role("link", name=look.t("map.upload"))
    expect(to_upload).to_have_attribute("href", "/upload")


@state("6/12", "bare")
def no_roads_on_the_dashboard(look: Look) -> None:
    """The way from the problem to its action is one click."""
    missing(look, "admin")
    row = look.page.locator(".attention li", has_text=look.t("admin.attention.kinds.roads.title"))
    row.get_by_role("link", name=look.t("admin.import.roads")).click()
    look.page.wait_for_url("**/admin#import")
    form = look.page.locator("form", has=look.page.get_by_role("heading", name=look.t("admin.import.roads")))
    expect(form.locator("input[type=file]")).to_be_in_viewport()


@state("6/14", "bare")
def drives_that_wait_in_the_list(look: Look) -> None:
    look.go("/drives?waits_for=roads")
    look.page.locator("tbody .state.roads").first.wait_for()
    assert look.page.locator("tbody .state.failed").count() == 0
    chosen = look.page.locator(".filters select").evaluate_all("all => all.map((one) => one.value)")
    assert "roads" in chosen


@state("6", "bare")
def a_drive_that_waits_for_roads(look: Look) -> None:
    """Its track and heights are there, nothing is red, and what is missing is said once."""
    look.go(look.service.drive("waiting"))
    look.page.get_by_role("heading", name=look.t("roads.waits")).wait_for()
    look.page.locator(".track-map canvas").wait_for()
    heights = look.page.get_by_role("figure", name=look.t("drive.chart.heights"))
    heights.get_by_text(look.t("drive.chart.log_height")).first.wait_for()
    assert look.page.get_by_role("figure", name=look.t("drive.chart.grades")).count() == 0
    look.page.get_by_text(look.t("drive.chart.how_log")).wait_for()
    look.page.get_by_text(look.t("drive.ride.ascent"), exact=True).wait_for()
    look.page.get_by_role("heading", name=look.t("drive.ride.climbs")).wait_for()
    assert look.page.get_by_text(look.t("drive.ride.unnamed")).count() == 0, "no road is known yet"
    assert look.page.locator(".drive-status.failed, main .error-text").count() == 0
    assert not look.page.locator(".roads-notice").is_visible()
    expect(look.page.locator(".waits-for").get_by_role("link").first).to_be_visible()


@state("3", "bare")
def a_drive_that_is_computed(look: Look) -> None:
    """How far it is, and how long it will still take."""
    look.go(look.service.drive("running"))
    look.page.get_by_role("heading", name=look.t("drive.status.running")).wait_for()
    status = look.page.locator(".drive-status")
    expect(status).to_contain_text(look.like("drive.status.at", percent=40))
    expect(status).to_contain_text(look.like("drive.status.left"))
    look.go(look.service.drive("reading"))
    status = look.page.locator(".drive-status")
    expect(status).to_contain_text(look.like("drive.status.at", stage=look.t("upload.stage.reading")))


def choose(look: Look, *files: FilePayload) -> None:
    look.go("/upload")
    with look.page.expect_file_chooser() as chooser:
        look.page.get_by_role("button", name=look.t("upload.choose_files")).click()
    chooser.value.set_files(list(files))


def row(look: Look, name: str) -> Locator:
    return look.main.get_by_role("listitem").filter(has=look.page.get_by_text(name, exact=True))


@state("1", "bare")
def a_zip_of_rides(look: Look) -> None:
    """A line for each; two that go on one after the other are one, and the page asks; what is none says so."""
    choose(look, named("rides.zip", zip_of(**rides((1 + look.nth) * MANY_DAYS_S))))
    for name in ("monday.csv, monday2.csv", "tuesday.csv", "friday.csv"):
        row(look, name).get_by_text(look.t("roads.waits")).first.wait_for()
    row(look, "notes.csv").get_by_text(look.t("upload.not_used")).wait_for()
    assert look.page.locator(".upload-row .waits-for").count() == 1, "what would help is said once"
    look.page.get_by_text(look.t("upload.overall", n=3, done=0)).first.wait_for()
    joined = row(look, "monday.csv, monday2.csv")
    expect(joined.get_by_role("button", name=look.t("upload.make_several"))).to_be_visible()


@state("6/14", "bare")
def an_upload_that_waits_for_roads(look: Look) -> None:
    """Neutral, with the extract that would help, also after a reload."""
    choose(look, named("ride.csv", ride((100 + look.nth) * MANY_DAYS_S)))
    own = look.page.locator(".upload-row.roads")
    own.get_by_text(look.t("roads.waits")).first.wait_for()
    look.page.reload()
    own.get_by_text(look.t("roads.waits")).first.wait_for()
    expect(own.locator(".waits-for").get_by_role("link").first).to_be_visible()
    expect(look.page.get_by_text(look.t("upload.overall_roads", n=1)).first).to_be_visible()
    expect(look.page.locator(".roads-notice")).to_contain_text(look.t("roads.none"))
    assert look.page.locator(".upload-row .reason").count() == 0
    assert look.page.get_by_role("button", name=look.t("upload.process_again")).count() == 0


@state("8/11", "bare")
def files_that_are_refused(look: Look) -> None:
    """A picture and an empty log, without a button that cannot help; a table that asks for its columns."""
    look.tab.expected += ["415", "422"]
    header, rows = ride((200 + look.nth) * MANY_DAYS_S).split(b"\n", 1)
    assert header + b"\n" == HEADER
    choose(
        look,
        named("holiday.jpg", b"\xff\xd8\xff" * 300),
        named("empty.csv", HEADER + b"%d,49,8.4\n" % (1 + look.nth)),
        named("ours.csv", b"when;Breite;Laenge\n" + rows.replace(b",", b";")),
    )
    look.page.locator(".upload-row.refused").filter(has_text="holiday.jpg").get_by_text(
        "JPEG"
    ).first.wait_for()
    empty = look.page.locator(".upload-row.failed").filter(has_text="empty.csv")
    empty.get_by_text(look.t("upload.is_failed")).wait_for()
    assert empty.get_by_role("button", name=re.compile("empty.csv")).count() == 1  # to forget it
    ours = look.page.locator(".upload-row.refused").filter(has_text="ours.csv")
    for name, key in (("Breite", "lat_deg"), ("Laenge", "lon_deg"), ("when", "time_s")):
        ours.get_by_label(name, exact=True).select_option(look.t(f"columns.as.{key}"))
    expect(ours.get_by_role("button", name=look.t("upload.with_columns"))).to_be_enabled()


@state("2/10", "bare")
def documentation_that_was_searched(look: Look) -> None:
    """The address says what for; an operation is unfolded."""
    look.go("/docs?q=webhooks")
    expect(look.page.get_by_label(look.t("docs.search"))).to_have_value("webhooks")
    guides = look.t("docs.found_guides", n=1)
    expect(look.page.get_by_text(look.like("docs.found", guides=guides))).to_be_visible()
    look.page.locator("details.operation > summary").first.click()
    look.page.locator("details.operation[open]").wait_for()
    assert "q=webhooks" in look.page.url


@state("15", "bare")
def the_address_of_a_phone(look: Look) -> None:
    """What is to be typed and where, a code to scan, and that nothing has come yet."""
    look.go("/phones")
    look.page.get_by_text(look.like("phones.here_only")).wait_for()
    look.page.get_by_label(look.t("phones.label")).fill("pixel")
    look.page.get_by_role("button", name=look.t("phones.make"), exact=True).click()
    look.page.get_by_role("img", name=look.t("phones.scan")).wait_for()
    look.page.get_by_text(look.t("phones.steps.owntracks")).wait_for()
    look.page.get_by_text(look.t("phones.waits")).wait_for()
    expect(look.page.locator(".made pre code")).to_contain_text("/v1/live/owntracks/vsk_")


@state("15", "bare")
def a_browser_that_is_ready_to_record(look: Look) -> None:
    """What it cannot do is said before it begins, and where better ways are."""
    look.go("/record")
    look.page.get_by_role("button", name=look.t("record.start")).wait_for()
    for limit in ("barometer", "screen", "front", "heights"):
        look.page.get_by_text(look.t(f"record.limit.{limit}")).wait_for()
        look.page.get_by_text(look.t(f"record.limit.{limit}_why")).wait_for()
    better = look.main.get_by_role("link", name=look.t("record.better"))
    expect(better).to_have_attribute("href", "/docs/how-to/record")


@state("15", "bare")
def a_browser_that_records(look: Look) -> None:
    """Its figures, a gap that is told, and the limits in short."""
    recorded(look)
    for _ in range(8):
        look.page.clock.run_for(1000)
    look.page.get_by_text(look.t("record.silent")).wait_for()
    figures = look.page.locator(".figures")
    expect(figures).to_contain_text("± 3 m")
    expect(figures).to_contain_text(look.t("record.motion_is.delivers"))
    look.page.get_by_text(look.t("record.limit.front")).wait_for()


@state("15", "bare")
def a_recording_that_is_kept_and_one_that_was_sent(look: Look) -> None:
    """One can be sent, gone on with, downloaded or deleted; of the other the drive is shown."""
    phone = recorded(look)
    look.page.get_by_role("button", name=look.t("record.stop")).click()
    look.page.get_by_role("button", name=look.like("record.send_named")).click()
    look.page.get_by_text(look.t("upload.is_roads")).wait_for()
    for positions in (1, 8):
        look.page.get_by_role("button", name=look.t("record.start")).click()
        look.tab.await_true(f"{COUNTED} > 0")
        phone.drive(PLACES[1:positions])
        look.page.get_by_role("button", name=look.t("record.stop")).click()
    look.page.get_by_text(look.t("record.nothing")).wait_for()
    for key in ("send_named", "go_on_named", "download_named", "delete_named"):
        look.page.get_by_role("button", name=look.like(f"record.{key}")).first.wait_for()


def recorded(look: Look) -> Phone:
    """Start a recording, with some positions on a day of this combination's own."""
    phone = Phone(look.tab, 1_700_000_000.0 + look.nth * MANY_DAYS_S)
    phone.stand(PLACES[0])
    look.go("/record")
    look.page.get_by_role("button", name=look.t("record.start")).click()
    look.tab.await_true(f"{COUNTED} > 0")
    phone.drive(PLACES[1:])
    return phone
