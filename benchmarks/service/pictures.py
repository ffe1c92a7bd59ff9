#!/usr/bin/env python3
"""Pictures of the pages for the README, taken in Chromium from a demonstration of its own.

    make pictures
    PYTHONPATH=.:benchmarks python -m service.pictures [--output docs/images]

The demonstration is that of ``versant demo``: its town, its drives, its database. Writes map.png, drive.png and
dashboard.png.
"""

from __future__ import annotations

import argparse
import io
import shutil
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

from app.cli.children import stop_signals
from app.cli.console import Console
from app.cli.keys.commands import login_address
from app.cli.keys.starting import first_link
from app.demo.files import map_page
from app.demo.run import DemoResult, demo_service, run_demo
from fusion.errors import FusionError

if TYPE_CHECKING:
    from playwright.sync_api import Page

MOST_BYTES = 150_000
SIZE = {"width": 1280, "height": 800}
NAMES = ("chromium", "chromium-browser", "google-chrome", "chromium-headless-shell")
FLAGS = (
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--enable-unsafe-swiftshader",
)
PATIENCE_S, LOOK_EVERY_S = 30.0, 0.7


class PicturesError(FusionError):
    """The pictures cannot be taken."""

    kind = "pictures"


def main() -> None:
    """Run the demonstration, and take a picture of each page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--output", type=Path, default=Path("docs/images"), metavar="DIR", help="where they go"
    )
    folder: Path = parser.parse_args().output
    console = Console()
    try:
        with (
            stop_signals(),
            tempfile.TemporaryDirectory() as made_in,
            demo_service(console) as service,
        ):
            with console.progress() as bars:
                result = run_demo(service, Path(made_in), bars)
            token = first_link(service.settings)
            login = login_address(service.address, token) if token else service.address
            for name, picture in take_pictures(login, addresses(service.address, result)).items():
                content = small(picture)
                (folder / f"{name}.png").write_bytes(content)
                print(f"{folder / name}.png: {len(content) / 1000:.0f} kB")
    except FusionError as error:
        sys.exit(str(error))


def addresses(service: str, result: DemoResult) -> dict[str, str]:
    """Name of a picture -> its page: the map with a steep road that is known well, a drive, the dashboard."""
    segments = [
        f["properties"]
        for f in result.features
        if f["properties"]["slope_percent"] is not None and f["properties"]["drives"] > 1
    ]
    steepest = max(segments, key=lambda p: abs(p["slope_percent"]) - 2 * p["slope_sigma_percent"])
    return {
        "map": f"{service}{map_page(result.features)}&segment={steepest['id']}",
        "drive": f"{service}/drives/{result.drives[0].id}",
        "dashboard": f"{service}/admin",
    }


def take_pictures(login: str, pages: Mapping[str, str]) -> dict[str, bytes]:
    """A picture of each, in light colours and English, once the browser is logged in."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - of the development tools alone

    browser = next((path for name in NAMES if (path := shutil.which(name))), None)
    if browser is None:
        raise PicturesError("Chromium is missing. Install it (Debian: apt-get install chromium).")
    pictures = {}
    with sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=browser, args=list(FLAGS))
        context = started.new_context(viewport=SIZE, locale="en-GB", color_scheme="light")  # type: ignore[arg-type]
        entrance = context.new_page()
        entrance.goto(login)
        entrance.wait_for_url(lambda address: "/login" not in address)
        entrance.close()
        for name, address in pages.items():
            page = context.new_page()
            page.goto(address)
            page.locator("main").wait_for()
            pictures[name] = settled(page)
            page.close()
        started.close()
    return pictures


def settled(page: Page) -> bytes:
    """The page's picture once it changes no more: pages with streams of events are never done loading."""
    before, deadline = b"", time.monotonic() + PATIENCE_S
    time.sleep(LOOK_EVERY_S)
    while (now := page.screenshot(animations="disabled")) != before and time.monotonic() < deadline:
        before = now
        time.sleep(LOOK_EVERY_S)
    return now


def small(picture: bytes) -> bytes:
    """The same with as many colours as the size allows that the README can bear."""
    image = Image.open(io.BytesIO(picture)).convert("RGB")
    for colours in (256, 128, 64, 32):
        content = io.BytesIO()
        image.quantize(colours, dither=Image.Dither.NONE).save(content, "PNG", optimize=True)
        if content.tell() <= MOST_BYTES:
            break
    return content.getvalue()


if __name__ == "__main__":
    main()
