"""States of the operators' page and of the list of drives, with many drives of which some failed."""

from __future__ import annotations

import re

from playwright.sync_api import expect

from page_states.table import Look, state

FOLDED = ("coverage", "agreement", "repeats", "terrain", "roads", "bulk", "room", "audit")


def opened(look: Look, *sections: str) -> None:
    look.go("/admin")
    look.page.get_by_role("table", name=look.t("admin.failures.caption")).wait_for()
    for section in sections:
        look.page.locator(f"#{section} > summary").click()
    look.page.wait_for_load_state("networkidle")


@state("12", "grid")
def problems_with_their_action(look: Look) -> None:
    """What fails for want of roads leads to their import by one click."""
    opened(look)
    row = look.page.locator(".attention li", has_text=look.t("drives.failure.no-match"))
    row.get_by_role("link", name=look.t("admin.import.roads")).click()
    look.page.wait_for_url(re.compile("#import$"))
    form = look.page.locator("form", has=look.page.get_by_role("heading", name=look.t("admin.import.roads")))
    expect(form.locator("input[type=file]")).to_be_in_viewport()


@state("12", "grid")
def every_section_unfolded(look: Look) -> None:
    """Axes begin at 0; no two columns of a table are called the same."""
    opened(look, *FOLDED)
    for name in ("coverage.by_region", "agreement.caption"):
        look.page.get_by_role("table", name=look.t(f"admin.{name}")).wait_for()
    tables = look.page.locator("main table").evaluate_all(
        "all => all.map((one) => [...one.querySelectorAll('thead th')].map((cell) => cell.textContent.trim()))"
    )
    assert len(tables) > 4
    for heads in tables:
        named = [one for one in heads if one]
        assert len(named) == len(set(named)), named


@state("11/14", "grid")
def the_list_of_drives(look: Look) -> None:
    """With one that failed unfolded, and two chosen."""
    look.go("/drives")
    rows = look.page.locator("tbody tr", has_text="log ")
    rows.nth(9).wait_for()
    look.page.get_by_text(look.t("drives.why"), exact=True).first.click()
    for nth in (0, 1):
        look.page.locator("tbody input[type=checkbox]").nth(nth).check()
    expect(look.page.get_by_role("link", name=look.t("drives.compare"))).to_be_visible()
