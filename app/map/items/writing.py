"""Features as expressions of PostgreSQL: the text of GeoJSON, or a row of a table.

The text is what ``Segment.geojson`` writes, ten times as fast: the values are the same, digit by digit, since both
round alike (``app.core.text.rounded``). A whole number may stand without its ``.0``: JSON has one kind of numbers.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

from app.core.text import WHOLE
from app.map.items.collections import Collection, Property
from app.map.items.places import Crs

WKT = "wkt"
"""The column of a table that has the line, as in files."""
_LARGEST = sys.float_info.max
_WITH_DEFAULT = re.compile(r"coalesce\((\w+)\..+, (\w+)\)")


@lru_cache(maxsize=256)
def feature_sql(collection: Collection, crs: Crs, shown: tuple[str, ...], *, with_line: bool = True) -> str:
    """The expression of a feature's text, over ``Collection.source``; ``shown`` names its properties, in their order.

    Where the second of the tables has nothing of the feature, as of most segments of a map, what it would say is
    written at once.
    """
    properties = [collection.properties[name] for name in shown]
    return _either(
        collection,
        lambda without: _feature(collection, crs, properties, with_line=with_line, without=without),
    )


@lru_cache(maxsize=256)
def row_sql(collection: Collection, crs: Crs, shown: tuple[str, ...], *, with_line: bool = True) -> str:
    """The same of a row of CSV (RFC 4180) without its end, in the order of ``columns_of``."""
    properties = [collection.properties[name] for name in columns_of(shown, with_line=False)]
    line = [f"\0ST_AsText({_line(collection, crs)}, {crs.digits})"] if with_line else []

    def row(without: str | None) -> list[str]:
        cells = [_cell(one, without) for one in properties] + [['"', *line, '"'] for _ in line]
        return [piece for n, cell in enumerate(cells) for piece in ([","] * (n > 0) + cell)]

    return _either(collection, row)


def columns_of(shown: Sequence[str], *, with_line: bool = True) -> list[str]:
    """The header of such a table: the id in any case, the other properties, and the line as well-known text."""
    return [*dict.fromkeys(("id", *shown)), *([WKT] if with_line else [])]


def _either(collection: Collection, pieces: Callable[[str | None], list[str]]) -> str:
    """The expression of these pieces, and of those without the second table where that has nothing."""
    complete = f"concat({', '.join(_joined(pieces(None)))})"
    tables = list(collection.keys.items())
    if len(tables) == 1:
        return complete
    table, key = tables[1]
    return f"CASE WHEN {key} IS NULL THEN concat({', '.join(_joined(pieces(table)))}) ELSE {complete} END"


def _feature(
    collection: Collection, crs: Crs, properties: Sequence[Property], *, with_line: bool, without: str | None
) -> list[str]:
    pieces: list[str] = ['{"type":"Feature","id":', f"\0{collection.key}", ',"geometry":']
    pieces.append(f"\0{_line_sql(collection, crs)}" if with_line else "null")
    for n, one in enumerate(properties):
        pieces.append(f',"{one.name}":' if n else f',"properties":{{"{one.name}":')
        pieces.extend(_value(one, without))
    pieces.append("}}" if properties else ',"properties":{}}')
    return pieces


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
    if one.table == without:
        return [default[2] if default else "null"]
    pieces = [f"\0{_SQL[one.kind](one)}"]
    if one.nullable:
        # concat leaves out what is NULL: an expression of its own says so.
        pieces.append(f"\0CASE WHEN {_known(one)} THEN NULL ELSE 'null' END")
    return pieces


def _cell(one: Property, without: str | None) -> list[str]:
    """A cell: unknown is empty, a text has quotes and so differs from that even where it is empty."""
    default = _WITH_DEFAULT.fullmatch(one.sql)
    if one.table == without:
        return [default[2]] if default else []
    return [f"\0{_CELLS.get(one.kind, _SQL[one.kind])(one)}"]


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

_CELLS: Mapping[str, Callable[[Property], str]] = {
    "string": lambda one: f"""'"' || replace({one.sql}, '"', '""') || '"'""",
    "time": lambda one: f"""to_char({one.sql}, 'YYYY-MM-DD"T"HH24:MI:SS.MS"Z"')""",
}
"""Where a table writes otherwise than JSON."""


def _line_sql(collection: Collection, crs: Crs) -> str:
    return f"ST_AsGeoJSON({_line(collection, crs)}, {crs.digits}, 0)"


def _line(collection: Collection, crs: Crs) -> str:
    line = collection.line if crs.srid == 4326 else collection.line_3857
    return f"ST_FlipCoordinates({line})" if crs.latitude_first else line
