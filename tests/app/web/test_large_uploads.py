"""Large files on the upload page: in parts, over connections that break."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from app.core.settings import Settings
from app.drives.receiving.resumed import MOST_OPEN
from browser_fixtures import Tab
from processing_support import HEADER
from upload_support import choose, opened, row
from web_fixtures import Web, served

LARGE_BYTES = 17 << 20
"""More than is sent at once."""


@pytest.fixture
def roomy(settings: Settings) -> Iterator[Web]:
    """A service that takes large files."""
    with served(settings.model_copy(update={"max_upload_bytes": 2 * LARGE_BYTES})) as running:
        yield running


def large_log(folder: Path) -> Path:
    """A drive of half an hour with much to say beside its places."""
    rows = [b"%d,%.6f,8.4,%s\n" % (k, 49 + k * 1e-5, b"x" * 10_000) for k in range(LARGE_BYTES // 10_000)]
    path = folder / "large.csv"
    path.write_bytes(HEADER.rstrip(b"\n") + b",note\n" + b"".join(rows))
    return path


def test_a_large_file_goes_on_where_the_connection_broke(roomy: Web, tab: Tab, tmp_path: Path) -> None:
    """Also over a reload of the page, when the same file is chosen again."""
    tab.expected += ["net::ERR_"]
    parts: list[tuple[str, int]] = []

    def fault(route: Any) -> None:
        request = route.request
        offset = int(request.headers.get("upload-offset", -1))
        parts.append((request.method, offset))
        if request.method == "PATCH" and offset > 0 and not over.is_set():
            route.abort("connectionreset")
        else:
            route.fallback()

    over = threading.Event()
    tab.page.route("**/v1/uploads/*", fault)
    opened(tab, roomy)
    choose(tab, large_log(tmp_path))
    row(tab, "large.csv").get_by_text("No connection: it goes on by itself from 8.").wait_for()
    tab.page.on("dialog", lambda dialog: dialog.accept())
    tab.page.reload(wait_until="networkidle")
    over.set()
    parts.clear()
    choose(tab, tmp_path / "large.csv")
    row(tab, "large.csv").get_by_text("Waits to be computed").wait_for()
    assert [one for one in parts if one[0] != "GET"] == [
        ("HEAD", -1),
        ("PATCH", 8 << 20),
        ("PATCH", 16 << 20),
    ]
    (drive,) = roomy.client.get("/v1/drives").json()["drives"]
    assert drive["filename"] == "large.csv"
    assert tab.page.evaluate("sessionStorage['versant:parts']") == "{}"
    assert roomy.client.get(f"/v1/drives/{drive['id']}/log").content == (tmp_path / "large.csv").read_bytes()


def test_a_large_file_is_taken_back_or_sent_at_once_where_too_many_are_under_way(
    roomy: Web, tab: Tab, tmp_path: Path
) -> None:
    asked: list[tuple[str, str]] = []
    tab.expected += ["409", "net::ERR_"]
    tab.page.on("request", lambda request: asked.append((request.method, request.url.rpartition("/v1/")[2])))
    tab.page.route(
        "**/v1/uploads/*",
        lambda route: route.abort() if route.request.method == "PATCH" else route.fallback(),
    )
    opened(tab, roomy)
    choose(tab, large_log(tmp_path))
    row(tab, "large.csv").get_by_text("No connection").wait_for()
    with tab.page.expect_response(lambda answer: answer.request.method == "DELETE") as removed:
        row(tab, "large.csv").get_by_role("button", name="Cancel").click()
    assert removed.value.status == 204
    tus = {"Tus-Resumable": "1.0.0", "Upload-Length": "5"}
    for _ in range(MOST_OPEN):
        assert roomy.client.post("/v1/uploads", headers=tus).status_code == 201
    choose(tab, tmp_path / "large.csv")
    row(tab, "large.csv").get_by_text("Waits to be computed").wait_for()
    assert ("POST", "drives?filename=large.csv") in asked
