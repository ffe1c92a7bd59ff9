"""Words that the glossary replaces appear nowhere, neither in texts nor in identifiers."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from source_tree import REPOSITORY

GLOSSARY = REPOSITORY / "docs" / "glossary.md"
LOOKED_AT = ("app", "fusion", "docs", "tests", "benchmarks")
ENDINGS = {".py", ".md", ".ts", ".tsx", ".html", ".sql", ".css", ".ipynb", ".json"}
LEFT_OUT = ("app/web/built/", "app/web/openapi.json", "app/web/src/api/", "docs/_build/")
"""What is built, or made from other sources. Migrations are not looked at: they keep the words of their day."""
LISTS = ("docs/glossary.md", "tests/test_glossary.py")
"""These name the words in order to forbid them."""
FOREIGN = {"node_modules", "__pycache__"}
SPLIT = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|_")
CODE = re.compile(r"`([^`]+)`")


class Exceptions(NamedTuple):
    """Where a word may stand: files by the beginning of their path, and phrases that hold it."""

    paths: tuple[str, ...]
    phrases: tuple[str, ...]


def rows(heading: str) -> list[list[str]]:
    """The cells of the table below a heading of the glossary."""
    section = GLOSSARY.read_text(encoding="utf-8").partition(f"## {heading}\n")[2].partition("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def replaced_words() -> list[str]:
    """Every word of the "instead of" column, and of the sentence below the table."""
    below = re.findall(r"^Of no single word.*$", GLOSSARY.read_text(encoding="utf-8"), re.MULTILINE)
    return [word for text in [*(row[2] for row in rows("Words")), *below] for word in CODE.findall(text)]


@cache
def exceptions_of(word: str) -> Exceptions:
    allowed = [
        item for row in rows("Exceptions") if word in CODE.findall(row[0]) for item in CODE.findall(row[1])
    ]
    paths = [item for item in allowed if item.split("/")[0] in LOOKED_AT]
    return Exceptions(tuple(paths), tuple(item for item in allowed if item not in paths))


@cache
def texts() -> dict[str, str]:
    """The text of every file that is looked at, by its path."""
    found = {}
    for folder in LOOKED_AT:
        for path in (REPOSITORY / folder).rglob("*"):
            name = path.relative_to(REPOSITORY).as_posix()
            if path.suffix not in ENDINGS or FOREIGN & set(path.parts) or name.startswith(LEFT_OUT + LISTS):
                continue
            found[name] = path.read_text(encoding="utf-8")
    return found


@cache
def lower(text: str) -> str:
    return text.lower()


def places(word: str, name: str, text: str) -> list[str]:
    """``path:line: text`` of each line with the word. Phrases in which it may stand are taken out beforehand."""
    allowed = exceptions_of(word)
    if name.startswith(allowed.paths) or word.split(maxsplit=1)[0].lower() not in lower(text):
        return []
    for phrase in allowed.phrases:
        text = re.sub(re.escape(phrase), "", text, flags=re.IGNORECASE)
    identifier = word != word.lower()
    plain = text if identifier else SPLIT.sub(" ", text)
    gap = r"\s+(?:#\s*)?"  # a phrase may go on in the next line, of a comment too
    pattern = rf"(?<![A-Za-z]){gap.join(map(re.escape, word.split()))}(?![A-Za-z])"
    lines = {
        plain.count("\n", 0, m.start())
        for m in re.finditer(pattern, plain, 0 if identifier else re.IGNORECASE)
    }
    return [f"{name}:{line + 1}: {plain.splitlines()[line].strip()[:100]}" for line in sorted(lines)]


@pytest.mark.parametrize("word", replaced_words())
def test_a_replaced_word_appears_nowhere(word: str) -> None:
    hits = [place for name, text in texts().items() for place in places(word, name, text)]
    assert hits == [], f"{len(hits)} lines say {word!r}; docs/glossary.md has the word to use"


def test_the_glossary_is_read() -> None:
    words = replaced_words()
    assert {"jury", "attic", "in vain", "Workbench", "stand back"} <= set(words)
    assert len(words) == len(set(words))
    for row in rows("Exceptions"):
        assert set(CODE.findall(row[0])) <= set(words), row
        assert all((REPOSITORY / path).exists() for path in exceptions_of(CODE.findall(row[0])[0]).paths)


@pytest.mark.parametrize(
    ("word", "text"),
    [
        ("jury", "the jury of a segment"),
        ("jury", "MOST_IN_JURY = 48"),
        ("jury", "juryOf(segment)"),
        ("twins", "def find_twins() -> None: ..."),
        ("stand back", "def stand_back() -> None: ..."),
        ("stand back", "solvers stand\n    back behind uploads"),
        ("squares", "squares of the map"),
        ("square", "square_key = 3"),
        ("Desk", "class Desk:"),
    ],
)
def test_a_word_is_seen_in_texts_and_names(word: str, text: str) -> None:
    assert len(places(word, "app/x.py", text)) == 1


@pytest.mark.parametrize(
    ("word", "name", "text"),
    [
        ("square", "app/x.py", "the root mean square, by least squares; np.square(x); factor.square"),
        ("squares", "app/x.py", "weighted least squares"),
        ("squares", "fusion/network/equations.py", "squares = residuals @ residuals"),
        ("square", "app/x.py", "squared"),
        ("Bench", "app/x.py", "benchmarks, .[bench] and bench.tiles"),
        ("Desk", "app/x.py", "a desk"),
        ("jury", "app/x.py", "injury, perjury"),
    ],
)
def test_other_words_are_left_alone(word: str, name: str, text: str) -> None:
    assert places(word, name, text) == []


def test_files_are_looked_at() -> None:
    names = texts()
    assert {"app/main.py", "fusion/types.py", "docs/index.md", "tests/test_layout.py"} <= names.keys()
    assert not any(Path(name).suffix == ".map" for name in names)
