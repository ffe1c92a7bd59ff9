"""Road segments in degrees, as a file or a database holds them. Knows no plane and no index: that is ``network``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import Geod

from fusion.frames import METRES_PER_DEGREE
from fusion.types import Floats, Ints

STRETCH_M = 2000.0
"""Of the log that one box holds."""
DETOUR = 0.5
"""Between positions that are apart, roads within so much of their distance may be the way."""
LONGEST_GAP_M = 20_000.0
"""Nobody finds a way through longer gaps: the land between is left out."""
_HIGHEST_DEG = 89.9
_WGS84 = Geod(ellps="WGS84")

DTYPE_OF: dict[str, Any] = {
    **dict.fromkeys(("osm_way_id", "from_node", "to_node"), np.int64),
    **dict.fromkeys(("lon0_deg", "lat0_deg", "lon1_deg", "lat1_deg"), np.float64),
    **dict.fromkeys(("oneway", "layer"), np.int8),
    **dict.fromkeys(("bridge", "tunnel"), np.bool_),
    **dict.fromkeys(("highway", "name"), np.object_),
}
"""What each column of a ``RoadTable`` is made of."""


@dataclass(frozen=True, eq=False)
class RoadTable:
    """n directed road segments: pairs of consecutive nodes of drivable OSM ways, unprojected.

    Every column has shape (n,). Rows are sorted by (osm_way_id, from_node, to_node), which is the segment's
    identity and never repeats; from_node to to_node is the direction in which the way is drawn. Longitudes
    and latitudes are WGS 84 degrees. ``oneway`` is 1 along the way, -1 against it, 0 both. ``layer`` is
    OSM's stacking order. ``name`` holds ``str`` or ``None``. ``skipped`` counts, by reason, the node pairs
    of the source that are not here.
    """

    osm_way_id: Ints
    from_node: Ints
    to_node: Ints
    lon0_deg: Floats
    lat0_deg: Floats
    lon1_deg: Floats
    lat1_deg: Floats
    oneway: NDArray[np.int8]
    bridge: NDArray[np.bool_]
    tunnel: NDArray[np.bool_]
    layer: NDArray[np.int8]
    highway: NDArray[np.object_]
    name: NDArray[np.object_]
    skipped: Counter[str] = field(default_factory=Counter)

    @classmethod
    def columns(cls) -> tuple[str, ...]:
        """The names of the columns, in order."""
        return tuple(spec.name for spec in fields(cls) if spec.name != "skipped")

    @classmethod
    def from_columns(cls, *, skipped: Counter[str] | None = None, **columns: Any) -> RoadTable:
        """Build a table from columns of equal length in any order.

        Rows are sorted; of rows with the same identity the first is kept.
        Raises ``ValueError`` for columns of different lengths.
        """
        given = {column: np.asarray(values, DTYPE_OF[column]) for column, values in columns.items()}
        shapes = {column: values.shape for column, values in given.items()}
        if len(set(shapes.values())) != 1 or len(shapes["osm_way_id"]) != 1:
            raise ValueError(f"the columns of a RoadTable must be vectors of one length, not {shapes}")
        order = np.lexsort((given["to_node"], given["from_node"], given["osm_way_id"]))
        key = np.column_stack([given[c][order] for c in ("osm_way_id", "from_node", "to_node")])
        first = np.ones(len(order), bool)
        first[1:] = np.any(key[1:] != key[:-1], axis=1)
        keep = order[first]
        return cls(**{c: v[keep] for c, v in given.items()}, skipped=Counter(skipped or {}))

    @classmethod
    def empty(cls) -> RoadTable:
        """A table without segments."""
        return cls.from_columns(**dict.fromkeys(cls.columns(), ()))  # type: ignore[arg-type]

    def __len__(self) -> int:
        return len(self.osm_way_id)

    @cached_property
    def length_m(self) -> Floats:
        """Geodesic lengths on WGS 84, metres, shape (n,)."""
        if not len(self):
            return np.empty(0)
        return np.asarray(
            _WGS84.inv(self.lon0_deg, self.lat0_deg, self.lon1_deg, self.lat1_deg)[2], np.float64
        )

    def subset(self, which: NDArray[np.bool_] | Ints) -> RoadTable:
        """The rows selected by a mask or by strictly increasing indices, as the table stays sorted.

        Raises ``ValueError`` for indices that do not increase.
        """
        if which.dtype != np.bool_ and np.any(np.diff(which.astype(np.int64)) <= 0):
            raise ValueError("indices into a RoadTable must increase strictly")
        return replace(self, **{c: getattr(self, c)[which] for c in self.columns()})

    def within(self, west_deg: float, south_deg: float, east_deg: float, north_deg: float) -> RoadTable:
        """The segments whose bounding box meets the given one (WGS 84 degrees)."""
        return self.along(np.array([[west_deg, south_deg, east_deg, north_deg]]))

    def along(self, boxes_deg: Floats) -> RoadTable:
        """The segments whose bounding box meets one of the boxes (m, 4: west, south, east, north)."""
        return self.subset(self.meets(boxes_deg))

    def meets(self, boxes_deg: Floats) -> NDArray[np.bool_]:
        """Whether the bounding box of each segment meets one of the boxes (m, 4), shape (n,)."""
        meets = np.zeros(len(self), np.bool_)
        west, east = np.minimum(self.lon0_deg, self.lon1_deg), np.maximum(self.lon0_deg, self.lon1_deg)
        south, north = np.minimum(self.lat0_deg, self.lat1_deg), np.maximum(self.lat0_deg, self.lat1_deg)
        for left, low, right, high in boxes_deg.tolist():
            meets |= (west <= right) & (east >= left) & (south <= high) & (north >= low)
        return meets

    def bounds_deg(self) -> tuple[float, float, float, float]:
        """(west, south, east, north) of all segments, degrees; raises ``ValueError`` for an empty table."""
        return (
            float(min(self.lon0_deg.min(), self.lon1_deg.min())),
            float(min(self.lat0_deg.min(), self.lat1_deg.min())),
            float(max(self.lon0_deg.max(), self.lon1_deg.max())),
            float(max(self.lat0_deg.max(), self.lat1_deg.max())),
        )


def rows_of(table: RoadTable, part: RoadTable) -> Ints:
    """For each segment of ``part`` its row in ``table``, which holds them all; shape (len(part),).

    Raises ``KeyError`` where one is not in it.
    """
    candidates = np.flatnonzero(np.isin(table.osm_way_id, part.osm_way_id))
    row = dict(zip(identities(table.subset(candidates)), candidates.tolist(), strict=True))
    return np.array([row[identity] for identity in identities(part)], np.int64)


def identities(table: RoadTable) -> Iterator[tuple[int, int, int]]:
    """What each segment is known by: way, from_node, to_node."""
    return zip(table.osm_way_id.tolist(), table.from_node.tolist(), table.to_node.tolist(), strict=True)


def boxes_along(lon_deg: Floats, lat_deg: Floats, margin_m: float) -> Floats:
    """Boxes (m, 4: west, south, east, north; degrees) that hold all within about ``margin_m`` of positions (n,) and of
    the ways between them, more where positions are far apart; shape (0, 4) without any. They overlap.
    """
    known = np.isfinite(lon_deg) & np.isfinite(lat_deg)
    lon, lat = lon_deg[known], lat_deg[known]
    if not len(lon):
        return np.empty((0, 4))
    narrow = np.cos(np.radians(np.minimum(np.abs(lat), _HIGHEST_DEG)))
    step_m = METRES_PER_DEGREE * np.hypot(np.diff(lon) * narrow[:-1], np.diff(lat))
    bridged = step_m <= LONGEST_GAP_M
    # From each position to the next, but over a gap that nothing bridges; the last one stands for itself.
    to = np.arange(len(lon)) + np.append(bridged, False)
    gap_m = np.append(np.where(bridged, step_m, 0.0), 0.0)
    along_m = np.concatenate([[0.0], np.cumsum(step_m)])
    new = np.append(True, (np.diff(np.floor(along_m / STRETCH_M)) != 0) | ~bridged)
    first = np.flatnonzero(new)
    west = np.minimum.reduceat(np.minimum(lon, lon[to]), first)
    south = np.minimum.reduceat(np.minimum(lat, lat[to]), first)
    east = np.maximum.reduceat(np.maximum(lon, lon[to]), first)
    north = np.maximum.reduceat(np.maximum(lat, lat[to]), first)
    wider = (
        margin_m + DETOUR * np.maximum.reduceat(np.maximum(gap_m - margin_m, 0.0), first)
    ) / METRES_PER_DEGREE
    farthest = np.minimum(np.maximum(np.abs(south), np.abs(north)) + wider, _HIGHEST_DEG)
    across = wider / np.cos(np.radians(farthest))
    return np.column_stack([west - across, south - wider, east + across, north + wider])
