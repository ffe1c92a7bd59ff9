"""Features of GeoJSON as text that PostgreSQL puts together, which is passed on as it is.

What ``Segment.geojson`` writes, ten times as fast: the values are the same, digit by digit, since both round alike
(``app.core.text.rounded``). A whole number may stand without its ``.0``: JSON has one kind of numbers.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

from app.core.text import WHOLE
from app.map.items.collections import Collection, Property
from app.map.items.places import Crs

_LARGEST = sys.float_info.max
_WITH_DEFAULT = re.compile(r"coalesce\((\w+)\..+, (\w+)\)")


@lru_cache(maxsize=256)
def feature_sql(collection: Collection, crs: Crs, shown: tuple[str, ...], *, with_line: bool = True) -> str:
    """The expression of a feature's text, over ``Collection.source``; ``shown`` names its properties, in their order.

    Where the second of the tables has nothing of the feature, as of most segments of a map, what it would say is
    written at once.
    """
    properties = [collection.properties[name] for name in shown]
    complete = _concat(collection, crs, properties, with_line=with_line, without=None)
    tables = list(collection.keys.items())
    if len(tables) == 1:
        return complete
    table, key = tables[1]
    bare = _concat(collection, crs, properties, with_line=with_line, without=table)
    return f"CASE WHEN {key} IS NULL THEN {bare} ELSE {complete} END"


def _concat(
    collection: Collection, crs: Crs, properties: Sequence[Property], *, with_line: bool, without: str | None
) -> str:
    pieces: list[str] = ['{"type":"Feature","id":', f"\0{collection.key}", ',"geometry":']
    pieces.append(f"\0{_line_sql(collection, crs)}" if with_line else "null")
    for n, one in enumerate(properties):
        pieces.append(f',"{one.name}":' if n else f',"properties":{{"{one.name}":')
        pieces.extend(_value(one, without))
    pieces.append("}}" if properties else ',"properties":{}}')
    return f"concat({', '.join(_joined(pieces))})"


def _joined(pieces: Sequence[str]) -> list[str]:
    """The arguments of concat: expressions (after a NUL) as they are, all constants between two of them as one."""
    arguments: list[str] = []
    constant = ""
    for piece in [*pieces, "\0"]:
        if not piece.startswith("\0"):
            constant += piece
            continue
        if constant:
            arguments.append("'" + constant.replace("'", "''") + "'")
            constant = ""
        if len(piece) > 1:
            arguments.append(piece[1:])
    return arguments


def _value(one: Property, without: str | None) -> list[str]:
    default = _WITH_DEFAULT.fullmatch(one.sql)
    table = default[1] if default else one.sql.partition(".")[0]
    if table == without:
        return [default[2] if default else "null"]
    pieces = [f"\0{_SQL[one.kind](one)}"]
    if one.nullable:
        # concat leaves out what is NULL: an expression of its own says so.
        pieces.append(f"\0CASE WHEN {_known(one)} THEN NULL ELSE 'null' END")
    return pieces


def value_sql(one: Property) -> str:
    """The arguments of concat that write a property's value."""
    return ", ".join(_joined(_value(one, None)))


def _known(one: Property) -> str:
    # NaN is larger than all numbers, infinity too.
    return f"abs({one.sql}) <= {_LARGEST!r}" if one.kind == "number" else f"{one.sql} IS NOT NULL"


def _number(one: Property) -> str:
    # Adding 0 makes 0 of -0.
    power = f"float8 '1e{one.digits}'"
    small = f"WHEN abs({one.sql}) < {WHOLE!r} THEN round({one.sql} * {power}) / {power} + float8 '0'"
    return f"CASE {small} WHEN {_known(one)} THEN {one.sql} END"


_SQL: Mapping[str, Callable[[Property], str]] = {
    "integer": lambda one: one.sql,
    "number": _number,
    "string": lambda one: f"to_json({one.sql})",
    "boolean": lambda one: f"CASE WHEN {one.sql} THEN 'true' ELSE 'false' END",
    # Milliseconds, cut off as utc_text does.
    "time": lambda one: rf"""to_char({one.sql}, '\"YYYY-MM-DD"T"HH24:MI:SS.MS"Z"\"')""",
}


def _line_sql(collection: Collection, crs: Crs) -> str:
    line = collection.line if crs.srid == 4326 else collection.line_3857
    if crs.latitude_first:
        line = f"ST_FlipCoordinates({line})"
    return f"ST_AsGeoJSON({line}, {crs.digits}, 0)"
