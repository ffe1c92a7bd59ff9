"""States of the map: names, tools, a chosen segment, two dates, the credit."""

from __future__ import annotations

import json
import re
import uuid
from contextlib import nullcontext
from typing import TYPE_CHECKING

from playwright.sync_api import expect

from app.exports.run import EXPORT
from app.jobs.requests.run import perform
from app.jobs.task import Work
from browser_fixtures import named
from named_town import LAT, LON
from page_states.table import Look, state
from web_fixtures import SOUTH, STEP, WEST

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Response

AT = f"at=14.00/{SOUTH + 3.5 * STEP}/{WEST + 3.5 * STEP}"
"""Over the whole grid."""
ABOVE_SHEET = f"at=13.00/{SOUTH - 2 * STEP}/{WEST + 3.5 * STEP}"
"""With the streets in what a phone's sheet leaves of the map."""
RESTS = "Boolean(window.versantMap?.loaded() && !window.versantMap.isMoving())"
MARKS = """(kind) =>
  window.versantMap.querySourceFeatures('marks').filter((one) => one.properties.kind === kind).length"""
NAMED = """(layer) => [...new Set(window.versantMap.queryRenderedFeatures({layers: [layer]})
    .map((one) => one.properties.name ?? one.properties.ref))].sort().join()"""
SEEN = """() => {
  const map = window.versantMap;
  const panel = document.querySelector('aside.panel');
  if (!panel || !map?.loaded() || map.isMoving() || !panel.querySelector('.facts')) return false;
  const id = Number(new URLSearchParams(location.search).get('segment'));
  const [road] = map.queryRenderedFeatures({ layers: ['selected'] }).filter((one) => one.id === id);
  const box = map.getCanvas().getBoundingClientRect();
  const side = panel.getBoundingClientRect();
  const search = document.querySelector('.map-side').firstElementChild.getBoundingClientRect();
  const isSheet = side.width > box.width / 2;
  return Boolean(road) && road.geometry.coordinates.map((one) => map.project(one)).every(({ x, y }) =>
    x > 0 && x < (isSheet ? box.width : side.left) && box.top + y < (isSheet ? side.top : box.bottom)
      && (isSheet ? box.top + y > search.bottom : x > search.right));
}"""
"""Whether all of the chosen segment is in what nothing lies over."""
OVER_EACH_OTHER = """(all) => all.filter((one) => {
  const boxes = [...one.children].map((part) => {
    const words = document.createRange();
    words.selectNodeContents(part);
    return words.getBoundingClientRect();
  });
  return boxes.some((box, n) => n > 0 && box.left < boxes[n - 1].right - 1);
}).map((one) => one.textContent)"""
"""Rows of which a column lies over the one before."""
SHORT = {
    "type": "Feature",
    "properties": {},
    "geometry": {"type": "LineString", "coordinates": [[WEST, SOUTH], [WEST, SOUTH + STEP]]},
}


def opened(look: Look, query: str) -> None:
    look.go(f"/map?{query}")
    look.tab.await_true(RESTS)


def tool(look: Look, name: str) -> Locator:
    """The panel that the button of this name opens; on a phone the buttons are folded."""
    tools = look.page.locator("details.tools")
    assert (tools.get_attribute("open") is None) == look.is_phone
    if look.is_phone:
        tools.locator("summary").click()
    tools.get_by_role("button", name=look.t(f"tools.{name}.open")).click()
    panel = look.page.get_by_role("complementary", name=look.t(f"tools.{name}.title"))
    panel.wait_for()
    return panel


def drawn(look: Look, **wanted: str) -> None:
    """Wait until these layers show these names and no others; labels appear a moment after the tiles."""
    for layer, names in wanted.items():
        look.tab.await_true(f"({NAMED})({json.dumps(layer.replace('_', '-'))}) === {json.dumps(names)}")


def nearer(look: Look, zoom: float) -> None:
    look.page.evaluate("(zoom) => window.versantMap.jumpTo({ zoom })", zoom)
    look.tab.await_true(RESTS)


@state("4/7", "grid")
def the_map_as_it_opens(look: Look) -> None:
    """The legend is folded on a phone, and counts what is in view."""
    opened(look, AT)
    legend = look.page.locator("details.legend")
    assert (legend.get_attribute("open") is None) == look.is_phone
    look.page.wait_for_selector(".total", state="attached")
    expect(look.page.locator(".maplibregl-ctrl-scale")).to_be_visible()


@state("4", "grid")
def names_at_their_zooms(look: Look) -> None:
    """From a town to its streets, with a credit as long as that of many rasters beside the scale."""
    opened(look, f"at=10/{LAT}/{LON}")
    drawn(look, places="Łódź", street_names="", water_names="")
    nearer(look, 13)
    drawn(look, street_names="Große Straße", road_numbers="B 37", water_names="Neckar", places="Łódź")
    nearer(look, 14.5)
    drawn(look, street_names="Große Straße,Şirin Çeşme")
    expect(look.page.locator(".maplibregl-ctrl-scale")).to_be_visible()
    inner = "document.querySelector('.maplibregl-ctrl-attrib-inner')"
    look.page.evaluate(f"{inner}.append(', raster'.repeat(9))")


@state("4/13", "grid")
def credit_of_what_is_in_view(look: Look) -> None:
    """With the legend unfolded over as much of the map as it can."""
    opened(look, f"at=17/{LAT}/{LON - 0.01}")
    credit = look.page.locator(".maplibregl-ctrl-attrib-inner")
    credit.get_by_text("Western <Survey> (CC BY 4.0)").wait_for()
    look.tab.await_true(
        "!document.querySelector('.maplibregl-ctrl-attrib-inner').textContent.includes('east.tif')"
    )
    look.page.evaluate(f"window.versantMap.jumpTo({{center: [{LON + 0.01}, {LAT}]}})")
    credit.get_by_text("east.tif").wait_for()
    assert "Western" not in credit.inner_text()
    assert "OpenStreetMap" in credit.inner_text()
    legend = look.page.locator("details.legend")
    assert (legend.get_attribute("open") is None) == look.is_phone
    if look.is_phone:
        legend.locator("summary").click()


@state("5", "grid")
def steepest_streets(look: Look) -> None:
    """12 % of 9 % sigma is nothing to lead a list with; the street that is pointed at stands out."""
    opened(look, ABOVE_SHEET if look.is_phone else AT)
    rows = tool(look, "steepest").locator("ol.segments button")
    rows.nth(3).wait_for()
    figures = re.findall(r"\d[.,]\d ± \d[.,]\d %", "\n".join(rows.all_inner_texts()))
    wanted = ["9.0 ± 0.5 %", "9.0 ± 0.5 %", "8.0 ± 0.4 %", "7.0 ± 0.1 %"]
    assert figures[:4] == [look.figure(one) for one in wanted]
    rows.first.focus()
    look.tab.await_true(f"({MARKS})('street') > 0")


@state("5", "grid")
def profile_along_a_line(look: Look) -> None:
    """Out of a file, with its sigma; the address keeps it."""
    opened(look, f"{AT}&tool=profile")
    panel = look.page.get_by_role("complementary")
    file = named("street.geojson", json.dumps(SHORT).encode())
    panel.locator("input[type=file]").set_input_files(file)
    panel.get_by_text(look.t("tools.profile.of_file", name="street.geojson")).wait_for()
    for figure in ("heights", "slopes"):
        panel.get_by_role("figure", name=look.t(f"tools.profile.{figure}")).wait_for()
    facts = panel.locator(".facts").inner_text()
    length, measured = (re.escape(look.t(f"tools.profile.{one}")) for one in ("length", "measured"))
    assert re.search(rf"{length}\s+22\d m", facts), facts
    assert re.search(rf"{measured}\s+100 %", facts), facts
    assert re.search(r"\d ± \d", facts), facts
    assert "line=" in look.page.url
    look.tab.await_true(f"({MARKS})('line') > 0 && {RESTS}")


@state("5", "grid")
def drawing_a_line(look: Look) -> None:
    opened(look, f"at=16.00/{SOUTH + 0.5 * STEP}/{WEST}&tool=profile")
    panel = look.page.get_by_role("complementary")
    panel.get_by_role("button", name=look.t("tools.profile.draw"), exact=True).click()
    panel.get_by_role("button", name=look.t("tools.profile.add")).click()
    panel.get_by_text(look.t("tools.profile.points", n=1), exact=True).wait_for()
    assert panel.get_by_role("button", name=look.t("tools.profile.finish")).is_disabled()


def made(look: Look, answer: Response) -> None:
    """What a worker does with the file that the page asked for."""
    number = uuid.UUID(answer.json()["id"])
    outcome = perform(EXPORT, look.service.web.context, number, Work(bool, nullcontext))
    assert outcome == "done", look.service.web.client.get(f"/v1/exports/{number}").text


@state("5", "grid")
def export_of_the_view(look: Look) -> None:
    """By the filters of the page, which says which of them count."""
    opened(look, f"{AT}&sigma=0.3&classes=5")
    panel = tool(look, "export")
    panel.get_by_text(look.t("tools.export.narrowed")).wait_for()
    panel.get_by_text(look.t("tools.export.not_classes")).wait_for()
    with look.page.expect_response(
        lambda one: one.request.method == "POST" and "/v1/exports" in one.url
    ) as asked:
        panel.get_by_role("button", name=look.t("tools.export.format.csv")).first.click()
    with look.page.expect_download():
        made(look, asked.value)
    panel.get_by_role("link", name=look.t("tools.making.file", name="versant-csv.csv")).wait_for()


@state("5", "town")
def proposals_of_incline(look: Look) -> None:
    """By one click, with what to do with the file."""
    lat, lon = look.service.places["steep"]
    opened(look, f"at=15.00/{lat}/{lon}")
    with look.page.expect_response(
        lambda one: one.request.method == "POST" and "/v1/exports" in one.url
    ) as asked:
        panel = tool(look, "inclines")
    assert '"format":"josm"' in str(asked.value.request.post_data)
    made(look, asked.value)
    panel.get_by_role("link", name=re.compile("josm")).wait_for()
    panel.get_by_text(look.t("tools.inclines.found", n=1)).wait_for()
    panel.get_by_text(look.t("tools.inclines.josm_1")).wait_for()


@state("7", "grid")
def a_chosen_segment_is_seen(look: Look) -> None:
    """Chosen by a click or a tap low on the map: nothing lies over it, its panel says it in words."""
    first = look.service.places["street"][0]
    opened(look, f"at=15.50/{SOUTH + 0.002:.5f}/{WEST + 0.001:.5f}")
    place = look.page.evaluate("(at) => window.versantMap.project(at)", [WEST + 0.001, SOUTH])
    frame = look.page.locator("canvas").bounding_box()
    assert frame is not None
    look.page.mouse.click(frame["x"] + place["x"], frame["y"] + place["y"])
    panel = look.page.get_by_role("complementary", name=look.t("segment.panel_segment", id=first))
    panel.get_by_text(look.t("segment.steepest")).first.wait_for()
    panel.get_by_role("figure", name=look.t("segment.history")).wait_for()
    look.tab.await_true(SEEN)


@state("5/11", "grid")
def two_dates_of_a_street(look: Look) -> None:
    """The drive that contradicts beside another: more than chance, said in words and figures."""
    first = look.service.places["street"][0]
    look.go(f"/map?segment={first}")
    panel = look.page.get_by_role("complementary", name=look.t("segment.panel_segment", id=first))
    dates = panel.get_by_role("region", name=look.t("segment.dates.title"))
    first_date, second_date = (
        dates.get_by_label(look.t(f"segment.dates.{one}")) for one in ("first", "second")
    )
    first_date.wait_for()
    by_drive = {
        str(one.get_attribute("value")): one.text_content() for one in first_date.get_by_role("option").all()
    }
    (odd,) = [one for one, text in by_drive.items() if look.t("segment.rejected") in str(text)]
    first_date.select_option(next(one for one in by_drive if one != odd))
    second_date.select_option(odd)
    said = dates.get_by_role("status")
    expect(said).to_have_text(look.like("segment.dates.more"))
    assert re.search(r"[+−]?\d[.,]\d ± \d[.,]\d %", said.inner_text()), said.inner_text()
    dates.scroll_into_view_if_needed()
    look.tab.await_true(SEEN)


@state("5", "grid")
def a_whole_way(look: Look) -> None:
    """Its segments, one of which is pointed at."""
    first = look.service.places["street"][0]
    look.go(f"/map?segment={first}")
    look.page.get_by_role("button", name=look.t("segment.whole_way")).click()
    way = look.page.get_by_role("complementary", name=look.like("segment.panel_way"))
    way.get_by_text(look.t("segment.measured_share")).wait_for()
    way.get_by_text(look.t("segment.list_unknown")).first.wait_for()
    rows = way.locator("ol.segments button, ul.segments button")
    rows.first.focus()
    look.page.locator(".pointed").wait_for()
    assert rows.evaluate_all(OVER_EACH_OTHER) == []
