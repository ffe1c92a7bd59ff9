"""What a request for items asks for: every parameter is read, checked and turned into a part of a statement here.

Knows no route: parameters come as pairs of name and text, as they stand in the address.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from app.core.errors import BadQueryError
from app.core.messages import say
from app.core.settings import Settings
from app.map.items import places
from app.map.items.collections import GEOMETRY, Collection, Property
from app.map.items.cql import LANGUAGES, NO_TEXT, TEXT
from app.map.items.filters import filter_condition
from app.map.items.paging import MAX_ID, Order, Values, digest_of, parse_after, parse_sortby
from app.map.segment import SQL_TYPES

SHOWN = ("crs", "properties", "skipGeometry", "f")
"""What says how features are shown, not which."""
_PLAIN = (
    "bbox",
    "bbox-crs",
    "limit",
    "datetime",
    "driven",
    "filter",
    "filter-lang",
    "filter-crs",
    "sortby",
    "after",
)
_MOST_VALUES = 100
_TRUTHS = dict.fromkeys(("true", "1", "yes", "on"), True) | dict.fromkeys(("false", "0", "no", "off"), False)
_NUMBERS: Mapping[str, tuple[re.Pattern[str], Callable[[str], float], float]] = {
    "integer": (re.compile(r"[+-]?\d{1,19}", re.ASCII), int, MAX_ID),
    "number": (
        re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d{1,3})?", re.ASCII | re.IGNORECASE),
        float,
        sys.float_info.max,
    ),
}
"""How numbers are written, how they are read, and the largest."""
_WANTED = {"integer": "a whole number", "number": "a number", "boolean": "true or false"}


@dataclass(frozen=True)
class Shape:
    """How a feature is shown."""

    crs: places.Crs = places.CRS84
    properties: tuple[str, ...] = ()
    """Names, in the collection's order."""
    with_line: bool = True
    gaps: bool = False
    table: bool = False
    """Each a row of a table, in place of GeoJSON."""


@dataclass(frozen=True)
class ItemRequest:
    """One page of items that somebody asks for."""

    collection: Collection
    shape: Shape
    limit: int
    conditions: tuple[places.Condition, ...]
    order: Order
    digest: str
    """Tells the query apart from others, whichever page and shape is asked for."""
    after: Values | None = None
    until_xid: int | None = None
    """Of a listing of changes, where its first page ended it."""
    since: datetime | str | None = None
    """Only what changed since a time, or a version of the data."""
    patience_s: float | None = None
    """How long a statement may take; None: as long as any other."""
    filtered: bool = False
    """Whether a filter computes anything."""
    pairs: tuple[tuple[str, str], ...] = ()

    def query(self, **other: str | None) -> list[tuple[str, str]]:
        """The parameters as they came with some of them replaced, or left out where they are None."""
        unchanged = [(name, text) for name, text in self.pairs if name not in other]
        return unchanged + [(name, text) for name, text in other.items() if text is not None]


def item_parameters(collection: Collection) -> tuple[str, ...]:
    """The names of all parameters of a collection's items, those that compare a property last."""
    more = (
        *(("gaps",) if collection.source_with_gaps else ()),
        *(("updated_since",) if collection.follows_changes else ()),
    )
    return (*_PLAIN, *more, *SHOWN, *collection.properties)


def parse_items(collection: Collection, params: Iterable[tuple[str, str]], settings: Settings) -> ItemRequest:
    """What a page of a collection is to be; ``BadQueryError`` names the parameter at fault and what it may be."""
    pairs = tuple(params)
    one, many = _sorted_out(pairs, collection, item_parameters(collection))
    conditions = [_compared(collection.properties[name], texts) for name, texts in many.items()]
    conditions += _plain_conditions(collection, one)
    if "filter" in one:
        conditions.append(_filter(collection, one))
    order = Order(collection, parse_sortby(one["sortby"], collection) if "sortby" in one else ())
    conditions_text = sorted((n, t) for n, t in pairs if n not in {*SHOWN, "limit", "after", "sortby"})
    digest = digest_of(collection.id, order.text, conditions_text)
    until_xid, after = parse_after(one["after"], digest, order) if "after" in one else (None, None)
    return ItemRequest(
        collection=collection,
        shape=_shape(collection, one),
        limit=_limit(one, settings),
        conditions=tuple(conditions),
        order=order,
        digest=digest,
        after=after,
        until_xid=until_xid,
        since=_since(one["updated_since"]) if "updated_since" in one else None,
        patience_s=min(settings.items_timeout_s, settings.statement_timeout_s)
        if conditions or order.keys or "updated_since" in one
        else None,
        filtered="filter" in one,
        pairs=pairs,
    )


def parse_item(collection: Collection, params: Iterable[tuple[str, str]]) -> Shape:
    """How one feature is to be shown. Raises ``BadQueryError``."""
    names = (*SHOWN, *(("gaps",) if collection.source_with_gaps else ()))
    one, _ = _sorted_out(tuple(params), collection, names)
    return _shape(collection, one)


def _sorted_out(
    pairs: Sequence[tuple[str, str]], collection: Collection, names: Sequence[str]
) -> tuple[dict[str, str], dict[str, list[str]]]:
    """The parameters that are there once, and those that compare a property, each with its texts."""
    one: dict[str, str] = {}
    many: dict[str, list[str]] = {}
    for name, text in pairs:
        if name not in names:
            raise BadQueryError(say("query.no_parameter", name=name, names=", ".join(names)), field=name)
        if forbidden := NO_TEXT.search(text):
            raise BadQueryError.about(name, say("items.no_character", n=forbidden.start() + 1))
        if name in collection.properties:
            many.setdefault(name, []).append(text)
        elif name in one:
            raise BadQueryError.about(name, say("items.it_is_twice"))
        else:
            one[name] = text
    return one, many


def _plain_conditions(collection: Collection, one: Mapping[str, str]) -> list[places.Condition]:
    conditions = []
    # Without a bbox it says nothing, and is sent all the same by clients that send every parameter's default.
    crs = places.parse_crs(one["bbox-crs"], "bbox-crs") if "bbox-crs" in one else places.CRS84
    if "bbox" in one:
        conditions.append(places.in_box(collection.line, places.parse_box(one["bbox"], crs)))
    if "datetime" in one:
        first, last = places.parse_datetime(one["datetime"])
        # What has no time matches any (OGC 17-069r4, /req/core/fc-time-response).
        timed = collection.properties["updated_at"].sql
        then = _between(timed, "datetime", first, last)
        conditions.append(places.Condition(f"({timed} IS NULL OR {then.sql})", then.values))
    if "driven" in one:
        conditions.append(places.Condition(collection.driven[_truth(one["driven"], "driven")], {}))
    return conditions


def _between(sql: str, name: str, first: datetime | None, last: datetime | None) -> places.Condition:
    parts, values = [], {}
    for end, operator, suffix in ((first, ">=", "0"), (last, "<=", "1")):
        if end is not None:
            parts.append(f"{sql} {operator} CAST(%({name}{suffix})s AS timestamptz)")
            values[f"{name}{suffix}"] = end
    return places.Condition("(" + " AND ".join(parts) + ")", values)


def _filter(collection: Collection, one: Mapping[str, str]) -> places.Condition:
    language = one.get("filter-lang", TEXT)
    if language not in LANGUAGES:
        raise BadQueryError.about(
            "filter-lang", say("items.no_language", name=language, names=", ".join(LANGUAGES))
        )
    crs = places.parse_crs(one["filter-crs"], "filter-crs") if "filter-crs" in one else places.CRS84
    return filter_condition(one["filter"], language, crs, collection)


def _compared(one: Property, texts: Iterable[str]) -> places.Condition:
    """``name=a,b``: the features whose property is any of these."""
    listed = [part for text in texts for part in text.split(",")]
    if len(listed) > _MOST_VALUES:
        raise BadQueryError.about(one.name, say("items.most_values", most=_MOST_VALUES))
    name = f"p_{one.name}"
    if one.kind == "time":
        try:
            spans = [places.span(text) for text in listed]
        except (ValueError, OverflowError) as error:
            raise BadQueryError.about(one.name, say("filter.reason", reason=error)) from None
        any_of = places.Condition.joined(
            "OR", (_between(one.sql, f"{name}_{n}_", *ends) for n, ends in enumerate(spans))
        )
        return places.Condition(f"({any_of.sql})", any_of.values)
    try:
        # A name may have a comma in it.
        texts = dict.fromkeys([*listed, *texts]) if one.kind == "string" else listed
        read = [_read(one.kind, text) for text in texts]
    except ValueError:
        raise BadQueryError.about(one.name, say("items.must_be_some", what=_WANTED[one.kind])) from None
    if one.digits is not None:
        return _as_shown(one, name, read)
    return places.Condition(f"{one.sql} = ANY(CAST(%({name})s AS {SQL_TYPES[one.kind]}[]))", {name: read})


def _as_shown(one: Property, name: str, numbers: Sequence[float]) -> places.Condition:
    """Numbers are served with some digits: one that was read here means all that look like it."""
    half = 0.5 / 10 ** (one.digits or 0)
    within = f"{one.sql} BETWEEN CAST(%({name}_{{n}}_0)s AS float8) AND CAST(%({name}_{{n}}_1)s AS float8)"
    values = {
        f"{name}_{n}_{end}": number + sign * half
        for n, number in enumerate(numbers)
        for end, sign in enumerate((-1, 1))
    }
    return places.Condition("(" + " OR ".join(within.format(n=n) for n in range(len(numbers))) + ")", values)


def _read(kind: str, text: str) -> Any:
    """The value of a kind that a text means; ``ValueError`` where it means none."""
    if kind == "string":
        return text
    if kind == "boolean" and text.lower() in _TRUTHS:
        return _TRUTHS[text.lower()]
    if kind in _NUMBERS:
        pattern, convert, most = _NUMBERS[kind]
        if pattern.fullmatch(text) and abs(value := convert(text)) <= most:
            return value
    raise ValueError(text)


def _truth(text: str, field: str) -> bool:
    try:
        return bool(_read("boolean", text))
    except ValueError:
        raise BadQueryError.about(field, say("items.must_be", what=_WANTED["boolean"])) from None


def _limit(one: Mapping[str, str], settings: Settings) -> int:
    if "limit" not in one:
        return settings.items_limit_default
    text = one["limit"]
    if not (text.isascii() and text.isdigit()) or not text.strip("0"):
        raise BadQueryError.about(
            "limit",
            say("items.limit", most=settings.items_limit_max),
        )
    return settings.items_limit_max if len(text) > 18 else min(int(text), settings.items_limit_max)


def _shape(collection: Collection, one: Mapping[str, str]) -> Shape:
    return Shape(
        crs=places.parse_crs(one["crs"], "crs") if "crs" in one else places.CRS84,
        properties=_names(collection, one["properties"])
        if "properties" in one
        else tuple(collection.properties),
        with_line=not ("skipGeometry" in one and _truth(one["skipGeometry"], "skipGeometry")),
        gaps="gaps" in one and _truth(one["gaps"], "gaps"),
    )


def _names(collection: Collection, text: str) -> tuple[str, ...]:
    """Some of the properties, in the collection's order; nothing: none of them."""
    names = set(text.split(",")) - {"", GEOMETRY}
    if unknown := sorted(names - set(collection.properties)):
        raise BadQueryError.about(
            "properties",
            say("items.no_property", name=unknown[0], names=", ".join(collection.properties)),
        )
    return tuple(name for name in collection.properties if name in names)


def _since(text: str) -> datetime | str:
    try:
        return places.moment(text)
    except (ValueError, OverflowError):
        return text
