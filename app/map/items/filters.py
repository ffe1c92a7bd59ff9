"""Turns the tree of a CQL2 filter into a condition in SQL: names become expressions, values parameters.

Nothing of what was sent becomes part of a statement but in these two ways. Comparisons with the unknown are neither
true nor false, as in SQL.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

from app.core.errors import BadQueryError
from app.core.messages import say
from app.map.items import cql
from app.map.items.collections import GEOMETRY, Collection
from app.map.items.paging import MAX_ID
from app.map.items.places import Condition, Crs, interval, moment, span, wkb_of
from app.map.segment import SQL_TYPES
from fusion.messages import message_of

MOST_NODES = 2000
MOST_LISTED = 1000
MOST_SQL_CHARACTERS = 200_000
"""Of the condition. With these parts it stays below; an operator that wrote an operand twice would not."""


def _bare(error: ValueError | BadQueryError) -> str:
    """What is wrong with a geometry; of a box without the field's name."""
    return str(error).removeprefix("bbox: ") if isinstance(error, BadQueryError) else message_of(error)


class _Compiler:
    """Goes over one tree once; where it is, is kept for what it says of mistakes."""

    def __init__(self, collection: Collection, crs: Crs, text: str, language: str) -> None:
        self.values: dict[str, Any] = {}
        self._collection = collection
        self._crs = crs
        self._text = text
        self._language = language
        self._path: list[str] = []
        self._nodes = 0

    def condition(self, node: Any) -> str:
        """A truth value."""
        value = self._value(node)
        if value.kind != "boolean":
            raise self._error(say("filter.no_condition", kind=value.kind))
        return self._sql(value)

    def _error(self, reason: str, about: str | None = None) -> BadQueryError:
        """Say what is wrong, and where: in JSON the way to it, in text where what it is about stands."""
        where = ""
        if self._language == cql.JSON:
            where = say("filter.at_step", step="".join(self._path).lstrip(".")) if self._path else ""
        elif about is not None and (match := re.search(rf"(?<![\w']){re.escape(about)}(?!\w)", self._text)):
            where = say("filter.at", n=match.start() + 1)
        return BadQueryError.about("filter", say("filter.wrong", reason=reason, where=where))

    def _placeholder(self, value: Any) -> str:
        name = f"f{len(self.values)}"
        self.values[name] = value
        return f"%({name})s"

    def _parameter(self, value: Any, kind: str) -> str:
        return f"CAST({self._placeholder(value)} AS {SQL_TYPES[kind]})"

    def _at(self, step: str, node: Any, reader: Callable[[Any], Any]) -> Any:
        self._path.append(step)
        value = reader(node)
        self._path.pop()
        return value

    def _value(self, node: Any) -> cql.Value:
        self._nodes += 1
        if self._nodes > MOST_NODES:
            raise self._error(say("filter.parts", most=MOST_NODES))
        if isinstance(node, dict):
            return self._of_object(node)
        if node is None:
            return cql.Value("null")
        if isinstance(node, bool):
            return cql.Value("boolean", literal=node)
        if isinstance(node, str):
            return cql.Value("string", literal=node)
        if isinstance(node, int | float):
            return cql.Value("number", literal=self._number(node))
        raise self._error(say("filter.list"))

    def _number(self, value: float) -> float:
        if not math.isfinite(value):
            raise self._error(say("filter.large"))
        if isinstance(value, float) and value.is_integer() and abs(value) <= cql.EXACT:
            return int(value)
        if isinstance(value, int) and abs(value) > MAX_ID:
            return float(value)
        return value

    def _of_object(self, node: dict[str, Any]) -> cql.Value:
        if "op" in node:
            return self._of_operator(str(node["op"]), node.get("args", []))
        if "property" in node:
            return self._property(node["property"])
        if "timestamp" in node:
            return self._time("timestamp", node["timestamp"])
        if "date" in node:
            return self._time("date", node["date"])
        if "interval" in node:
            return self._interval(node["interval"])
        if "type" in node or "bbox" in node:
            return self._geometry(node)
        raise self._error(say("filter.object"))

    def _property(self, name: Any) -> cql.Value:
        if name in {GEOMETRY, "geom"}:
            return cql.Value("line", self._collection.line)
        known = self._collection.properties
        if name not in known:
            raise self._error(
                say("filter.no_property", name=name, names=", ".join([*known, GEOMETRY])), str(name)
            )
        return cql.Value(known[name].kind, known[name].sql)

    def _time(self, word: str, text: Any) -> cql.Value:
        try:
            if not isinstance(text, str) or (word == "date") != (len(text.strip()) == len("2026-11-20")):
                raise ValueError(say("filter.no_kind", text=text, kind=word))
            return cql.Value("time", literal=text, sql=self._parameter(moment(text), "time"))
        except (ValueError, OverflowError) as error:
            raise self._error(message_of(error), str(text)) from error

    def _interval(self, ends: Any) -> cql.Value:
        if not (isinstance(ends, list) and len(ends) == 2):
            raise self._error(say("filter.interval"))
        if all(isinstance(end, str) for end in ends):
            try:
                first, last = interval(*ends)
            except (ValueError, OverflowError) as error:
                raise self._error(message_of(error), "INTERVAL") from error
            start, end = first or "-infinity", last or "infinity"
            return cql.Value("span", self._parameter(start, "time"), end=self._parameter(end, "time"))
        start_sql, end_sql = (self._end(end, n) for n, end in enumerate(ends))
        return cql.Value("span", start_sql, end=end_sql)

    def _read_time(self, value: cql.Value) -> cql.Value:
        """A text that was written where a time stands, as one; anything else as it is."""
        if value.kind != "string" or not value.is_literal:
            return value
        return self._time("timestamp" if "T" in value.literal.upper() else "date", value.literal)

    def _end(self, end: Any, n: int) -> str:
        if end == "..":
            return self._parameter(("-infinity", "infinity")[n], "time")
        value = self._read_time(self._value(end))
        if value.kind != "time":
            raise self._error(say("filter.interval_of", kind=value.kind))
        return value.sql

    def _geometry(self, node: dict[str, Any]) -> cql.Value:
        try:
            wkb = wkb_of(node, self._crs)
        except (ValueError, BadQueryError) as error:
            raise self._error(
                say("filter.geometry", reason=_bare(error)),
                str(node.get("type", "bbox")),
            ) from error
        return cql.Value("line", f"ST_GeomFromWKB({self._placeholder(wkb)}, 4326)")

    def _of_operator(self, written: str, args: Any) -> cql.Value:
        op = written.lower()
        if not isinstance(args, list):
            raise self._error(say("filter.arguments", name=written))
        if op in {"and", "or"}:
            return self._bounded(self._junction(op, args))
        for names, count, reader in self._readers():
            if op in names:
                if len(args) not in count:
                    raise self._error(
                        say(
                            "filter.number_of", name=written, wanted=" or ".join(map(str, count)), n=len(args)
                        ),
                        written,
                    )
                return self._bounded(reader(op, args))
        raise self._error(
            say("filter.no_function", name=written, names=", ".join(cql.FUNCTIONS).upper()), written
        )

    def _bounded(self, value: cql.Value) -> cql.Value:
        if len(value.sql) + len(value.end) > MOST_SQL_CHARACTERS:
            raise self._error(say("filter.sql", most=MOST_SQL_CHARACTERS))
        return value

    def _readers(self) -> list[tuple[Any, tuple[int, ...], Callable[[str, list[Any]], cql.Value]]]:
        return [
            (cql.COMPARED, (2,), self._comparison),
            ({"between"}, (3,), self._comparison),
            ({"not"}, (1,), self._negation),
            ({"isnull"}, (1,), self._unknown),
            ({"in"}, (2,), self._in),
            ({"like"}, (2,), self._like),
            (cql.ARITHMETIC, (2,), self._computation),
            (cql.OF_TEXTS, (1,), self._of_text),
            (cql.SPATIAL, (2,), self._place),
            (cql.TEMPORAL, (2,), self._moments),
        ]

    def _arguments(self, args: list[Any]) -> list[cql.Value]:
        return [self._at(f".args[{n}]", arg, self._value) for n, arg in enumerate(args)]

    def _junction(self, op: str, args: list[Any]) -> cql.Value:
        if len(args) < 2:
            raise self._error(say("filter.two", name=op.upper()))
        parts = [self._at(f".args[{n}]", arg, self.condition) for n, arg in enumerate(args)]
        return cql.Value("boolean", "(" + f" {op.upper()} ".join(parts) + ")")

    def _negation(self, _op: str, args: list[Any]) -> cql.Value:
        return cql.Value("boolean", f"(NOT {self._at('.args[0]', args[0], self.condition)})")

    def _unknown(self, _op: str, args: list[Any]) -> cql.Value:
        (value,) = self._arguments(args)
        return cql.Value("boolean", f"({self._sql(value)} IS NULL)")

    def _comparison(self, op: str, args: list[Any]) -> cql.Value:
        template = cql.COMPARED.get(op, "({0} BETWEEN {1} AND {2})")
        return cql.Value("boolean", template.format(*self._alike(op, self._arguments(args))))

    def _in(self, op: str, args: list[Any]) -> cql.Value:
        if not (isinstance(args[1], list) and 0 < len(args[1]) <= MOST_LISTED):
            raise self._error(say("filter.listed", most=MOST_LISTED), "IN")
        listed = [self._at(f".args[1][{n}]", one, self._value) for n, one in enumerate(args[1])]
        value, *among = self._alike(op, [*self._arguments(args[:1]), *listed])
        # IN would compare one by one with what is no constant, and copy the value for each.
        return cql.Value("boolean", f"({value} = ANY(ARRAY[{', '.join(among)}]))")

    def _like(self, op: str, args: list[Any]) -> cql.Value:
        value, pattern = self._arguments(args)
        if {value.kind, pattern.kind} != {"string"}:
            raise self._error(say("filter.like"), "LIKE")
        if pattern.is_literal and cql.ends_in_escape(pattern.literal):
            raise self._error(say("filter.pattern"), "LIKE")
        return cql.Value("boolean", f"({self._sql(value)} LIKE {self._sql(pattern)})")

    def _computation(self, op: str, args: list[Any]) -> cql.Value:
        values = self._arguments(args)
        if not {value.kind for value in values} <= cql.NUMBERS:
            raise self._error(say("filter.computes", name=op))
        a, b = (
            self._parameter(float(v.literal), "number") if v.is_literal else f"CAST({v.sql} AS float8)"
            for v in values
        )
        return cql.Value("number", cql.ARITHMETIC[op].format(a=a, b=b))

    def _of_text(self, op: str, args: list[Any]) -> cql.Value:
        (value,) = self._arguments(args)
        if value.kind != "string":
            raise self._error(say("filter.takes_text", name=op.upper(), kind=value.kind))
        if value.is_literal and cql.ends_in_escape(value.literal):
            raise self._error(say("filter.text_end"))
        return cql.Value("string", cql.OF_TEXTS[op].format(a=self._sql(value)))

    def _place(self, op: str, args: list[Any]) -> cql.Value:
        first, second = self._arguments(args)
        if {first.kind, second.kind} != {"line"}:
            raise self._error(say("filter.geometries", name=op.upper(), line=GEOMETRY), op)
        return cql.Value("boolean", cql.SPATIAL[op].format(a=first.sql, b=second.sql))

    def _moments(self, op: str, args: list[Any]) -> cql.Value:
        (a0, a1), (b0, b1) = (self._ends(op, value) for value in self._arguments(args))
        return cql.Value("boolean", f"({cql.TEMPORAL[op].format(a0=a0, a1=a1, b0=b0, b1=b1)})")

    def _ends(self, op: str, value: cql.Value) -> tuple[str, str]:
        """Beginning and end of a time, as SQL: a date is a day, a timestamp what its digits leave open."""
        if value.kind == "span":
            return value.sql, value.end
        value = self._read_time(value)
        if value.kind != "time":
            raise self._error(say("filter.times", name=op.upper()), op)
        if not value.is_literal:
            return value.sql, value.sql
        first, last = span(value.literal)
        return self._parameter(first, "time"), self._parameter(last, "time")

    def _alike(self, op: str, values: list[cql.Value]) -> list[str]:
        """The SQL of values that are compared with each other, of one kind."""
        kinds = {value.kind for value in values}
        if "null" in kinds:
            raise self._error(say("filter.null"), "NULL")
        if kinds == {"time", "string"}:
            values = [self._time_of(value) for value in values]
            kinds = {"time"}
        if kinds <= cql.NUMBERS:
            return [self._sql(value, whole=cql.whole_numbers(values)) for value in values]
        if (
            len(kinds) > 1
            or kinds & {"line", "span"}
            or (kinds == {"boolean"} and op not in {"=", "<>", "in"})
        ):
            raise self._error(
                say(
                    "filter.unlike",
                    name=op.upper(),
                    a=cql.describe(values[0]),
                    b=cql.describe(values[1]),
                )
            )
        return [self._sql(value) for value in values]

    def _time_of(self, value: cql.Value) -> cql.Value:
        if value.kind == "time":
            return value
        if not value.is_literal:
            raise self._error(say("filter.time_text"))
        return self._time("timestamp" if ":" in value.literal else "date", value.literal)

    def _sql(self, value: cql.Value, *, whole: bool = False) -> str:
        if value.sql or not value.is_literal:
            return value.sql or "NULL"
        if value.kind == "number":
            if isinstance(value.literal, float) and value.literal.is_integer() and whole:
                raise self._error(
                    say(
                        "filter.not_exact",
                        value=value.literal,
                        most=cql.EXACT,
                        json=cql.JSON,
                        most_json=MAX_ID,
                    )
                )
            exact = isinstance(value.literal, int) and whole
            return self._parameter(
                value.literal if exact else float(value.literal), "integer" if exact else "number"
            )
        return self._parameter(value.literal, value.kind)


def filter_condition(text: str, language: str, crs: Crs, collection: Collection) -> Condition:
    """The condition of a filter in ``cql2-text`` or ``cql2-json`` whose geometries are in a reference system.

    Raises ``BadQueryError`` that says what is wrong, where, and what there is.
    """
    compiler = _Compiler(collection, crs, text, language)
    return Condition(compiler.condition(cql.parse_filter(text, language)), compiler.values)
