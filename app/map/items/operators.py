"""What filters may compute and compare: each operator of CQL2 with its SQL, and what passes between them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

NUMBERS = {"integer", "number"}
COMPARED = {"=": "=", "<>": "<>", "<": "<", "<=": "<=", ">": ">", ">=": ">="}
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
    "s_intersects": "ST_Intersects",
    "s_equals": "ST_Equals",
    "s_touches": "ST_Touches",
    "s_within": "ST_Within",
    "s_overlaps": "ST_Overlaps",
    "s_crosses": "ST_Crosses",
    "s_contains": "ST_Contains",
}
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
FUNCTIONS = ("casei", "accenti", *SPATIAL, "s_disjoint", *TEMPORAL)


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
    return f"the {kind} {value.literal!r}" if value.is_literal else f"a {kind}"


def ends_in_escape(text: str) -> bool:
    return (len(text) - len(text.rstrip("\\"))) % 2 == 1
