"""In which order items come, and where the next page begins.

A page is found by the values of the last item before it, not by counting: each page costs the same, and what changes
meanwhile moves nothing else. Unknown values come last, in either direction, and the id decides between equals, so that
every item has one place. The leading key parts the items into those that have it and those that do not: each part is
one statement, whose order an index gives.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from app.core.errors import BadQueryError
from app.core.messages import say
from app.core.text import dumps
from app.map.items.collections import Collection, Property
from app.map.items.places import Condition
from app.map.segment import SQL_TYPES

MAX_ID = 2**63 - 1
MOST_KEYS = 4
_VERSION = 1
_LONGEST = 4000
_DIGEST_BYTES = 9


@dataclass(frozen=True)
class SortKey:
    """A property to sort by."""

    property: Property
    descending: bool = False

    def order(self) -> str:
        """As it stands after ORDER BY."""
        direction = " DESC" if self.descending else ""
        last = " NULLS LAST" if self.property.nullable and self.descending else ""
        return f"{self.property.sql}{direction}{last}"

    def value(self, n: int) -> str:
        """What it is compared with: the value number ``n`` of a place."""
        return f"CAST(%(k{n})s AS {SQL_TYPES[self.property.kind]})"


Values = tuple[str | None, ...]
"""Of each key, as PostgreSQL writes them; the last is the id."""


@dataclass(frozen=True)
class Leg:
    """Part of the items in the order that was asked for: where the leading key is known, or where it is not."""

    condition: Condition
    order: str


class Order:
    """The order of a collection's items."""

    def __init__(self, collection: Collection, keys: Sequence[SortKey] = ()) -> None:
        """Without keys: by ascending id. Keys after the id say nothing more."""
        self._collection = collection
        by_id = next((n for n, key in enumerate(keys) if key.property.name == "id"), len(keys))
        self.keys = tuple(keys[:by_id])
        # As its own key says, else as the last one of the others.
        self._id_descending = any(key.descending for key in keys[by_id:][:1] or keys[-1:])

    @property
    def text(self) -> str:
        """The order in one line, equal for equal orders."""
        signs = [f"{'-' if key.descending else '+'}{key.property.name}" for key in self.keys]
        return ",".join([*signs, "-id" if self._id_descending else "+id"])

    @property
    def columns(self) -> str:
        """What a statement selects for ``Values``."""
        sqls = [*(key.property.sql for key in self.keys), self._collection.key]
        return ", ".join(f"CAST({sql} AS text)" for sql in sqls)

    def legs(self, after: Values | None) -> Iterator[Leg]:
        """The parts from a place on, in their order."""
        if not self.keys or not self.keys[0].property.nullable:
            yield self._leg(after, None)
            return
        if after is None or after[0] is not None:
            yield self._leg(after, True)
            after = None
        yield self._leg(after, False)

    def _leg(self, after: Values | None, known: bool | None) -> Leg:
        """The items after a place, of those whose leading key is known (True), is not (False), or always is (None)."""
        sorted_by = self._terms(known)
        parts = []
        if known is not None:
            parts.append(f"{sorted_by[0].property.sql} IS {'NOT ' if known else ''}NULL")
        if known is False:
            sorted_by = sorted_by[1:]
            after = None if after is None else after[1:]
        else:
            leading = replace(sorted_by[0].property, nullable=False)
            sorted_by = [SortKey(leading, sorted_by[0].descending), *sorted_by[1:]]
        values: dict[str, Any] = {}
        if after is not None:
            values = {f"k{n}": value for n, value in enumerate(after)}
            parts.append(_after(sorted_by, after))
        order = ", ".join(term.order() for term in sorted_by)
        return Leg(Condition(" AND ".join(parts) or "true", values), order)

    def _terms(self, known: bool | None) -> list[SortKey]:
        # The id out of the same table as the key lets one index give the order, where the table has a row at all.
        table = self.keys[0].property.table if len(self.keys) == 1 and known else ""
        id_sql = self._collection.keys.get(table, self._collection.key)
        id_property = replace(self._collection.properties["id"], sql=id_sql)
        return [*self.keys, SortKey(id_property, self._id_descending)]


def _after(terms: Sequence[SortKey], after: Values) -> str:
    """The condition of items that come after those values."""
    if len({term.descending for term in terms}) == 1 and not any(term.property.nullable for term in terms):
        # A comparison of rows is one range of an index.
        left = ", ".join(term.property.sql for term in terms)
        right = ", ".join(term.value(n) for n, term in enumerate(terms))
        return f"({left}) {'<' if terms[0].descending else '>'} ({right})"
    ways, equal = [], []
    for n, (term, value) in enumerate(zip(terms, after, strict=True)):
        sql, nullable = term.property.sql, term.property.nullable
        if value is None:
            equal.append(f"{sql} IS NULL")
            continue
        beyond = f"{sql} {'<' if term.descending else '>'} {term.value(n)}"
        ways.append(" AND ".join([*equal, f"({beyond} OR {sql} IS NULL)" if nullable else beyond]))
        equal.append(f"{sql} = {term.value(n)}")
    first = terms[0]
    either = "(" + " OR ".join(f"({way})" for way in ways) + ")"
    if first.property.nullable:
        return either
    return f"{first.property.sql} {'<=' if first.descending else '>='} {first.value(0)} AND {either}"


def parse_sortby(text: str, collection: Collection) -> list[SortKey]:
    """The keys of ``sortby=+name,-name``; ``BadQueryError`` for what cannot be sorted by."""
    keys: list[SortKey] = []
    known = collection.properties
    for part in text.split(","):
        # A plus sign in an address means a space.
        sign, name = (part[:1], part[1:]) if part[:1] in {"+", "-", " "} else ("+", part)
        if name not in known:
            raise BadQueryError.about("sortby", say("items.not_sorted_by", name=name, names=", ".join(known)))
        if any(key.property.name == name for key in keys):
            raise BadQueryError.about("sortby", say("items.twice", name=name))
        keys.append(SortKey(known[name], sign == "-"))
    if len(keys) > MOST_KEYS:
        raise BadQueryError.about("sortby", say("items.most_properties", most=MOST_KEYS))
    return keys


def digest_of(*parts: Any) -> str:
    """A short text that tells queries apart."""
    raw = hashlib.sha256(dumps(parts).encode()).digest()[:_DIGEST_BYTES]
    return base64.urlsafe_b64encode(raw).decode("ascii")


def cursor_text(digest: str, until_xid: int | None, values: Values) -> str:
    """The opaque text of a place in the items of a query; ``until_xid``: where a listing of changes ends."""
    raw = dumps([_VERSION, digest, until_xid, *values]).encode()
    return base64.urlsafe_b64encode(raw).decode("ascii").rstrip("=")


def parse_after(text: str, digest: str, order: Order) -> tuple[int | None, Values]:
    """What ``cursor_text`` wrote; or, where items come by ascending id, the last id before the page.

    Raises ``BadQueryError`` for a text of neither kind and for a place in another query's items.
    """
    if text.isascii() and text.isdigit() and len(text) <= len(str(MAX_ID)) and int(text) <= MAX_ID:
        if order.text != "+id":
            raise _bad_after("with sortby only the text of a next link says where a page begins")
        return None, (text,)
    version, of, until_xid, *values = _unpacked(text)
    if version != _VERSION or of != digest:
        raise _bad_after("this place belongs to another query, whose filters or order differ")
    kinds = [key.property for key in order.keys]
    if (
        not (until_xid is None or (type(until_xid) is int and 0 <= until_xid <= MAX_ID))
        or len(values) != len(kinds) + 1
        or not _fits(values[-1], "integer", nullable=False)
        or not all(_fits(v, p.kind, nullable=p.nullable) for v, p in zip(values[:-1], kinds, strict=True))
    ):
        raise _bad_after(say("items.no_place_reason"))
    return until_xid, tuple(values)


def _unpacked(text: str) -> list[Any]:
    try:
        if len(text) > _LONGEST:
            raise ValueError("too long")
        values = json.loads(base64.b64decode(text + "=" * (-len(text) % 4), altchars=b"-_", validate=True))
    except (ValueError, RecursionError, binascii.Error):
        values = None
    if not isinstance(values, list) or len(values) < 4:
        raise _bad_after(say("items.no_place_reason"))
    return values


def _fits(value: Any, kind: str, *, nullable: bool) -> bool:
    """Whether PostgreSQL may have written the text for a value of this kind."""
    if value is None:
        return nullable
    if not isinstance(value, str) or not _WRITTEN[kind].fullmatch(value):
        return False
    return kind != "integer" or abs(int(value)) <= MAX_ID


_WRITTEN = {
    "integer": re.compile(r"-?\d{1,19}", re.ASCII),
    "number": re.compile(r"-?\d+(\.\d+)?(e[+-]\d+)?|NaN|-?Infinity", re.ASCII),
    "string": re.compile(r"[^\0\ud800-\udfff]*"),
    "boolean": re.compile(r"true|false"),
    "time": re.compile(r"\d{4}-\d{2}-\d{2} \d{2}:\d{2}:\d{2}(\.\d{1,6})?\+00"),
}
"""How PostgreSQL writes values of each kind."""


def _bad_after(reason: str) -> BadQueryError:
    return BadQueryError.about("after", say("items.after", reason=reason))
