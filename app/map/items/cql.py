"""Reads a filter in CQL2, text or JSON, into the tree that the standard's JSON describes. Knows no property.

The grammar is a library's (``cql2``). It descends into itself for every bracket and sign, so what is too long or too
deep is refused before it sees it.
"""

from __future__ import annotations

import json
import re
from typing import Any, NoReturn

import cql2

from app.core.errors import BadQueryError

TEXT, JSON = "cql2-text", "cql2-json"
LANGUAGES = (TEXT, JSON)
LONGEST_CHARACTERS = 64_000
DEEPEST = 32
MOST_OPERATORS = 250
EXACT = 2**53 - 1
"""Up to here every whole number in a text is read exactly."""
NO_TEXT = re.compile("[\0\ud800-\udfff]")
"""What no text of PostgreSQL holds: NUL, and halves of characters."""

_QUOTED = re.compile(r"'(?:[^']|'')*'|\"[^\"]*\"")
_COORDINATES = re.compile(r"\(\s*[-+\d.eE,\s]*\)")
_OPERATORS = re.compile(r"<>|!=|<=|>=|[-+*/%^=<>]|\b(?:NOT|DIV|LIKE|BETWEEN|IN|IS|AND|OR)\b", re.IGNORECASE)
_PLACE = re.compile(r"--> (\d+):(\d+)")
_EXPECTED = re.compile(r"= expected (.+)$", re.DOTALL)


def parse_filter(text: str, language: str) -> Any:
    """The tree of a filter: dicts, lists, texts, numbers, truth values. Raises ``BadQueryError``."""
    if len(text) > LONGEST_CHARACTERS:
        refuse(f"it has {len(text)} characters; there may be {LONGEST_CHARACTERS}")
    if found := NO_TEXT.search(text):
        refuse(f"character {found.start() + 1} cannot be part of a text")
    return _of_json(text) if language == JSON else _of_text(text)


def refuse(reason: str) -> NoReturn:
    """Raise ``BadQueryError`` about the filter."""
    raise BadQueryError(f"filter: {reason}.", field="filter")


def _of_text(text: str) -> Any:
    _check_size(text)
    try:
        return cql2.parse_text(text).to_json()
    except cql2.ParseError as error:
        refuse(_told(str(error), text))


def _of_json(text: str) -> Any:
    try:
        # Whole numbers stay exact, which the library's are not.
        tree = json.loads(text, parse_constant=_no_number)
    except RecursionError:
        refuse(f"it is nested deeper than {DEEPEST}")
    except json.JSONDecodeError as error:
        refuse(f"it is no JSON: {error.msg} at character {error.pos + 1}")
    except ValueError as error:
        refuse(str(error))
    check_depth(tree)
    try:
        cql2.parse_json(text)
    except cql2.ParseError as error:
        refuse(
            f"it is JSON but no CQL2 ({error}). An expression is a value, or "
            '{"op": ..., "args": [...]}, or {"property": ...}'
        )
    return tree


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number of JSON")


def check_depth(tree: Any, depth: int = 0) -> None:
    """``BadQueryError`` for a tree deeper than a filter may be; lists of coordinates are four of it at most."""
    if depth > 2 * DEEPEST:
        refuse(f"it is nested deeper than {DEEPEST}")
    inner = tree.values() if isinstance(tree, dict) else tree if isinstance(tree, list) else ()
    for one in inner:
        if isinstance(one, dict | list):
            check_depth(one, depth + 1)


def _check_size(text: str) -> None:
    bare = _COORDINATES.sub("0", _QUOTED.sub("0", text))
    depth = deepest = 0
    for character in bare:
        depth += {"(": 1, ")": -1}.get(character, 0)
        deepest = max(deepest, depth)
    if deepest > DEEPEST:
        refuse(f"its brackets are nested {deepest} deep; they may be {DEEPEST} deep")
    operators = len(_OPERATORS.findall(bare))
    if operators > MOST_OPERATORS:
        refuse(
            f"it has {operators} operators; there may be {MOST_OPERATORS}. A list is shorter: name IN ('a', 'b')"
        )


def _told(said: str, text: str) -> str:
    """What the library says of a text, in one sentence."""
    place, expected = _PLACE.search(said), _EXPECTED.search(said)
    if place is None:
        return "it cannot be read: " + " ".join(said.split())
    line, column = int(place[1]), int(place[2])
    lines = text.split("\n")
    at = sum(len(one) + 1 for one in lines[: line - 1]) + column
    near = lines[line - 1][column - 1 :][:20] if line <= len(lines) else ""
    wanted = f"; expected: {' '.join(expected[1].split())}" if expected else ""
    return f"it cannot be read at character {at}, {f'near {near!r}' if near else 'the end'}{wanted}"
