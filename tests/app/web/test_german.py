"""In German, what the service says of files and drives is German as well."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from app.roads.imports import import_roads
from browser_fixtures import Tab, named
from processing_support import HEADER
from web_fixtures import Web

ENGLISH = re.compile(r"\b(?:the|of|and|is|are|this|that|which|with|they|its|has|no|not|to|were|Record)\b")
ROWS = b"".join(b"%d,%.5f,8.4\n" % (1_700_000_000 + k, 49 + k * 1e-4) for k in range(40))


def english(said: str) -> list[str]:
    """Lines with words of English, without what stands in backquotes and identifiers such as ``no-match``."""
    lines = re.sub(r"`[^`]*`|\b\w+(?:-\w+)+\b", "", said).splitlines()
    return [line for line in lines if ENGLISH.search(line)]


def test_remarks_failures_and_refusals_of_sample_files(
    web: Web, tab_maker: Any, files: Path, computing: None, tmp_path: Path
) -> None:
    import_roads(web.sessions, files / "town.osm", tmp_path / "dem")
    tab: Tab = tab_maker(locale="de-DE")
    tab.expected += ["415", "422"]
    tab.page.goto(f"{web.base}/upload", wait_until="networkidle")
    drive = (files / "0.csv").read_bytes()
    head, *rows = drive.splitlines()
    odd = b"\n".join([head + b",Lattitude", b"x,y", *(line + b",1" for line in rows)])
    sent = {
        "holiday.jpg": b"\xff\xd8\xff" * 300,
        "columns.csv": b"when;Breite;Laenge\n" + ROWS.replace(b",", b";"),
        "far.csv": HEADER + ROWS,
        "early.csv": HEADER + b"0,49,8\n" * 3,
        "plan.gpx": b'<?xml version="1.0"?><gpx version="1.1"><rte><rtept lat="49" lon="8"/></rte></gpx>',
        "good.csv": drive,
        "odd.csv": odd,
    }
    with tab.page.expect_file_chooser() as chooser:
        tab.page.get_by_role("button", name="Dateien auswählen").click()
    chooser.value.set_files([named(name, content) for name, content in sent.items()])
    for name, state in (
        ("holiday.jpg", "refused"),
        ("columns.csv", "refused"),
        ("far.csv", "roads"),
        ("early.csv", "failed"),
        ("plan.gpx", "failed"),
        ("good.csv", "done"),
        ("odd.csv", "done"),
    ):
        tab.page.locator(f".upload-row.{state}").filter(has_text=name).wait_for()
    tab.page.locator(".upload-row summary").evaluate_all("(all) => all.forEach((one) => one.click())")
    said = "\n".join(tab.page.locator(".upload-row").all_inner_texts())
    assert "sieht aus wie ein JPEG-Bild" in said
    assert "Wo diese Fahrt war, sind keine Straßen importiert." in said
    assert english(said) == []
    drives = {one["filename"]: one for one in web.client.get("/v1/drives").json()["drives"]}
    for name in ("early.csv", "odd.csv"):
        tab.page.goto(f"{web.base}/drives/{drives[name]['id']}", wait_until="networkidle")
        where = tab.page.locator(".drive-status.failed" if name == "early.csv" else ".drive-remarks")
        if name == "odd.csv":
            where.locator("summary").click()
        assert english(where.inner_text()) == []
    assert "ausgelassen" in where.inner_text()
    assert tab.faults() == []


def test_what_is_chosen_and_what_there_is_to_read(web: Web, tab_maker: Any) -> None:
    tab: Tab = tab_maker(locale="de-DE")
    page = tab.page
    page.goto(f"{web.base}/upload", wait_until="networkidle")
    page.locator("details.method > summary").first.click()
    form = page.locator(".method-form")
    form.wait_for()
    chosen = form.get_by_label("Verfahren")
    for name in ("particle", "odometer-map", ""):
        chosen.select_option(name)
        form.locator("details > summary").first.click()
        assert english(form.inner_text()) == []
    page.goto(f"{web.base}/docs", wait_until="networkidle")
    books = page.locator(".books").all_inner_texts()
    assert len(books) > 3
    assert english("\n".join(books)) == []
    page.get_by_label("Anleitungen und API durchsuchen").fill("sicherungen zertifikate")
    assert page.locator(".books li").all_inner_texts() == [
        "Ins Internet stellen\n\nEine Maschine, ein Name, Zertifikate, Sicherungen."
    ]
    assert tab.faults() == []
