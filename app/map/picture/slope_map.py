"""What a map of slopes shows: the roads in a box, each with its slope; how wide lines are, and where arrows stand.

How that is drawn is in ``app.map.picture.slope_picture``: here is no matplotlib.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from app.core.messages import say
from app.map.segment import Segment
from fusion.errors import FusionError, UnknownNameError
from fusion.frames import METRES_PER_DEGREE
from fusion.roads.table import RoadTable
from fusion.types import Floats

if TYPE_CHECKING:
    from app.core.db import Bounds

SURE_SIGMA_PERCENT, UNSURE_SIGMA_PERCENT = 0.3, 3.0
SURE_WIDTH_PT, UNSURE_WIDTH_PT = 5.0, 1.2
"""Lines are widest at the first sigma and below, narrowest at the second and above."""
DOUBT = 1.96  # an arrow needs a slope whose sign is beyond 95 % doubt
ARROW_PERCENT = 1.0  # and steeper than this
MOST_SEGMENTS = 50_000
"""A map shows no more: beyond, streets of a page merge, and a file of lines takes some ten megabytes."""
FARTHEST_M = 600_000.0
"""Longest side of a map: the plane that it is drawn on stretches farther ones visibly."""
AROUND_SHARE, LEAST_AROUND_M = 0.08, 30.0
"""What is shown around the measured roads: a share of their extent, and no less than so many metres."""
LEAST_SIDE_SHARE = 0.36
"""Of the longer side of a map, how long the shorter one is at least: a drive along one street is a thin line."""


PICTURES = (".png", ".pdf", ".svg")
"""What pictures may be written as; the suffix chooses. The latter two hold lines and letters, not pixels."""


class MapError(FusionError):
    """What is asked for makes no map."""

    kind = "map"


@dataclass(frozen=True)
class MapSegments:
    """What the map draws, n segments: slope and sigma in percent (NaN where unknown)."""

    ends_deg: Floats
    """Longitude and latitude of both ends, (n, 2, 2)."""
    slope_percent: Floats
    slope_sigma_percent: Floats
    bridge: NDArray[np.bool_]
    tunnel: NDArray[np.bool_]
    name: NDArray[np.object_]
    """Of the street, ``str`` or None."""

    def __len__(self) -> int:
        return len(self.ends_deg)

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which segments have a slope."""
        return np.isfinite(self.slope_percent)

    def within(self, box_deg: Bounds) -> MapSegments:
        """Those whose bounding box meets the given one."""
        west, south, east, north = box_deg
        low, high = self.ends_deg.min(axis=1), self.ends_deg.max(axis=1)
        meets = np.all((low <= (east, north)) & (high >= (west, south)), axis=1)
        return replace(self, **{spec.name: getattr(self, spec.name)[meets] for spec in fields(self)})


def picture_format(path: Path) -> str:
    """png, pdf or svg, as the suffix says; raises ``UnknownNameError`` that lists them for any other."""
    suffix = path.suffix.lower()
    if suffix not in PICTURES:
        raise UnknownNameError(say("picture.no_suffix", suffix=path.suffix, names=", ".join(PICTURES)))
    return suffix[1:]


def map_segments(roads: RoadTable, segments: Iterable[Segment]) -> MapSegments:
    """The roads with the slopes of those of the segments that are among them."""
    known = {(s.osm_way_id, s.from_node, s.to_node): s for s in segments if s.slope_percent is not None}
    keys = zip(roads.osm_way_id.tolist(), roads.from_node.tolist(), roads.to_node.tolist(), strict=True)
    rows = [known.get(key) for key in keys]
    return MapSegments(
        np.column_stack([roads.lon0_deg, roads.lat0_deg, roads.lon1_deg, roads.lat1_deg]).reshape(-1, 2, 2),
        _column(None if s is None else s.slope_percent for s in rows),
        _column(None if s is None else s.slope_sigma_percent for s in rows),
        roads.bridge,
        roads.tunnel,
        roads.name,
    )


def stored_segments(segments: Iterable[Segment]) -> MapSegments:
    """The same of segments that bring their own line, of which the ends count."""
    rows = list(segments)
    return MapSegments(
        np.array([(s.coordinates[0], s.coordinates[-1]) for s in rows], float).reshape(-1, 2, 2),
        _column(s.slope_percent for s in rows),
        _column(s.slope_sigma_percent for s in rows),
        np.array([s.bridge for s in rows], np.bool_),
        np.array([s.tunnel for s in rows], np.bool_),
        np.array([s.name for s in rows], np.object_),
    )


def _column(values: Iterable[float | None]) -> Floats:
    return np.array([np.nan if value is None else value for value in values], float)


def extent_of(segments: Iterable[Segment]) -> Bounds:
    """West, south, east, north of segments, degrees; raises ``MapError`` without any."""
    corners = np.array([p for s in segments for p in s.coordinates], float).reshape(-1, 2)
    if not len(corners):
        raise MapError(say("picture.no_slope"))
    return box_of(corners)


def box_of(places_deg: Floats) -> Bounds:
    """West, south, east, north of places (n, 2), at least one."""
    (west, south), (east, north) = places_deg.min(axis=0).tolist(), places_deg.max(axis=0).tolist()
    return west, south, east, north


def frame_around(extent_deg: Bounds) -> Bounds:
    """The box that a map of these measured roads shows: with some land around them, and no mere strip."""
    across_m, up_m = sides_m(extent_deg)
    around = max(AROUND_SHARE * max(across_m, up_m), LEAST_AROUND_M)
    return no_strip(_grown(extent_deg, around, around))


def no_strip(box_deg: Bounds) -> Bounds:
    """The box, its shorter side made longer where it is a strip; raises ``MapError`` for one beyond ``FARTHEST_M``."""
    across_m, up_m = sides_m(box_deg)
    longer = max(across_m, up_m, 1.0)
    if longer > FARTHEST_M:
        raise MapError(say("picture.too_far", km=longer / 1000, most_km=FARTHEST_M / 1000))
    least = LEAST_SIDE_SHARE * longer
    return _grown(box_deg, max(least - across_m, 0.0) / 2, max(least - up_m, 0.0) / 2)


def sides_m(box_deg: Bounds) -> tuple[float, float]:
    """How far a box reaches from west to east, at the latitude of its middle, and from south to north."""
    west, south, east, north = box_deg
    narrow = float(np.cos(np.radians((south + north) / 2)))
    return (east - west) * METRES_PER_DEGREE * narrow, (north - south) * METRES_PER_DEGREE


def _grown(box_deg: Bounds, across_m: float, up_m: float) -> Bounds:
    west, south, east, north = box_deg
    narrow = max(float(np.cos(np.radians((south + north) / 2))), 1e-3)
    across, up = across_m / METRES_PER_DEGREE / narrow, up_m / METRES_PER_DEGREE
    return west - across, south - up, east + across, north + up


def line_widths(sigma_percent: Floats) -> Floats:
    """Width in points per sigma in percent: wide where sure; logarithmic, clipped; NaN is unsure."""
    sigma = np.where(np.isfinite(sigma_percent), sigma_percent, UNSURE_SIGMA_PERCENT)
    sigma = np.clip(sigma, SURE_SIGMA_PERCENT, UNSURE_SIGMA_PERCENT)
    doubt = np.log(sigma / SURE_SIGMA_PERCENT) / np.log(UNSURE_SIGMA_PERCENT / SURE_SIGMA_PERCENT)
    return np.asarray(SURE_WIDTH_PT + doubt * (UNSURE_WIDTH_PT - SURE_WIDTH_PT), float)


def certain_signs(slope_percent: Floats, sigma_percent: Floats) -> NDArray[np.bool_]:
    """Which slopes (n,) are steep and lead up or down beyond doubt."""
    doubt = DOUBT * np.where(np.isfinite(sigma_percent), sigma_percent, np.inf)
    return np.asarray(np.abs(slope_percent) > np.maximum(doubt, ARROW_PERCENT), np.bool_)


def arrow_choice(
    middle_m: Floats, slope_percent: Floats, sigma_percent: Floats, spacing_m: float
) -> NDArray[np.int64]:
    """Indices of segments that get an uphill arrow: steep and of a certain sign, steepest first, ``spacing_m``
    apart.

    ``middle_m`` has shape (n, 2).
    """
    sure = certain_signs(slope_percent, sigma_percent)
    chosen: list[int] = []
    for i in np.argsort(-np.abs(np.where(sure, slope_percent, 0.0)), kind="stable"):
        if not sure[i]:
            break
        apart = np.hypot(*(middle_m[chosen] - middle_m[i]).T)
        if not chosen or apart.min() >= spacing_m:
            chosen.append(int(i))
    return np.array(chosen, np.int64)
