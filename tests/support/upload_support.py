"""The upload page in a browser: choosing files, and what it lists."""

from __future__ import annotations

from typing import Any

from browser_fixtures import Tab
from web_fixtures import Web


def choose(tab: Tab, *files: Any, button: str = "Choose files") -> None:
    with tab.page.expect_file_chooser() as chooser:
        tab.page.get_by_role("button", name=button).click()
    chooser.value.set_files(list(files))


def row(tab: Tab, name: str) -> Any:
    return tab.page.get_by_role("listitem").filter(has=tab.page.get_by_text(name, exact=True))


def opened(tab: Tab, web: Web) -> Tab:
    tab.page.goto(f"{web.base}/upload", wait_until="networkidle")
    return tab
