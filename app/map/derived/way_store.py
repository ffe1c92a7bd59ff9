"""Segments of ways out of the database, and ways into it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from sqlalchemy.orm import Session

from app.core.db import fetch_binary, send_binary
from app.core.tables import SRID_DEGREES, SRID_TILES
from app.map.derived.chains import Chains, chains_of, places
from app.map.derived.way_slopes import Measured, slopes_along
from app.map.segment import Way
from fusion.types import Floats

LINE = np.dtype([("head", "u1", 13), ("xy", "<f8", (2, 2))])
"""A line of two points as the database sends it: little-endian EWKB with its SRID."""

_SLOPES = (
    "slope_percent",
    "slope_sigma_percent",
    "height_from_m",
    "height_to_m",
    "height_sigma_m",
    "steepest_percent",
    "steepest_from_m",
    "steepest_to_m",
)
_INTS = ("id", "osm_way_id", "from_node", "to_node", "oneway", "drives", "observations")
_FLOATS = ("length_m", "dem_slope_percent", *_SLOPES)
_THINGS = ("highway", "name", "bridge", "tunnel", "updated_at")

# A gap's slope is measured by nobody. What is not followed yet is not derived from yet, or nobody would know of it when
# it goes (``app.map.derived``).
_SEGMENTS = f"""
    SELECT s.id, s.osm_way_id, s.from_node, s.to_node, s.oneway, coalesce(a.drives, 0), coalesce(a.observations, 0),
           s.length_m, s.dem_slope_percent, {", ".join(f"a.{name}" for name in _SLOPES)},
           s.highway, s.name, s.bridge, s.tunnel, a.updated_at, s.geom, s.geom_3857
    FROM segments AS s
    LEFT JOIN segment_slopes AS a ON a.segment_id = s.id AND a.drives > 0
    LEFT JOIN derived_segments AS d ON d.segment_id = s.id
    WHERE s.osm_way_id = ANY(%(ways)s::bigint[])
        AND (s.id = ANY(%(followed)s::bigint[]) OR d.osm_way_id = s.osm_way_id)
    ORDER BY s.id
"""  # noqa: S608 - constants

# An id may have been another way's first segment, which is about to be followed as well.
_DELETE = """
    DELETE FROM ways WHERE osm_way_id = ANY(%(ways)s::bigint[]) OR id = ANY(%(ids)s::bigint[])
"""
_TYPES = {
    "int64": "bigint",
    "int32": "bigint",
    "int16": "bigint",
    "double": "float8",
    "string": "text",
    "bool": "boolean",
    "timestamp[ms, tz=UTC]": "timestamptz",
}
"""How columns are sent, by Arrow's name of their type."""
_COLUMNS = {name: _TYPES[column.arrow] for name, column in Way.columns.items()}
_COLUMNS |= {"geom": "bytea", "geom_3857": "bytea"}
_READ = {name: f"ST_GeomFromEWKB({name})" for name in ("geom", "geom_3857")}
_INSERT = f"""
    INSERT INTO ways ({", ".join(_COLUMNS)})
    SELECT {", ".join(_READ.get(name, name) for name in _COLUMNS)}
    FROM unnest({", ".join(f"%({name})b::{kind}[]" for name, kind in _COLUMNS.items())})
        AS row ({", ".join(_COLUMNS)})
"""  # noqa: S608 - constants


@dataclass(frozen=True, eq=False)
class WaySegments:
    """The segments of some ways by ascending id: columns of shape (n,), lines of shape (n, 2, 2)."""

    columns: dict[str, Any]
    line_deg: Floats
    line_3857: Floats


def segments_of(session: Session, ways: Collection[int], followed: Collection[int]) -> WaySegments:
    """All segments of these ways that are followed; those of these ids are about to be."""
    values = {"ways": np.array(sorted(ways), np.int64), "followed": np.array(sorted(followed), np.int64)}
    rows = fetch_binary(session, _SEGMENTS, values)
    columns = list(zip(*rows, strict=True)) or [()] * (len(_INTS) + len(_FLOATS) + len(_THINGS) + 2)
    named: dict[str, Any] = dict(zip((*_INTS, *_FLOATS, *_THINGS), columns, strict=False))
    named |= {name: np.array(named[name], np.int64) for name in _INTS}
    named |= {name: np.array(named[name], float) for name in _FLOATS}
    return WaySegments(named, lines(columns[-2]), lines(columns[-1]))


def lines(column: Collection[bytes]) -> Floats:
    """The ends of lines of two points (n, 2, 2)."""
    return np.asarray(np.frombuffer(b"".join(column), LINE)["xy"], float)


def rows_of(segments: WaySegments) -> dict[str, Any]:
    """The ways that these segments are, column by column, as the table has them.

    Class, name and direction are the first segment's, as all of a way are alike; a way is a bridge or tunnel if any of
    it is. ``drives`` are the fewest over anything that was measured of it: all of that rests on so many or more.
    """
    c = segments.columns
    n = len(c["id"])
    ends = np.concatenate([c["from_node"], c["to_node"]])
    place = places(np.tile(c["osm_way_id"], 2), ends, segments.line_deg.transpose(1, 0, 2).reshape(-1, 2))
    chains = chains_of(c["osm_way_id"], c["id"], place[:n], place[n:])
    if not n:
        return {name: [] for name in _COLUMNS}
    rows, begins = chains.rows, chains.first[:-1]
    head, tail = rows[begins], rows[chains.first[1:] - 1]
    measured = Measured(c["length_m"], *(c[name] for name in _SLOPES))
    slopes = slopes_along(chains, measured)
    counted = np.where(c["drives"] > 0, c["drives"], np.iinfo(np.int64).max)[rows]
    fewest = np.minimum.reduceat(counted, begins)
    flags = {k: np.logical_or.reduceat(np.array(c[k], bool)[rows], begins) for k in ("bridge", "tunnel")}
    return {
        **{name: c[name][head] for name in ("id", "osm_way_id", "from_node", "oneway")},
        **{name: [c[name][k] for k in head.tolist()] for name in ("highway", "name")},
        **flags,
        "to_node": c["to_node"][tail],
        "segments": np.diff(chains.first),
        "length_m": slopes.length_m,
        "slope_percent": _known(slopes.slope_percent),
        "slope_sigma_percent": _known(slopes.sigma_percent),
        "drives": np.where(slopes.measured_share > 0, fewest, 0),
        "observations": np.add.reduceat(c["observations"][rows], begins),
        "dem_slope_percent": _known(_mean(c["dem_slope_percent"], c["length_m"], chains)),
        "updated_at": _latest(c["updated_at"], chains),
        "measured_share": np.minimum(slopes.measured_share, 1.0),
        "steepest_percent": _known(slopes.steepest_percent),
        "steepest_from_m": _known(slopes.steepest_from_m),
        "steepest_to_m": _known(slopes.steepest_to_m),
        "geom": _drawn(segments.line_deg, chains, SRID_DEGREES),
        "geom_3857": _drawn(segments.line_3857, chains, SRID_TILES),
    }


def write_ways(session: Session, ways: Collection[int], rows: dict[str, Any]) -> None:
    """Put these rows in the place of all that there are of these ways."""
    ids = np.array(rows["id"], np.int64)
    send_binary(session, _DELETE, {"ways": np.array(sorted(ways), np.int64), "ids": ids})
    if len(ids):
        send_binary(session, _INSERT, rows)


def _known(values: Floats) -> np.ma.MaskedArray[Any, Any]:
    return np.ma.masked_invalid(values)


def _mean(values: Floats, length_m: Floats, chains: Chains) -> Floats:
    """By length, over what is known."""
    known = np.isfinite(values[chains.rows])
    number, rows = chains.number()[known], chains.rows[known]
    weight = np.bincount(number, length_m[rows], minlength=len(chains))
    with np.errstate(invalid="ignore"):
        return np.asarray(
            np.bincount(number, (length_m * values)[rows], minlength=len(chains)) / weight, float
        )


def _latest(moments: Collection[Any], chains: Chains) -> list[Any]:
    moment, latest = list(moments), [None] * len(chains)
    for row, number in zip(chains.rows.tolist(), chains.number().tolist(), strict=True):
        at = moment[row]
        if at is not None and (latest[number] is None or at > latest[number]):
            latest[number] = at
    return latest


def _drawn(line: Floats, chains: Chains, srid: int) -> list[bytes]:
    """The line through all nodes of each chain, as EWKB."""
    begins, number = chains.first[:-1], chains.number()
    points = np.insert(line[chains.rows, 1], begins, line[chains.rows[begins], 0], axis=0)
    indices = np.insert(number, begins, np.arange(len(chains)))
    drawn: NDArray[Any] = shapely.linestrings(points, indices=indices)
    return list(shapely.to_wkb(shapely.set_srid(drawn, srid), include_srid=True))
