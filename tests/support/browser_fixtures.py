"""A headless Chromium that reaches this machine alone, and what every page must keep to."""

from __future__ import annotations

import re
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import pytest
from sqlalchemy import text

from processing_support import process_drive
from server_support import wait_until
from web_fixtures import Web

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext, FilePayload, Page

_QUEUED = text("SELECT id, generation FROM drives WHERE status = 'queued' ORDER BY queued_at")
NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
"""The shell first: it draws the same pages by the same engine, without a desktop browser's windows around each."""
FLAGS = (
    "--no-sandbox",  # root has none
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
OWN = re.compile(r"(https?://127\.0\.0\.1[:/]|data:|blob:|about:)")
DRIVERS = "GL Driver Message"
"""Begins what Chromium says of a machine that draws without a graphics card."""
PATIENCE_MS = 20_000
"""Machines are shared; whatever appears sooner is not waited for."""
IMPACTS = ("serious", "critical")
WHITE = """() => {
  const seen = (one) => one.checkVisibility({ visibilityProperty: true, opacityProperty: true });
  return [...document.querySelectorAll('*')].filter((one) => {
    const [red, green, blue, alpha = 1] = getComputedStyle(one).backgroundColor.match(/[\\d.]+/g).map(Number);
    const { width, height } = one.getBoundingClientRect();
    return alpha > 0.3 && Math.min(red, green, blue) > 180 && Math.min(width, height) > 20 && seen(one);
  }).map((one) => `${one.tagName} .${one.className} ${one.textContent.slice(0, 40)}`);
}"""
"""What has a ground that is nearly white."""


@dataclass
class Tab:
    """One page of a browser: what it asked for, and what it complained of."""

    page: Page
    elsewhere: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)
    expected: list[str] = field(default_factory=list)
    """Parts of complaints that a test brings about: an answer 404, say."""

    def hear(self) -> None:
        """Take what the page has said since it was last asked: events wait until the next call of the driver."""
        if not self.page.is_closed():
            self.page.evaluate("0")

    def unexpected(self) -> list[str]:
        """What nobody wanted to see."""
        return [one for one in self.complaints if not any(part in one for part in self.expected)]

    def await_true(self, script: str) -> None:
        """Wait until this is so. The driver's own ``wait_for_function`` has the page evaluate text from the second look
        on, which the pages' policy forbids."""
        wait_until(lambda: bool(self.page.evaluate(script)), within_s=PATIENCE_MS / 1000)

    def white_boxes(self) -> list[str]:
        """What is nearly white: in the dark nothing is."""
        found: list[str] = self.page.evaluate(WHITE)
        return found

    def faults(self) -> list[str]:
        """What axe-core finds that is serious or critical, a line each."""
        from axe_playwright_python.sync_playwright import Axe  # noqa: PLC0415

        found = Axe().run(self.page).response["violations"]
        return [
            f"{one['id']}: {node['target']} {node['failureSummary']}"
            for one in found
            if one["impact"] in IMPACTS
            for node in one["nodes"]
        ]


def chromium_path() -> str:
    """The browser of this machine; skips where there is none."""
    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip(
            "Chromium is missing: install Debian's package chromium-headless-shell to test the pages."
        )
    return found


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One Chromium for the tests of a module: while its driver is there, no other loop of asyncio runs in a process."""
    path = chromium_path()
    from playwright.sync_api import expect, sync_playwright  # noqa: PLC0415

    expect.set_options(timeout=PATIENCE_MS)
    with sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=path, args=list(FLAGS))
        yield started
        started.close()


@contextmanager
def opened(browser: Browser, **options: Any) -> Iterator[Tab]:
    """A tab with storage of its own; whatever is asked of another host is refused and noted."""
    context: BrowserContext = browser.new_context(**{"locale": "en-GB", "timezone_id": "UTC", **options})
    context.set_default_timeout(PATIENCE_MS)
    tab = Tab(context.new_page())

    def look(route: Any) -> None:
        if OWN.match(route.request.url):
            route.continue_()
        else:
            tab.elsewhere.append(route.request.url)
            route.abort()

    context.route("**/*", look)
    tab.page.on("pageerror", lambda error: tab.complaints.append(f"error: {error}"))
    tab.page.on(
        "console",
        lambda said: (
            tab.complaints.append(said.text)
            if said.type in ("error", "warning") and DRIVERS not in said.text
            else None
        ),
    )
    try:
        yield tab
    finally:
        context.close()


@pytest.fixture
def tab_maker(browser: Browser) -> Iterator[Callable[..., Tab]]:
    """Makes tabs, each with options of Playwright's contexts; none may end with a complaint or have asked elsewhere."""
    made: list[Tab] = []
    with ExitStack() as stack:

        def make(**options: Any) -> Tab:
            made.append(stack.enter_context(opened(browser, **options)))
            return made[-1]

        yield make
        for tab in made:
            tab.hear()
            if tab.elsewhere or tab.unexpected():
                pytest.fail(f"The page asked for {tab.elsewhere} and complained: {tab.unexpected()}")


@pytest.fixture
def tab(tab_maker: Callable[..., Tab]) -> Tab:
    """A tab as on a desk."""
    return tab_maker(viewport={"width": 1280, "height": 800})


def named(name: str, content: bytes) -> FilePayload:
    """A file to choose."""
    return {"name": name, "mimeType": "", "buffer": content}


@contextmanager
def drives_computed(web: Web, first: Callable[[], object] = lambda: None) -> Iterator[None]:
    """A worker beside the service, as far as drives are concerned; ``first`` it does before it looks for some."""
    over = threading.Event()

    def work() -> None:
        while not over.wait(0.05):
            first()
            with web.sessions() as session:
                waiting = session.execute(_QUEUED).all()
            for drive_id, generation in waiting:
                process_drive(web.context, drive_id, generation)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
