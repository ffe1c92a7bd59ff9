"""The pages' texts: every language has every text, whole, and every text is used."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from app.map.segment import HEIGHT_DATUM, OSM_ATTRIBUTION, attribution
from source_tree import REPOSITORY

SOURCES = REPOSITORY / "app" / "web" / "src"
LANGUAGES = {path.stem: path for path in sorted((SOURCES / "texts").glob("*.json"))}
PLURALS = {"en": {"one", "other"}, "de": {"one", "other"}}
"""As Intl.PluralRules names the forms of whole numbers."""
NAME = re.compile(r"\{(\w+)\}")
QUOTED = re.compile(r"[\"'`]([a-z_]+(?:\.[\w]+)+)[\"'`]")
MADE = re.compile(r"`([a-z_]+\.[\w.]*\$\{[^`]*)`")
HOLE = re.compile(r"\$\{(?:[^{}]|\{[^{}]*\})*\}")

Text = str | Mapping[str, str]


def leaves(texts: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Text]]:
    for name, one in texts.items():
        if isinstance(one, str) or "other" in one:
            yield before + name, one
        else:
            yield from leaves(one, f"{before}{name}.")


def texts_of(language: str) -> dict[str, Text]:
    return dict(leaves(json.loads(LANGUAGES[language].read_text(encoding="utf-8"))))


ENGLISH = texts_of("en")


def forms(text: Text) -> dict[str, str]:
    return {"other": text} if isinstance(text, str) else dict(text)


def names(text: Text) -> set[str]:
    return {name for form in forms(text).values() for name in NAME.findall(form)}


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_language_has_every_text_and_no_other(language: str) -> None:
    assert texts_of(language).keys() == ENGLISH.keys()


@pytest.mark.parametrize("language", LANGUAGES)
def test_texts_are_whole(language: str) -> None:
    wrong = []
    for key, text in texts_of(language).items():
        if not all(form.strip() == form != "" for form in forms(text).values()):
            wrong.append(f"{key}: empty, or with space at an end")
        if not isinstance(text, str) and set(text) != PLURALS[language]:
            wrong.append(f"{key}: its forms are {sorted(text)}, not {sorted(PLURALS[language])}")
        if names(text) != names(ENGLISH[key]):
            wrong.append(f"{key}: {sorted(names(text))} where English has {sorted(names(ENGLISH[key]))}")
        if isinstance(text, str) is not isinstance(ENGLISH[key], str):
            wrong.append(f"{key}: forms in one language alone")
    assert wrong == []


def scripts() -> list[Path]:
    return [
        path for path in SOURCES.rglob("*.ts*") if ".test." not in path.name and path.parent.name != "api"
    ]


def used(sources: list[str]) -> tuple[set[str], list[re.Pattern[str]]]:
    """Keys that stand in the sources, and patterns of those that are put together (``t(`page.${name}`)``)."""
    written = {key for text in sources for key in QUOTED.findall(text)}
    made = {
        r"[\w.-]+".join(map(re.escape, HOLE.split(one))) for text in sources for one in MADE.findall(text)
    }
    return written, [re.compile(one) for one in made]


def test_every_text_is_used() -> None:
    written, made = used([path.read_text(encoding="utf-8") for path in scripts()])
    idle = [key for key in ENGLISH if key not in written and not any(one.fullmatch(key) for one in made)]
    assert idle == []


def test_an_idle_text_would_be_seen() -> None:
    written, made = used(['t("page.map")', "t(`page.to_${dark ? `a` : b}`)", "t(`docs.${one}.title`)"])
    assert "page.map" in written
    assert not any(one.fullmatch("page.map") for one in made)
    assert any(one.fullmatch("docs.x.title") for one in made)
    assert not any(one.fullmatch("docs.x") for one in made)


def test_sentences_of_the_service_that_pages_say_in_their_language_are_known_as_it_writes_them() -> None:
    words, credit = ((SOURCES / name).read_text("utf-8") for name in ("segment/words.ts", "shared/credit.ts"))
    assert f'"{HEIGHT_DATUM}"' in words
    roads, elevation = attribution(["A"]).split("; elevation from ")
    assert elevation == "A"
    assert roads.startswith(f"Roads {OSM_ATTRIBUTION}")
    assert f'"Roads {OSM_ATTRIBUTION}"' in credit
    assert '"; elevation from "' in credit
