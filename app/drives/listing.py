"""Lists of drives: their orders, each with an index of its own, the places where a page begins, and the search.

Every order ends with the upload's time and the id, so that it is total and a page can begin behind any drive, also one
that is gone. Unknown keys (when or how far an unfinished drive went) come last in either direction: known and unknown
keys are two stretches of the same index, read one after the other. Drives are searched by the beginnings of words of a
file's name, or of an id, both from an index. Migration 0026 takes a name apart at whatever is neither letter nor digit
and between both; so `karl 2026` finds `2026-11-20_Karlsruhe.csv`.
"""

from __future__ import annotations

import base64
import json
import math
import re
import uuid
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any, NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.errors import BadRequestError
from app.core.messages import say
from app.core.query import cursor_of, parse_cursor
from app.drives.documents import DrivePlace, DriveStatus

NAME_LENGTH = 100
"""Letters of a file's name that decide its place: longer keys would not fit into an index."""
_CURSOR_LENGTH = 1000


class Sort(StrEnum):
    """What drives can be ordered by."""

    CREATED_AT = "created_at"
    DRIVE_TIME = "drive_time"
    DISTANCE_M = "distance_m"
    FILENAME = "filename"
    STATUS = "status"


class Direction(StrEnum):
    """Which end comes first."""

    ASC = "asc"
    DESC = "desc"


class Order(NamedTuple):
    """An order of drives."""

    sort: Sort = Sort.CREATED_AT
    descending: bool = True


def default_direction(sort: Sort) -> Direction:
    """Letters from A on, of times and lengths the greatest first."""
    return Direction.ASC if sort in (Sort.FILENAME, Sort.STATUS) else Direction.DESC


class Stretch(NamedTuple):
    """A part of a page's query: conditions, its values, and its order."""

    condition: str
    values: dict[str, Any]
    order_by: str


class _Key(NamedTuple):
    """A column or expression of the drives ``d`` that has an index together with (created_at, id)."""

    expression: str
    nullable: bool
    of_json: Callable[[Any], Any]


def _text(value: Any) -> str:
    if not isinstance(value, str) or len(value) > NAME_LENGTH or "\0" in value:
        raise ValueError(value)
    return value


def _figure(value: Any) -> float:
    if not math.isfinite(number := float(value)):
        raise ValueError(value)
    return number


def _moment(value: Any) -> datetime:
    moment = datetime.fromisoformat(value)
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


# As migration 0026 has them indexed.
_KEYS: dict[Sort, _Key] = {
    Sort.DRIVE_TIME: _Key("d.drive_time", True, _moment),
    Sort.DISTANCE_M: _Key("d.distance_m", True, _figure),
    Sort.FILENAME: _Key(f'"left"(lower(d.filename), {NAME_LENGTH}) COLLATE "C"', False, _text),
    Sort.STATUS: _Key("d.status", False, lambda value: str(DriveStatus(value))),
}


def key_of(order: Order) -> str:
    """The SQL of the key that a place holds beside a drive's time and id."""
    return _KEYS[order.sort].expression if order.sort in _KEYS else "NULL"


def stretches(order: Order, place: DrivePlace | None, *, backwards: bool) -> Iterator[Stretch]:
    """The queries that fill a page, one after the other: behind ``place``, or before it if ``backwards``."""
    descending = order.descending is not backwards
    sign, way = ("<", "DESC") if descending else (">", "ASC")
    key = _KEYS.get(order.sort)
    if key is None:
        yield Stretch(*_beyond("", place, sign), f"d.created_at {way}, d.id {way}")
        return
    order_by = f"{key.expression} {way}, d.created_at {way}, d.id {way}"
    halves = [True, False] if key.nullable else [True]
    begun = place is None
    for is_known in reversed(halves) if backwards else halves:
        here = place if place is not None and is_known is (place.key is not None) else None
        begun = begun or here is not None
        if begun:
            half = f" AND {key.expression} IS {'NOT ' if is_known else ''}NULL" if key.nullable else ""
            condition, values = _beyond(key.expression if is_known else "", here, sign)
            yield Stretch(half + condition, values, order_by)


def _beyond(key: str, place: DrivePlace | None, sign: str) -> tuple[str, dict[str, Any]]:
    if place is None:
        return "", {}
    values = {"place_created_at": place.created_at, "place_id": place.id}
    if not key:
        return f" AND (d.created_at, d.id) {sign} (:place_created_at, :place_id)", values
    there = "(:place_key, :place_created_at, :place_id)"
    return f" AND ({key}, d.created_at, d.id) {sign} {there}", {**values, "place_key": place.key}


def cursor(order: Order, place: DrivePlace) -> str:
    """The text that ``place_of`` takes for the same sort."""
    if order.sort not in _KEYS:
        return cursor_of(place.created_at, place.id.int)
    key = place.key.isoformat() if isinstance(place.key, datetime) else place.key
    place_text = json.dumps([order.sort, key, place.created_at.isoformat(), place.id.hex])
    return base64.urlsafe_b64encode(place_text.encode()).decode("ascii")


def place_of(order: Order, cursor_text: str, field: str) -> DrivePlace:
    """The place; ``BadRequestError`` for a text that ``cursor`` did not make for this sort."""
    try:
        if order.sort not in _KEYS:
            moment, number = parse_cursor(cursor_text)
            return DrivePlace(moment, uuid.UUID(int=number))
        return _read_cursor(order.sort, cursor_text)
    except (ValueError, TypeError, OverflowError, AttributeError, RecursionError, BadRequestError):
        raise BadRequestError(
            say("drives.no_place", field=field),
            field=field,
        ) from None


def _read_cursor(sort: Sort, cursor_text: str) -> DrivePlace:
    if len(cursor_text) > _CURSOR_LENGTH:
        raise ValueError(cursor_text)
    named, key, created_at, drive_id = json.loads(base64.b64decode(cursor_text, altchars="-_", validate=True))
    if named != sort or (key is None and not _KEYS[sort].nullable):
        raise ValueError(cursor_text)
    value = None if key is None else _KEYS[sort].of_json(key)
    return DrivePlace(_moment(created_at), uuid.UUID(drive_id), value)


# The words are made by the function that the index uses. They are read first: only from a constant can the planner
# estimate whether few or many drives have such a name.
_WORDS = text(
    "SELECT string_agg(quote_literal(word) || ':*', ' & ') FROM unnest(tsvector_to_array(file_words(:q))) AS word"
)
_NAMED = "file_words(d.filename) @@ CAST(:q_words AS tsquery)"
_OF_ID = "d.id BETWEEN :q_first AND :q_last"
_ID_LENGTH = 32
_ID = re.compile(r"[0-9a-f]{8,32}")
"""The beginning of an id that is long enough to be meant as one."""


def matching(session: Session, q: str) -> tuple[str, dict[str, Any]]:
    """The condition, which begins with AND, and its values."""
    conditions: list[str] = []
    values: dict[str, Any] = {}
    if words := session.execute(_WORDS, {"q": q.replace("\0", " ")}).scalar():
        conditions.append(_NAMED)
        values["q_words"] = words
    digits = q.strip().lower().replace("-", "")
    if _ID.fullmatch(digits):
        conditions.append(_OF_ID)
        values["q_first"] = uuid.UUID(digits.ljust(_ID_LENGTH, "0"))
        values["q_last"] = uuid.UUID(digits.ljust(_ID_LENGTH, "f"))
    return f" AND ({' OR '.join(conditions) or 'false'})", values
