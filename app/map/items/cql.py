"""Filters in CQL2: what operators they may have, each with its SQL, and the tree of a text or of JSON.

Knows no property. The grammar is a library's (``cql2``). It descends into itself for every bracket and sign, so what is
too long or too deep is refused before it sees it; and so do those who read the tree, so of that the depth is bounded
too.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NoReturn

import cql2

from app.core.errors import BadQueryError
from app.core.messages import say
from fusion.messages import message_of

TEXT, JSON = "cql2-text", "cql2-json"
LANGUAGES = (TEXT, JSON)
LONGEST_CHARACTERS = 64_000
DEEPEST = 32
"""Operators, or brackets, inside each other."""
MOST_OPERATORS = 250
MOST_EFFORT = 400_000
"""Characters that the parser looks at, again and again where brackets are inside each other."""
EXACT = 2**53 - 1
"""Up to here every whole number in a text is read exactly."""
NO_TEXT = re.compile("[\0\ud800-\udfff]")
"""What no text of PostgreSQL holds: NUL, and halves of characters."""

_QUOTED = re.compile(r"'(?:[^']|'')*'|\"[^\"]*\"")
_COORDINATES = re.compile(r"\([-+\d.eE,\s]*\)")
_OPERATORS = re.compile(r"<>|!=|<=|>=|[-+*/%^=<>]|\b(?:NOT|DIV|LIKE|BETWEEN|IN|IS|AND|OR)\b", re.IGNORECASE)
_BRACKETS = re.compile(r"(?P<word>\b[^\W\d]\w*)?\(|\)")
_NO_FUNCTIONS = {"NOT", "DIV", "LIKE", "BETWEEN", "IN", "IS", "AND", "OR"}
_PLACE = re.compile(r"--> (\d+):(\d+)")
_EXPECTED = re.compile(r"= expected (.+)$", re.DOTALL)


def parse_filter(text: str, language: str) -> Any:
    """The tree of a filter: dicts, lists, texts, numbers, truth values. Raises ``BadQueryError``."""
    if len(text) > LONGEST_CHARACTERS:
        refuse(say("filter.characters", n=len(text), most=LONGEST_CHARACTERS))
    if forbidden := NO_TEXT.search(text):
        refuse(say("filter.no_character", n=forbidden.start() + 1))
    return _of_json(text) if language == JSON else _of_text(text)


def refuse(reason: str) -> NoReturn:
    """Raise ``BadQueryError`` about the filter."""
    raise BadQueryError.about("filter", say("filter.reason", reason=reason))


def _of_text(text: str) -> Any:
    _check_size(text)
    try:
        tree = cql2.parse_text(text).to_json()
    except Exception as error:  # of a geometry that ends early the library raises no class of its own
        refuse(_reason(str(error), text))
    _check_depth(tree)
    return tree


def _of_json(text: str) -> Any:
    try:
        # Whole numbers stay exact, which the library's are not.
        tree = json.loads(text, parse_constant=_no_number)
    except RecursionError:
        refuse(say("filter.nested", most=DEEPEST))
    except json.JSONDecodeError as error:
        refuse(say("filter.no_json", error=error.msg, n=error.pos + 1))
    except ValueError as error:
        refuse(message_of(error))
    _check_depth(tree)
    try:
        cql2.parse_json(text)
    except Exception as error:  # as above
        refuse(say("filter.no_cql", error=error))
    return tree


def _no_number(name: str) -> NoReturn:
    raise ValueError(say("filter.no_json_number", name=name))


def _check_depth(tree: Any) -> None:
    """``BadQueryError`` for a tree that is too deep: an operator and its list of arguments are two levels."""
    level = [tree]
    for _ in range(2 * DEEPEST + 2):
        level = [one for one in level if isinstance(one, dict | list)]
        level = [one for some in level for one in (some.values() if isinstance(some, dict) else some)]
    if level:
        refuse(say("filter.deep", most=DEEPEST))


def _check_size(text: str) -> None:
    # As long as before: what stands in them is read as often as all else.
    bare = _COORDINATES.sub(_blank, _QUOTED.sub(_blank, text))
    effort = _effort(bare)
    if effort > MOST_EFFORT:
        refuse(say("filter.brackets_effort", n=effort, most=MOST_EFFORT, json=JSON))
    operators = len(_OPERATORS.findall(bare))
    if operators > MOST_OPERATORS:
        refuse(say("filter.operators", n=operators, most=MOST_OPERATORS))


def _blank(match: re.Match[str]) -> str:
    return "0" * len(match[0])


def _effort(bare: str) -> int:
    """How many characters the library's parser may look at.

    It tries what stands in brackets first as an expression and then as a list, brackets inside again in both ways. A
    function's arguments it reads once.
    """
    effort, weight, begin = 0, 1, 0
    weights: list[int] = []
    for bracket in _BRACKETS.finditer(bare):
        effort += weight * (bracket.end() - begin)
        begin = bracket.end()
        if bracket[0] == ")":
            weight = weights.pop() if weights else 1
        else:
            weights.append(weight)
            if len(weights) > DEEPEST:
                refuse(say("filter.brackets", most=DEEPEST))
            weight *= 2 if (bracket["word"] or "NOT").upper() in _NO_FUNCTIONS else 1
    return effort + weight * (len(bare) - begin)


def _reason(message: str, text: str) -> str:
    """What the library says of a text, in one sentence."""
    place, expected = _PLACE.search(message), _EXPECTED.search(message)
    if place is None:
        return say("filter.unreadable", reason=" ".join(message.split()))
    line, column = int(place[1]), int(place[2])
    lines = text.split("\n")
    at = sum(len(one) + 1 for one in lines[: line - 1]) + column
    near = lines[line - 1][column - 1 :][:20] if line <= len(lines) else ""
    wanted = say("filter.expected", what=" ".join(expected[1].split())) if expected else ""
    here = say("filter.near", text=near) if near else say("filter.the_end")
    return say("filter.unreadable_at", n=at, near=here, wanted=wanted)


NUMBERS = {"integer", "number"}
COMPARED = {sign: f"({{0}} {sign} {{1}})" for sign in ("=", "<>", "<", "<=", ">", ">=")}
# Each operand is written once in all of these: what is written twice doubles with every operator inside it.
ARITHMETIC: Mapping[str, str] = {
    "+": "({a} + {b})",
    "-": "({a} - {b})",
    "*": "({a} * {b})",
    "/": "({a} / nullif({b}, 0))",
    "div": "trunc({a} / nullif({b}, 0))",
    # PostgreSQL has no remainder of floating-point numbers.
    "%": "CAST(mod(CAST({a} AS numeric), nullif(CAST({b} AS numeric), 0)) AS float8)",
    "^": "power({a}, {b})",
}
OF_TEXTS: Mapping[str, str] = {
    # The database's own collation may know the letters of English only.
    "casei": 'lower({a} COLLATE "und-x-icu")',
    # A letter and its marks apart, then without those.
    "accenti": "normalize(regexp_replace(normalize({a}, NFD), '[\u0300-\u036f]', '', 'g'), NFC)",
}
SPATIAL: Mapping[str, str] = {
    f"s_{name}": f"ST_{name.capitalize()}({{a}}, {{b}})"
    for name in ("intersects", "equals", "touches", "within", "overlaps", "crosses", "contains")
} | {"s_disjoint": "(NOT ST_Intersects({a}, {b}))"}
# Of two intervals from a0 to a1 and from b0 to b1; a moment begins and ends at once. An end is a column or a value, no
# operator makes one: so what is written twice here has nothing inside.
TEMPORAL: Mapping[str, str] = {
    "t_after": "{a0} > {b1}",
    "t_before": "{a1} < {b0}",
    "t_contains": "{a0} < {b0} AND {a1} > {b1}",
    "t_disjoint": "{a1} < {b0} OR {a0} > {b1}",
    "t_during": "{a0} > {b0} AND {a1} < {b1}",
    "t_equals": "{a0} = {b0} AND {a1} = {b1}",
    "t_finishedby": "{a0} < {b0} AND {a1} = {b1}",
    "t_finishes": "{a0} > {b0} AND {a1} = {b1}",
    "t_intersects": "{a0} <= {b1} AND {a1} >= {b0}",
    "t_meets": "{a1} = {b0}",
    "t_metby": "{a0} = {b1}",
    "t_overlappedby": "{a0} > {b0} AND {a0} < {b1} AND {a1} > {b1}",
    "t_overlaps": "{a0} < {b0} AND {a1} > {b0} AND {a1} < {b1}",
    "t_startedby": "{a0} = {b0} AND {a1} > {b1}",
    "t_starts": "{a0} = {b0} AND {a1} < {b1}",
}
FUNCTIONS = ("casei", "accenti", *SPATIAL, *TEMPORAL)


@dataclass(frozen=True)
class Value:
    """An expression of a kind: ``Property.kind``, or line, span, null."""

    kind: str
    sql: str = ""
    literal: Any = None
    """What was written, where it is a value."""
    end: str = ""
    """Of a span, whose beginning is ``sql``."""

    @property
    def is_literal(self) -> bool:
        return self.literal is not None


def whole_numbers(values: list[Value]) -> bool:
    """Whether whole numbers are compared, so that they are exact and indexes serve."""
    return any(value.kind == "integer" for value in values)


def describe(value: Value) -> str:
    kind = "text" if value.kind == "string" else value.kind
    return (
        say("filter.the_kind", kind=kind, value=value.literal)
        if value.is_literal
        else say("filter.a_kind", kind=kind)
    )


def ends_in_escape(text: str) -> bool:
    return (len(text) - len(text.rstrip("\\"))) % 2 == 1
