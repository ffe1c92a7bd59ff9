"""A service that asks for keys, and who logs in there."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from app.access import store
from app.core.caller import OPERATOR_OWNER, Scope
from app.core.settings import Settings
from browser_fixtures import Tab, drives_computed
from source_tree import REPOSITORY
from web_fixtures import Web, served

TEXTS = REPOSITORY / "app" / "web" / "src" / "texts"
LOCALES = {"en": "en-GB", "de": "de-DE"}


@pytest.fixture
def computing(web: Web) -> Iterator[None]:
    """A worker beside the service, as far as drives are concerned."""
    with drives_computed(web):
        yield


@pytest.fixture
def asking(settings: Settings, request: pytest.FixtureRequest) -> Iterator[Web]:
    """An empty service that asks for keys; its map is public, unless a test asks for `off`."""
    public_map = getattr(request, "param", "live")
    with served(settings.model_copy(update={"access": "keys", "public_map": public_map})) as running:
        yield running


@pytest.fixture
def key_maker(asking: Web) -> Callable[..., str]:
    """Makes keys of the service, and their owners, where they are not there: returns the secret."""

    def make(label: str, scope: Scope, owner: str | None = None) -> str:
        with asking.sessions.begin() as session:
            owner_id = OPERATOR_OWNER
            if owner is not None:
                owner_id = (store.owner_named(session, owner) or store.create_owner(session, owner)).id
            return store.create_key(session, owner_id, label, scope)[1]

    return make


@pytest.fixture(params=sorted(LOCALES))
def words(request: pytest.FixtureRequest) -> dict[str, Any]:
    """The texts of the pages in each language, and under `locale` what a browser asks for them by."""
    texts: dict[str, Any] = json.loads((TEXTS / f"{request.param}.json").read_text(encoding="utf-8"))
    return {**texts, "locale": LOCALES[request.param]}


@pytest.fixture
def enter(asking: Web) -> Callable[[Tab, str], None]:
    """Logs a tab in on the page that it shows, or on the page for it."""

    def log_in(tab: Tab, key: str) -> None:
        if "/login" not in tab.page.url:
            tab.page.goto(f"{asking.base}/login")
        tab.page.locator("form input[type=password]").fill(key)
        tab.page.keyboard.press("Enter")
        tab.page.wait_for_url(re.compile(r"^(?!.*/login)"))

    return log_in
