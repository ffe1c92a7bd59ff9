"""The table: a state has a name, the number that it belongs to, a service, and a function that brings a page there.

That function says what must then be true, in the reader's language. What is true of every state is in ``rules``.
"""

from __future__ import annotations

import itertools
import json
import re
import uuid
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from browser_fixtures import Tab
from source_tree import REPOSITORY
from web_fixtures import Web

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page

TEXTS = REPOSITORY / "app" / "web" / "src" / "texts"
SIZES = {"desk": (1280, 800), "phone": (390, 844)}
LOCALES = {"de": "de-DE", "en": "en-GB"}
HOLE = re.compile(r"\\\{\w+\\\}")


@dataclass(frozen=True)
class Combination:
    """How somebody looks at a page."""

    size: str
    theme: str
    language: str

    @property
    def name(self) -> str:
        return f"{self.size}-{self.theme}-{self.language}"

    @property
    def options(self) -> dict[str, Any]:
        width, height = SIZES[self.size]
        viewport = {"width": width, "height": height}
        return {"viewport": viewport, "color_scheme": self.theme, "locale": LOCALES[self.language]}


COMBINATIONS = [Combination(*parts) for parts in itertools.product(SIZES, ("light", "dark"), LOCALES)]


def usual(number: int) -> tuple[Combination, Combination]:
    """What `make test` tries the state of this number in: each size, theme and language once, from the next on in other
    company."""
    first = number % (len(COMBINATIONS) // 2)
    return COMBINATIONS[first], COMBINATIONS[-1 - first]


@cache
def texts_of(language: str) -> Mapping[str, Any]:
    """The texts of the pages."""
    texts: dict[str, Any] = json.loads((TEXTS / f"{language}.json").read_text(encoding="utf-8"))
    return texts


def leaves(texts: Mapping[str, Any]) -> Iterator[str]:
    """Every form of every text."""
    for one in texts.values():
        if isinstance(one, str):
            yield one
        else:
            yield from leaves(one)


@dataclass
class Service:
    """A service that states are looked at in, and what is where in it."""

    web: Web
    places: dict[str, Any]

    def drive(self, name: str) -> str:
        """The address of the page of a drive that was made under this name."""
        return f"/drives/{uuid.UUID(str(self.places[name]))}"


@dataclass
class Look:
    """A tab in which somebody looks at a service."""

    tab: Tab
    service: Service
    how: Combination

    @property
    def page(self) -> Page:
        return self.tab.page

    @property
    def main(self) -> Locator:
        return self.tab.page.locator("main")

    @property
    def is_phone(self) -> bool:
        return self.how.size == "phone"

    @property
    def nth(self) -> int:
        """Another number in each combination: what one uploads is new in each."""
        return COMBINATIONS.index(self.how)

    def t(self, key: str, **values: object) -> str:
        """A text in the reader's language; forms go by ``n``."""
        return filled(self._form(key, values), values)

    def like(self, key: str, **values: object) -> re.Pattern[str]:
        """The same where only some of its values are known."""
        known = re.escape(filled(self._form(key, values), values))
        return re.compile(HOLE.sub(".+", known))

    def _form(self, key: str, values: Mapping[str, object]) -> str:
        found: Any = texts_of(self.how.language)
        for part in key.split("."):
            found = found[part]
        return str(found if isinstance(found, str) else found["one" if values.get("n") == 1 else "other"])

    def figure(self, written: str) -> str:
        """Decimals as the reader writes them."""
        return written.replace(".", ",") if self.how.language == "de" else written

    def go(self, path: str) -> Page:
        self.page.goto(self.service.web.base + path)
        return self.page


def filled(form: str, values: Mapping[str, object]) -> str:
    for name, value in values.items():
        form = form.replace(f"{{{name}}}", str(value))
    return form


Bring = Callable[[Look], None]


@dataclass(frozen=True)
class State:
    """What a page shows at some time."""

    name: str
    number: str
    """Of the list of what pages are to show, in docs/contributing/pages.md."""
    service: str
    bring: Bring


STATES: dict[str, State] = {}


def state(number: str, service: str) -> Callable[[Bring], Bring]:
    """Put a state into the table: the function brings a page there, and asserts what must be true."""

    def put(bring: Bring) -> Bring:
        name = bring.__name__.replace("_", "-")
        assert name not in STATES, name
        STATES[name] = State(name, number, service, bring)
        return bring

    return put
