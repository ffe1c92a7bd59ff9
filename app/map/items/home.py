"""The page at the root, for people: where everything is, in their language and colours, without a script.

The language is what the browser asks for, or ``lang=``; the colours are the system's, or ``theme=``. Links to the other
pages keep the language.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, cast

from fastapi import Depends, Query, Request

from app.core.query import refuse_unknown
from app.core.text import language_of
from app.map.items import pages

Language = Literal["en", "de"]
Theme = Literal["light", "dark"]
PAGES = ("map", "upload", "drives", "admin", "docs")
CARDS = ("map", "upload", "record", "drives", "admin", "docs")
"""Pages that the root says more of."""
LANGUAGES: Mapping[Language, str] = {"en": "English", "de": "Deutsch"}

_TEXTS: Mapping[Language, Mapping[str, str]] = {
    "en": {
        "map": "Map",
        "map_what": "How steep roads are, and how sure that is.",
        "upload": "Upload",
        "upload_what": "Logs of your vehicle, and what becomes of them.",
        "record": "Record",
        "record_what": "A try-out with a phone's browser, without an app.",
        "drives": "Drives",
        "drives_what": "Every log, its track and its profile.",
        "admin": "Dashboard",
        "admin_what": "What needs a person, the queue, what is measured.",
        "docs": "Documentation",
        "docs_what": "Guides, and everything that programs can ask.",
        "what": "Slopes of roads, measured by vehicles.",
        "pages": "Pages",
        "language": "Language",
        "theme": "Colours",
        "light": "Light",
        "dark": "Dark",
        "programs": "For programs",
    },
    "de": {
        "map": "Karte",
        "map_what": "Wie steil Straßen sind, und wie sicher das ist.",
        "upload": "Hochladen",
        "upload_what": "Aufzeichnungen Ihres Fahrzeugs, und was daraus wird.",
        "record": "Aufzeichnen",
        "record_what": "Zum Ausprobieren mit dem Browser eines Telefons, ohne App.",
        "drives": "Fahrten",
        "drives_what": "Jede Aufzeichnung mit Strecke und Profil.",
        "admin": "Betrieb",
        "admin_what": "Was jemanden braucht, was wartet, was gemessen ist.",
        "docs": "Dokumentation",
        "docs_what": "Anleitungen, und alles, was Programme fragen können (englisch).",
        "what": "Steigungen von Straßen, gemessen von Fahrzeugen.",
        "pages": "Seiten",
        "language": "Sprache",
        "theme": "Farben",
        "light": "Hell",
        "dark": "Dunkel",
        "programs": "Für Programme (englisch)",
    },
}


class Seen:
    """How the page is to be seen."""

    def __init__(
        self, form: pages.Wanted, language: Language, theme: Theme | None, asked: Language | None
    ) -> None:
        """``asked``: the language that the address names, None: the browser's."""
        self.form, self.language, self.theme, self._asked = form, language, theme, asked
        self.texts = _TEXTS[language]

    def here(self, **other: str) -> str:
        """This page with another language or other colours."""
        own = {"f": self.form.asked, "lang": self._asked, "theme": self.theme} | other
        return pages.with_pairs("/", [(name, text) for name, text in own.items() if text])

    def page(self, name: str) -> str:
        """The address of another page, in the language that was asked for."""
        return pages.with_pairs(f"/{name}", [("lang", self._asked)] if self._asked else [])


def _seen(
    request: Request,
    f: pages.FormatQuery = None,
    lang: Annotated[Language | None, Query(description="The language of the page for people.")] = None,
    theme: Annotated[Theme | None, Query(description="Its colours; unset: as the system has them.")] = None,
) -> Seen:
    refuse_unknown(request, {"f", "lang", "theme"})
    form = pages.wanted(request, f, pages.AS_JSON, pages.AS_HTML)
    return Seen(
        form, lang or cast(Language, language_of(request.headers.get("accept-language", ""))), theme, lang
    )


SeenDep = Annotated[Seen, Depends(_seen)]
