"""The page at the root, for people: their language and colours, and every link without a script."""

from __future__ import annotations

import re
from typing import Any

import pytest

PAGE = {"Accept": "text/html"}


@pytest.mark.parametrize(
    ("accepted", "language"),
    [
        ("", "en"),
        ("de-DE,de;q=0.9,en;q=0.8", "de"),
        ("en-GB,en;q=0.9,de;q=0.8", "en"),
        ("fr,de;q=0.5", "de"),
        ("fr", "en"),
        ("*;q=x,,", "en"),
    ],
)
def test_the_browser_says_the_language(reading: Any, accepted: str, language: str) -> None:
    answer = reading.client.get("/", headers={**PAGE, "Accept-Language": accepted})
    assert f'<html lang="{language}">' in answer.text
    assert ("Hochladen" in answer.text) == (language == "de")
    assert answer.headers["content-language"] == language
    assert "Accept-Language" in answer.headers["vary"]


def test_a_choice_is_kept_by_the_links(reading: Any) -> None:
    answer = reading.client.get("/", params={"lang": "de", "theme": "dark"}, headers=PAGE)
    assert '<html lang="de" data-theme="dark">' in answer.text
    for address in ("/map?lang=de", "/?lang=en&amp;theme=dark", "/?lang=de&amp;theme=light"):
        assert f'href="{address}"' in answer.text
    for other in ({"lang": "xx"}, {"theme": "blue"}, {"language": "de"}):
        assert reading.client.get("/", params=other, headers=PAGE).status_code in (400, 422)


def test_programs_read_the_same_as_ever(reading: Any) -> None:
    document = reading.client.get("/", headers={"Accept-Language": "de"}).json()
    assert document == reading.client.get("/").json()
    assert document["title"] == "Versant"


def test_its_sign_may_be_shown(reading: Any) -> None:
    answer = reading.client.get("/", headers=PAGE)
    (sign,) = set(re.findall(r'url\("(/web/[^"]+)"\)', answer.text))
    assert reading.client.get(sign).headers["content-type"].startswith("image/svg")
    assert "img-src 'self'" in answer.headers["content-security-policy"]


@pytest.mark.parametrize(
    "name", ["map", "upload", "drives", "admin", "keys", "owner", "login", "record", "drives/1"]
)
def test_a_page_without_scripts_leads_on(reading: Any, name: str) -> None:
    without = re.search("<noscript>(.*?)</noscript>", reading.client.get(f"/{name}").text)
    assert without is not None
    links = re.findall('href="([^"]+)"', without[1])
    assert links
    for address in links:
        answer = reading.client.get(address, headers=PAGE)
        assert answer.status_code == 200
        assert answer.headers["content-type"].startswith("text/html")
