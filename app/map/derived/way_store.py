"""Segments of ways out of the database, what was measured of each chain of them, and ways into the database.

Of a chain: its slope, how sure that is, and where it is steepest. All segments of a chain run in its direction. What is
not known of a segment is NaN and counts nothing: unknown is never 0.
"""

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
from app.map.derived.lines import lines
from app.map.segment import SQL_TYPES, Segment, Way
from fusion.network.segment_slopes import PLACE_SIGMA_M, lane_variance
from fusion.network.steepest import STRETCH_M
from fusion.types import Bools, Floats, Ints

_UNIT = 1e-8
"""Of sums along chains, m (of heights, hundredths of it)."""
_EQUAL = 1e-9
"""Of stretches as steep as each other the first counts; rounding must not choose."""


@dataclass(frozen=True, eq=False)
class Measured:
    """Of n segments what drives measured, shape (n,) each; slopes of what none did (gaps too) are NaN."""

    length_m: Floats
    slope_percent: Floats
    slope_sigma_percent: Floats
    height_from_m: Floats
    height_to_m: Floats
    height_sigma_m: Floats
    steepest_percent: Floats
    steepest_from_m: Floats
    steepest_to_m: Floats

    def along(self, rows: Ints) -> Measured:
        """These rows in this order."""
        return Measured(**{name: values[rows] for name, values in vars(self).items()})


@dataclass(frozen=True, eq=False)
class ChainSlopes:
    """Of m chains, shape (m,); NaN where nothing was measured."""

    length_m: Floats
    slope_percent: Floats
    slope_sigma_percent: Floats
    measured_share: Floats
    steepest_percent: Floats
    steepest_from_m: Floats
    steepest_to_m: Floats


def slopes_along(chains: Chains, segments: Measured) -> ChainSlopes:
    """The mean slope over what was measured of each chain, by length, and the steepest ``STRETCH_M`` of it.

    Errors of neighbours go together, so the sigma of their mean is not smaller for being a mean: it is theirs, by
    length, which is right if they err as one and too large otherwise. What the network knows of the heights at both
    ends of a measured stretch often says more: it counts where it does (``_rise_sigma_m``). Stretches with a gap
    between them are taken to err as one, too.
    """
    s, chain, m = segments.along(chains.rows), chains.number(), len(chains)
    known = np.isfinite(s.slope_percent)
    length = np.asarray(np.bincount(chain, s.length_m, minlength=m), float)
    run = _runs(known, chain)
    measured_m = np.bincount(chain[known], s.length_m[known], minlength=m)
    rise = np.bincount(chain[known], (s.length_m * s.slope_percent)[known], minlength=m)
    first = np.flatnonzero(np.diff(run, prepend=-1) > 0)
    sigma_m = np.bincount(chain[first], _rise_sigma_m(s, known, run, first), minlength=m)
    with np.errstate(invalid="ignore"):
        slope, sigma = rise / measured_m, 100 * sigma_m / measured_m
    offset = _whole(s.length_m)[:-1]
    offset = offset - offset[chains.first[:-1]][chain]
    steepest, begin, end = _steepest(s, known, run, chain, offset, m)
    end = np.minimum(end, length)
    return ChainSlopes(length, slope, sigma, measured_m / length, steepest, begin, end)


def _whole(values: Floats) -> Ints:
    """Sums from 0 on, in whole ``_UNIT``: else the last digits would depend on what other chains come before."""
    return np.concatenate([[0], np.cumsum(np.rint(values / _UNIT).astype(np.int64))])


def _within(x: Ints, at: Ints) -> tuple[Ints, Floats]:
    """The segments between borders ``x`` that places lie in, and how far inside, m."""
    segment = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    return np.asarray(segment, np.int64), np.asarray(_UNIT * (at - x[segment]), float)


def _runs(known: Bools, chain: Ints) -> Ints:
    """The number of the uninterrupted measured stretch that each segment is in, growing; -1 where it is in none."""
    before = np.concatenate([[False], known[:-1]]) & (np.diff(chain, prepend=-1) == 0)
    return np.where(known, np.cumsum(known & ~before) - 1, -1)


def _rise_sigma_m(s: Measured, known: Bools, run: Ints, first: Ints) -> Floats:
    """One standard deviation of how far each run rises, (runs,), m: the smaller of two that both are too large.

    One takes its segments to err as one. The other is of the heights at its ends, as if these erred apart from each
    other, while all heights about a place err together; to it comes what the two say differently of the rise, the
    lane's own height, and that nodes lie ``PLACE_SIGMA_M`` beside where the map has them, where the grade is not the
    mean.
    """
    n = len(first)
    mine, number = np.flatnonzero(known), run[known]
    together = np.bincount(number, (s.length_m * s.slope_sigma_percent)[mine], minlength=n) / 100
    rise = np.bincount(number, (s.length_m * s.slope_percent)[mine], minlength=n) / 100
    length = np.bincount(number, s.length_m[mine], minlength=n)
    last = mine[np.searchsorted(number, np.arange(n), side="right") - 1]
    variance = s.height_sigma_m[first] ** 2 + s.height_sigma_m[last] ** 2
    variance += (s.height_to_m[last] - s.height_from_m[first] - rise) ** 2
    variance += lane_variance(np.asarray(length, float)) * length**2
    for end in (first, last):
        variance += (PLACE_SIGMA_M * (s.slope_percent[end] / 100 - rise / length)) ** 2
    alone = last == first
    return np.where(alone, together, np.fmin(together, np.sqrt(variance)))


def _steepest(
    s: Measured, known: Bools, run: Ints, chain: Ints, offset: Ints, chains: int
) -> tuple[Floats, Floats, Floats]:
    """Mean grade over the steepest stretch of each chain, %, and where it begins and ends, m from the chain's start.

    Of the heights inside segments only their own steepest stretch is kept; between nodes they are taken for straight.
    So every stretch of ``STRETCH_M`` that begins or ends at a node and lies in one measured run is looked at, which
    finds the steepest of straight pieces, and each segment's own. A chain of which no run is so long has that of the
    steepest of its runs, over all of the run.
    """
    mine = np.flatnonzero(known)
    if not len(mine):
        return np.full(chains, np.nan), np.full(chains, np.nan), np.full(chains, np.nan)
    slope, number = s.slope_percent[mine], run[mine]
    # All runs on one axis: where each segment begins and ends, and the heights there above where the first began.
    x, height = _whole(s.length_m[mine]), _whole(s.length_m[mine] * slope)
    runs = np.arange(number[-1] + 1)
    low = x[:-1][np.searchsorted(number, runs)][number]
    high = x[1:][np.searchsorted(number, runs, side="right") - 1][number]
    stretch = round(STRETCH_M / _UNIT)
    begin = np.concatenate([x[:-1], np.maximum(x[1:] - stretch, low)])
    end = np.concatenate([np.minimum(x[:-1] + stretch, high), x[1:]])
    ((i, left), (j, right)) = (_within(x, at) for at in (begin, end))
    rise = _UNIT * (height[j] - height[i]) + slope[j] * right - slope[i] * left
    grade = np.concatenate([rise / (_UNIT * (end - begin)), s.steepest_percent[mine]])
    # From the run's axis to the chain's.
    shift = np.tile(offset[mine] - x[:-1], 2)
    where = np.concatenate([_UNIT * (begin + shift), _UNIT * offset[mine] + s.steepest_from_m[mine]])
    until = np.concatenate([_UNIT * (end + shift), _UNIT * offset[mine] + s.steepest_to_m[mine]])
    of = np.tile(chain[mine], 3)
    full = (until - where) >= STRETCH_M - 1e-6
    usable = np.isfinite(grade + where + until)
    any_whole = np.zeros(chains, bool)
    any_whole[of[full & usable]] = True
    # A run that is shorter than the stretch counts as a whole, and only where no run is as long as that.
    entire = np.concatenate(
        [(begin <= np.tile(low, 2)) & (end >= np.tile(high, 2)), np.zeros(len(mine), bool)]
    )
    usable &= np.where(any_whole[of], full, entire)
    return _first_steepest(of[usable], grade[usable], where[usable], until[usable], chains)


def _first_steepest(
    of: Ints, grade: Floats, where: Floats, until: Floats, chains: int
) -> tuple[Floats, Floats, Floats]:
    most = np.full(chains, -1.0)
    np.maximum.at(most, of, np.abs(grade))
    steep = np.flatnonzero(np.abs(grade) >= most[of] - _EQUAL * np.maximum(1.0, most[of]))
    steep = steep[np.lexsort((where[steep], of[steep]))]
    chain, at = np.unique(of[steep], return_index=True)
    out = np.full((3, chains), np.nan)
    out[:, chain] = grade[steep[at]], where[steep[at]], until[steep[at]]
    return out[0], out[1], out[2]


_DERIVED = "steepness_percent"
"""Stored nowhere."""
_OF_SEGMENTS = {
    name: column for name, column in Segment.columns.items() if name not in {"driven_share", _DERIVED}
}
_NUMPY_TYPES: dict[str, type] = {"integer": np.int64, "number": float}

# A gap's slope is measured by nobody. What is not followed yet is not derived from yet, or nobody would know of it when
# it goes (``app.map.derived``).
_SEGMENTS = f"""
    SELECT {", ".join(column.sql for column in _OF_SEGMENTS.values())}, s.geom, s.geom_3857
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
_COLUMNS = {name: SQL_TYPES[column.kind] for name, column in Way.columns.items() if name != _DERIVED}
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
    columns = list(zip(*rows, strict=True)) or [()] * (len(_OF_SEGMENTS) + 2)
    named: dict[str, Any] = {
        name: np.array(values, _NUMPY_TYPES.get(column.kind, object))
        for (name, column), values in zip(_OF_SEGMENTS.items(), columns, strict=False)
    }
    return WaySegments(named, lines(columns[-2]), lines(columns[-1]))


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
    slopes = slopes_along(chains, Measured(**{name: c[name] for name in Measured.__dataclass_fields__}))
    counted = np.where(c["drives"] > 0, c["drives"], np.iinfo(np.int64).max)[rows]
    fewest = np.minimum.reduceat(counted, begins)
    flags = {k: np.logical_or.reduceat(np.array(c[k], bool)[rows], begins) for k in ("bridge", "tunnel")}
    return {
        **{name: c[name][head] for name in ("id", "osm_way_id", "from_node", "oneway")},
        **{name: [c[name][k] for k in head.tolist()] for name in ("highway", "name")},
        **flags,
        "to_node": c["to_node"][tail],
        "segments": np.diff(chains.first),
        **{name: np.ma.masked_invalid(values) for name, values in vars(slopes).items()},
        "measured_share": np.minimum(slopes.measured_share, 1.0),
        "drives": np.where(slopes.measured_share > 0, fewest, 0),
        "observations": np.add.reduceat(c["observations"][rows], begins),
        "dem_slope_percent": np.ma.masked_invalid(_mean(c["dem_slope_percent"], c["length_m"], chains)),
        "updated_at": _latest(c["updated_at"], chains),
        "geom": _drawn(segments.line_deg, chains, SRID_DEGREES),
        "geom_3857": _drawn(segments.line_3857, chains, SRID_TILES),
    }


def write_ways(session: Session, ways: Collection[int], rows: dict[str, Any]) -> None:
    """Put these rows in the place of all that there are of these ways."""
    ids = np.array(rows["id"], np.int64)
    send_binary(session, _DELETE, {"ways": np.array(sorted(ways), np.int64), "ids": ids})
    if len(ids):
        send_binary(session, _INSERT, rows)


def _mean(values: Floats, length_m: Floats, chains: Chains) -> Floats:
    """By length, over what is known."""
    known = np.isfinite(values[chains.rows])
    number, rows = chains.number()[known], chains.rows[known]
    weight = np.bincount(number, length_m[rows], minlength=len(chains))
    total = np.bincount(number, (length_m * values)[rows], minlength=len(chains))
    with np.errstate(invalid="ignore"):
        return np.asarray(total / weight, float)


def _latest(moments: Collection[Any], chains: Chains) -> list[Any]:
    parts = np.split(np.asarray(moments, object)[chains.rows], chains.first[1:-1])
    return [max((at for at in part.tolist() if at is not None), default=None) for part in parts]


def _drawn(line: Floats, chains: Chains, srid: int) -> list[bytes]:
    """The line through all nodes of each chain, as EWKB."""
    begins, number = chains.first[:-1], chains.number()
    points = np.insert(line[chains.rows, 1], begins, line[chains.rows[begins], 0], axis=0)
    indices = np.insert(number, begins, np.arange(len(chains)))
    drawn: NDArray[Any] = shapely.linestrings(points, indices=indices)
    return list(shapely.to_wkb(shapely.set_srid(drawn, srid), include_srid=True))
