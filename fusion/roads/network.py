"""Road segments on a metric plane, with an index. Knows no drive and no heights."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from fusion.frames import LocalProjection
from fusion.roads.grid import SegmentGrid, build_grid
from fusion.roads.table import RoadTable
from fusion.types import Floats


@dataclass(frozen=True, eq=False)
class RoadNetwork:
    """A ``RoadTable`` projected to metres. Segment s runs from (x0, y0)[s] to (x1, y1)[s], x east, y north.

    ``length_m`` is the length in the plane, ``heading_rad`` the direction from from_node to to_node in the
    mathematical convention: from east, anticlockwise, (-pi, pi]. All columns have shape (n,).
    """

    table: RoadTable
    projection: LocalProjection
    x0: Floats
    y0: Floats
    x1: Floats
    y1: Floats
    length_m: Floats
    heading_rad: Floats

    @classmethod
    def project(cls, table: RoadTable, projection: LocalProjection | None = None) -> RoadNetwork:
        """Project a table, by default to the plane around its own extent.

        Raises ``ValueError`` for an empty table without a projection and for unprojectable segments.
        """
        if projection is None:
            if not len(table):
                raise ValueError("an empty RoadTable has no extent to project around; give a projection")
            west, south, east, north = table.bounds_deg()
            projection = LocalProjection.around(np.array([west, east]), np.array([south, north]))
        x0, y0 = (np.ascontiguousarray(v) for v in projection.to_xy(table.lon0_deg, table.lat0_deg))
        x1, y1 = (np.ascontiguousarray(v) for v in projection.to_xy(table.lon1_deg, table.lat1_deg))
        if not all(np.isfinite(v).all() for v in (x0, y0, x1, y1)):
            raise ValueError("a segment lies too far from the centre of the projection")
        return cls(
            table, projection, x0, y0, x1, y1, np.hypot(x1 - x0, y1 - y0), np.arctan2(y1 - y0 + 0.0, x1 - x0)
        )

    def __len__(self) -> int:
        return len(self.x0)

    @cached_property
    def grid(self) -> SegmentGrid:
        """The segments and their spatial index, for compiled loops; built at first use."""
        return build_grid(self.x0, self.y0, self.x1, self.y1, np.ascontiguousarray(self.table.oneway))

    def project_points(
        self, x_m: ArrayLike, y_m: ArrayLike, segment: ArrayLike
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Nearest points of given segments: (x, y, distance along from from_node, offset), all metres.

        The three arguments broadcast; ``segment`` indexes the network. The points are clamped to the ends of
        the segment; the offset is the distance from (x_m, y_m), never negative.
        """
        s = np.asarray(segment, np.int64)
        x, y = np.asarray(x_m, np.float64), np.asarray(y_m, np.float64)
        dx, dy = self.x1[s] - self.x0[s], self.y1[s] - self.y0[s]
        square = self.length_m[s] ** 2
        along = (x - self.x0[s]) * dx + (y - self.y0[s]) * dy
        share = np.clip(along / np.where(square > 0, square, 1.0), 0.0, 1.0)
        px, py = self.x0[s] + share * dx, self.y0[s] + share * dy
        return px, py, share * self.length_m[s], np.hypot(px - x, py - y)
