"""A ``RoadTable`` as PostgreSQL's binary COPY, made by numpy: no Python per row.

Rows with equally many knots are equally wide. Text would vary, so the few distinct (highway, name) pairs travel in a
table of their own and the rows carry their number. Geometries are EWKB (a line of two points,
little-endian, with SRID).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from psycopg import Cursor
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.tables import SRID_DEGREES, SRID_TILES
from fusion.network.curve import interval_count, knot_length
from fusion.roads.table import RoadTable
from fusion.types import Floats, Ints, Progress

_CHUNK = 32_768
_EARTH_RADIUS_M = 6_378_137.0  # of the sphere that EPSG:3857 projects
_MAX_LATITUDE_DEG = 89.9999  # the projection's y grows without bound towards the pole

_HEADER = b"PGCOPY\n\xff\r\n\0" + bytes(8)
_TRAILER = b"\xff\xff"

_LINE = np.dtype([("order", "u1"), ("type", "<u4"), ("srid", "<u4"), ("points", "<u4"), ("xy", "<f8", 4)])
_EWKB_LINE_WITH_SRID = 0x20000002

_HEIGHT = np.dtype([("size", ">i4"), ("value", ">f8")])
_FLOAT8 = 701  # PostgreSQL's number of the type

_FIELDS: dict[str, Any] = {
    "n": ">i4",
    "osm_way_id": ">i8",
    "from_node": ">i8",
    "to_node": ">i8",
    "geom": _LINE,
    "geom_3857": _LINE,
    "length_m": ">f8",
    "tag": ">i4",
    "oneway": ">i2",
    "bridge": "u1",
    "tunnel": "u1",
    "layer": ">i2",
    "dem_slope_percent": ">f8",
}

# Not TRUNCATE, which would wait for a backup that reads beside.
_EMPTY = (text("DELETE FROM road_import"), text("DELETE FROM road_import_tags"))

# NaN stands for "unknown" there, because a NULL would change the width of its row; an empty array for no height at all.
_FILL_TAGS = text("""
    INSERT INTO road_import_tags
    SELECT * FROM unnest(CAST(:tag AS integer[]), CAST(:highway AS text[]), CAST(:name AS text[]))
""")
_COPY = f"COPY road_import ({', '.join(_FIELDS)}, dem_heights_m) FROM STDIN (FORMAT BINARY)"

# The planner knows nothing of a table that was just filled.
_ANALYZE = text("ANALYZE road_import")


def copy_roads(
    session: Session, table: RoadTable, dem_slope_percent: Floats, dem_heights_m: Floats, progress: Progress
) -> None:
    """Fill ``road_import``, whose ``n`` is the row of ``table``, and ``road_import_tags`` in place of what was there.

    Both are of whoever imports just now, until ``forget_roads``, for an import takes several transactions.
    ``dem_slope_percent`` has shape (n,); ``dem_heights_m`` is one segment's knots after another's; NaN unknown.
    """
    forget_roads(session)
    codes = _copy_tags(session, table)
    cursor: Cursor[Any] = session.connection().connection.cursor()  # type: ignore[assignment]
    with cursor, cursor.copy(_COPY) as copy:
        copy.write(_HEADER)
        for done, rows in _rows(table, codes, dem_slope_percent, dem_heights_m):
            copy.write(rows)
            progress("copying", done / max(len(table), 1))
        copy.write(_TRAILER)
    session.execute(_ANALYZE)


def forget_roads(session: Session) -> None:
    """Empty both."""
    for statement in _EMPTY:
        session.execute(statement)


def _copy_tags(session: Session, table: RoadTable) -> NDArray[np.int32]:
    """Write the distinct (highway, name) pairs; return each segment's number among them, shape (n,)."""
    numbers: dict[tuple[str, str | None], int] = {}
    pairs = zip(table.highway.tolist(), table.name.tolist(), strict=True)
    codes = np.array([numbers.setdefault(pair, len(numbers)) for pair in pairs], np.int32)
    highways, names = [highway for highway, _ in numbers], [name for _, name in numbers]
    session.execute(_FILL_TAGS, {"tag": list(numbers.values()), "highway": highways, "name": names})
    return codes


def _rows(
    table: RoadTable, codes: NDArray[np.int32], dem_slope_percent: Floats, dem_heights_m: Floats
) -> Iterator[tuple[int, bytes]]:
    """Yield (rows so far, the next chunk in COPY's binary layout)."""
    columns: dict[str, Any] = {name: getattr(table, name, None) for name in _FIELDS}
    columns |= {"n": np.arange(len(table)), "tag": codes, "dem_slope_percent": dem_slope_percent}
    degrees = np.column_stack([table.lon0_deg, table.lat0_deg, table.lon1_deg, table.lat1_deg])
    columns |= {"geom": _lines(degrees, SRID_DEGREES), "geom_3857": _lines(web_mercator(degrees), SRID_TILES)}
    knots = interval_count(knot_length(table.length_m)) + 1
    first = np.cumsum(knots) - knots
    known = np.concatenate([[0], np.cumsum(np.isfinite(dem_heights_m))])
    knots = np.where(known[first + knots] > known[first], knots, 0)
    for start in range(0, len(table), _CHUNK):
        part = np.arange(start, min(start + _CHUNK, len(table)))
        yield start + len(part), _packed(columns, part, knots[part], first[part], dem_heights_m)


def _packed(columns: dict[str, Any], part: Ints, knots: Ints, first: Ints, heights_m: Floats) -> bytes:
    """The rows ``part`` in their order, each with so many heights, which begin at ``first``."""
    kinds = {n: _row_type(n) for n in np.unique(knots).tolist()}
    width = np.zeros(max(kinds) + 1, np.int64)
    width[list(kinds)] = [kind.itemsize for kind in kinds.values()]
    offset = np.cumsum(width[knots]) - width[knots]
    out = np.empty(int(width[knots].sum()), np.uint8)
    for n, kind in kinds.items():
        mine = np.flatnonzero(knots == n)
        rows = np.empty(len(mine), kind)
        rows["fields"] = len(_FIELDS) + 1
        for name in _FIELDS:
            rows[f"{name}_size"] = kind[name].itemsize
            rows[name] = columns[name][part[mine]]
        rows["heights_size"] = kind["heights"].itemsize
        rows["heights"]["oid"], rows["heights"]["flags"] = _FLOAT8, 0
        rows["heights"]["dimensions"] = min(n, 1)
        if n:
            rows["heights"]["length"], rows["heights"]["lower"] = n, 1
            rows["heights"]["items"]["size"] = 8
            rows["heights"]["items"]["value"] = heights_m[first[mine][:, None] + np.arange(n)]
        out[offset[mine][:, None] + np.arange(kind.itemsize)] = rows.view(np.uint8).reshape(len(mine), -1)
    return out.tobytes()


def _row_type(knots: int) -> np.dtype[Any]:
    """A row with an array of so many heights; one of none has no dimension."""
    array: list[Any] = [("dimensions", ">i4"), ("flags", ">i4"), ("oid", ">i4")]
    if knots:
        array += [("length", ">i4"), ("lower", ">i4"), ("items", _HEIGHT, knots)]
    layout: list[Any] = [("fields", ">i2")]
    for name, kind in {**_FIELDS, "heights": np.dtype(array)}.items():
        layout += [(f"{name}_size", ">i4"), (name, kind)]
    return np.dtype(layout)


def _lines(xy: Floats, srid: int) -> NDArray[Any]:
    """Two-point lines as EWKB; ``xy`` has shape (n, 4): x0, y0, x1, y1."""
    lines = np.empty(len(xy), _LINE)
    lines["order"] = 1
    lines["type"] = _EWKB_LINE_WITH_SRID
    lines["srid"] = srid
    lines["points"] = 2
    lines["xy"] = xy
    return lines


def web_mercator(degrees: Floats) -> Floats:
    """EPSG:3857 metres of WGS 84 degrees, shape (n, 4) both: lon0, lat0, lon1, lat1 -> x0, y0, x1, y1."""
    out = np.radians(degrees)
    for lat in (1, 3):
        bounded = np.radians(np.clip(degrees[:, lat], -_MAX_LATITUDE_DEG, _MAX_LATITUDE_DEG))
        out[:, lat] = np.arcsinh(np.tan(bounded))
    scaled: Floats = out * _EARTH_RADIUS_M
    return scaled
