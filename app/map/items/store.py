"""Pages of features out of the database, as text that PostgreSQL puts together and is passed on as it is.

The statements are put together from constants, from what ``app.map.items.collections`` says and from how features are
written (``app.map.items.writing``); what somebody sent is in their parameters only.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from psycopg.errors import DataError, InternalError_, ProgramLimitExceeded, QueryCanceled
from sqlalchemy.orm import Session

from app.changes.store import changed_since_sql, parse_version, state, version_text
from app.core.db import fetch_binary, send_binary
from app.core.disconnects import client_left
from app.core.errors import BadQueryError
from app.core.messages import say
from app.map.items.collections import Collection
from app.map.items.paging import Leg, cursor_text
from app.map.items.places import Condition, psycopg_sql
from app.map.items.request import ItemRequest, Shape
from app.map.items.writing import feature_sql, row_sql

COUNTED_MOST = 10_000
"""Above, it is not said how many features match."""
_CHEAP = 5_000.0
_CHEAP_OF_PLACES = 60_000.0
"""What a count may cost by the planner's estimate, which is far too high for comparisons of places: a few ms each."""

_PAGE = "SELECT {feature}, {keys} FROM {source} WHERE {where} ORDER BY {order} LIMIT %(size)s"
# Where the page is known by the first table alone, the second is looked up for its features only.
_PAGE_FIRST = """
    SELECT {feature}, {keys}
    FROM (SELECT {alias}.* FROM {table} WHERE {where} ORDER BY {order} LIMIT %(size)s) AS {alias} {beside}
    ORDER BY {order}
"""
_ONE = "SELECT {feature} FROM {source} WHERE {key} = %(id)s"
_COUNT = "SELECT count(*) FROM (SELECT FROM {source} WHERE {where} LIMIT %(most)s) AS matching"
_PATIENCE = "SELECT set_config('statement_timeout', %(ms)s, true)"
_PATIENT_AGAIN = "SET LOCAL statement_timeout TO DEFAULT"
_LONGEST_PREPARED = 4000
"""Characters. Beyond, somebody listed many values."""
_EXPLAIN = "EXPLAIN (FORMAT JSON) "
_Fetch = Callable[[str, Mapping[str, Any]], list[tuple[Any, ...]]]


@dataclass(frozen=True)
class Page:
    """Some features, in order."""

    features: list[str]
    """Each as text: of GeoJSON, or a row of a table where that is asked for."""
    next_cursor: str | None
    """What ``after`` is on the next page; None: there is none."""
    matched: int | None
    """How many match on all pages, where that is known at little cost."""
    version: str | None = None
    """Of a listing of changes: what to name in ``updated_since`` the next time. The same on all pages of a listing."""


def page(session: Session, request: ItemRequest) -> Page:
    """The page that is asked for.

    Raises ``BadQueryError`` where a filter computes what has no result, where looking takes longer than the request's
    patience, and for a version that is none; ``GoneError`` for a version that is not this database's.
    """
    until_xid, request = _up_to(session, request)
    fetch = _within_patience(session, request)
    rows: list[tuple[Any, ...]] = []
    try:
        for leg in request.order.legs(request.after):
            rows += _rows(fetch, request, leg, request.limit + 1 - len(rows))
            if len(rows) > request.limit:
                break
        shown, more = rows[: request.limit], len(rows) > request.limit
        matched = None if request.after else _matched(fetch, request) if more else len(shown)
    except (DataError, InternalError_, ProgramLimitExceeded) as error:
        raise _not_computed(request, error) from error
    except QueryCanceled as error:
        if request.patience_s is None or client_left():
            raise
        raise _too_long(request) from error
    if request.patience_s is not None:
        send_binary(session, _PATIENT_AGAIN, {})
    return Page(
        features=[row[0] for row in shown],
        next_cursor=cursor_text(request.digest, until_xid, shown[-1][1:]) if more else None,
        matched=matched,
        version=None if until_xid is None else version_text(session, until_xid),
    )


def one(session: Session, collection: Collection, feature_id: int, shape: Shape) -> str | None:
    """The text of one feature, or None."""
    statement = _ONE.format(
        feature=_feature(collection, shape), source=_source(collection, shape), key=collection.key
    )
    rows = fetch_binary(session, statement, {"id": feature_id})
    return rows[0][0] if rows else None


def _up_to(session: Session, request: ItemRequest) -> tuple[int | None, ItemRequest]:
    """Where a listing of changes ends, and the request with that as a condition."""
    since = request.since
    if since is None:
        return None, request
    until_xid = request.until_xid if request.until_xid is not None else state(session).horizon
    values: dict[str, Any] = {"since_xid": None, "since_time": None, "until_xid": until_xid}
    if isinstance(since, str):
        values["since_xid"] = parse_version(session, since, field="updated_since")
    else:
        values["since_time"] = since
    changed = changed_since_sql(request.collection.key.partition(".")[0])
    condition = Condition(psycopg_sql(changed), values)
    return until_xid, replace(request, conditions=(*request.conditions, condition))


def _within_patience(session: Session, request: ItemRequest) -> _Fetch:
    """What reads the rows of the request's statements, which together have its patience: planning them counts."""
    if request.patience_s is None:
        return lambda statement, values: fetch_binary(session, statement, values)
    deadline_s = time.monotonic() + request.patience_s

    def fetch(statement: str, values: Mapping[str, Any]) -> list[tuple[Any, ...]]:
        left_ms = max(1, math.ceil(1000 * (deadline_s - time.monotonic())))  # 0 would be for ever
        fetch_binary(session, _PATIENCE, {"ms": str(left_ms)})
        composed = request.filtered or len(statement) > _LONGEST_PREPARED
        return fetch_binary(session, statement, values, prepare=False if composed else None)

    return fetch


def _rows(fetch: _Fetch, request: ItemRequest, leg: Leg, size: int) -> list[tuple[Any, ...]]:
    collection, shape = request.collection, request.shape
    where = Condition.joined("AND", (leg.condition, *request.conditions))
    alias, *others = collection.keys
    alone = not any(re.search(rf"\b{other}\.", f"{where.sql} {leg.order}") for other in others)
    statement = (_PAGE_FIRST if alone and collection.beside else _PAGE).format(
        feature=_feature(collection, shape),
        keys=request.order.columns,
        source=_source(collection, shape),
        where=where.sql,
        order=leg.order,
        alias=alias,
        table=collection.table,
        beside=collection.beside[shape.gaps] if collection.beside else "",
    )
    return fetch(statement, {"size": size, **where.values})


def _matched(fetch: _Fetch, request: ItemRequest) -> int | None:
    """How many features match, where few do and the planner expects the count to be cheap."""
    where = Condition.joined("AND", request.conditions)
    statement = _COUNT.format(source=_source(request.collection, request.shape), where=where.sql)
    values = {"most": COUNTED_MOST + 1, **where.values}
    ((plan,),) = fetch(_EXPLAIN + statement, values)
    expected = plan[0]["Plan"]
    if expected["Total Cost"] > (_CHEAP_OF_PLACES if "ST_" in statement else _CHEAP):
        return None
    # What the planner expects of what stands below the limit: twice as many as are counted.
    if any(below["Plan Rows"] > 2 * COUNTED_MOST for below in expected["Plans"][0].get("Plans", ())):
        return None
    ((count,),) = fetch(statement, values)
    return count if count <= COUNTED_MOST else None


def _feature(collection: Collection, shape: Shape) -> str:
    return (row_sql if shape.table else feature_sql)(
        collection, shape.crs, shape.properties, with_line=shape.with_line
    )


def _source(collection: Collection, shape: Shape) -> str:
    return collection.source_with_gaps if shape.gaps and collection.source_with_gaps else collection.source


def _too_long(request: ItemRequest) -> BadQueryError:
    quick = ", ".join(request.collection.quick)
    return BadQueryError(say("items.too_long", patience_s=request.patience_s, names=quick))


def _not_computed(request: ItemRequest, error: Exception) -> Exception:
    """What of somebody's making the database could not compute; anything else is a fault of ours."""
    reason = str(error).partition("\n")[0]
    if request.filtered:
        return BadQueryError.about("filter", say("filter.not_computed", reason=reason))
    if request.after:
        return BadQueryError.about("after", say("items.no_place"))
    return error
