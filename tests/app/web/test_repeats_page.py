"""The section of repeats in a browser: z by class beside 1, groups, and widenings learned and reset from it."""

from __future__ import annotations

import json
from contextlib import nullcontext

import numpy as np

from app.jobs.context import JobContext
from app.jobs.requests.run import perform
from app.jobs.task import Work
from app.map import figures
from app.network import extracts
from app.operations.run import OPERATION
from browser_fixtures import Tab
from many_drives import execute, rows
from network_support import T0_S, append, new_drive, passes_of
from web_fixtures import Web, fill_roads

SENSORS = {"doppler, ubx": 1.0, "altimeter, fit": 2.5, "altitude, gpx": 0.9}
"""Class -> by how much its sigmas are too small."""


def fill(web: Web, drives: int = 15) -> None:
    fill_roads(web.sessions)
    rng = np.random.default_rng(2)
    with web.sessions() as session:
        table, ids = extracts.all_roads(session)
    for number in range(drives * len(SENSORS)):
        name, truth = list(SENSORS.items())[number % len(SENSORS)]
        sensor, form = name.split(", ")
        said = {row: (2.0 + 0.5 * truth * rng.normal(), 0.5) for row in range(12)}
        drive = new_drive(web.sessions)
        append(
            web.sessions, drive, ids, passes_of(table, said, T0_S + 8e6 * (number // 20) + 86_400.0 * number)
        )
        report = {
            "format": form,
            "sensors": {sensor.replace("altimeter", "altitude"): {}},
            "altimeter": sensor == "altimeter",
        }
        statement = f"UPDATE drives SET report = '{json.dumps(report)}', drive_time = '2026-01-15' WHERE id = '{drive}'"
        execute(web.sessions, statement.replace(":", "\\:"))
    while figures.renew_one(web.sessions):
        pass


def test_repeats_are_shown_and_widenings_are_learned_and_reset(web: Web, tab: Tab) -> None:
    def work() -> None:
        context = JobContext(web.settings, web.sessions, lambda _: 0)
        for (number,) in rows(web.sessions, "SELECT id FROM operations WHERE status = 'queued'"):
            assert perform(OPERATION, context, number, Work(bool, nullcontext)) == "done"

    fill(web)
    page = tab.page
    page.goto(f"{web.base}/admin#repeats")
    groups = page.get_by_role("table", name="Repeats by group")
    groups.get_by_role("row", name="Device: altimeter, fit").wait_for()
    assert "Nothing has been learned yet." in page.locator("#repeats").inner_text()
    assert page.locator("#repeats .z-chart .off").count() >= 1
    assert tab.faults() == []
    for button, title, widened in (
        ("Learn", "Learn widenings from repeats?", True),
        ("Reset", "Take all drives", False),
    ):
        page.get_by_role("button", name=button).first.click()
        page.get_by_role("dialog", name=title).get_by_role("button", name=button).click()
        page.get_by_text("the map follows when no drive waits").first.wait_for()
        work()
        page.reload()
        row = page.get_by_role("table", name="Widenings of device classes").get_by_role(
            "row", name="altimeter, fit"
        )
        row.wait_for()
        applied = float(row.get_by_role("cell").nth(1).inner_text())
        assert (applied > 1.5) is widened
        assert (
            page.get_by_role("row", name="doppler, ubx").last.get_by_role("cell").nth(1).inner_text()
            == "1.00"
        )
