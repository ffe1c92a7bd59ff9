"""The roads near places, and what joins bridges and tunnels to the ground, out of the database."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from sqlalchemy.orm import Session

from app.core.db import fetch_binary
from fusion.frames import METRES_PER_DEGREE
from fusion.types import Floats

_COLUMNS = """
    s.id, s.from_node, s.to_node, ST_X(ST_StartPoint(s.geom)), ST_Y(ST_StartPoint(s.geom)),
    ST_X(ST_EndPoint(s.geom)), ST_Y(ST_EndPoint(s.geom)), s.length_m, s.bridge OR s.tunnel, a.height_from_m,
    a.height_to_m, a.height_sigma_m, a.slope_sigma_percent, a.steepest_percent, a.steepest_from_m, a.steepest_to_m,
    s.dem_heights_m
"""

# A box around each place, which the index knows; what of it is really near is for the caller.
_NEAR = f"""
    SELECT p.n - 1, {_COLUMNS}
    FROM unnest(%(lon)s::float8[], %(lat)s::float8[], %(wide)s::float8[]) WITH ORDINALITY AS p (lon, lat, wide, n)
    JOIN segments AS s ON s.geom && ST_MakeEnvelope(p.lon - p.wide, p.lat - %(high)s, p.lon + p.wide, p.lat + %(high)s,
                                                    4326)
    LEFT JOIN segment_slopes AS a ON a.segment_id = s.id
    ORDER BY p.n, s.id
"""  # noqa: S608 - constants

# All that meets at nodes, by their places: nodes have no index of their own, places have.
_AT_NODES = f"""
    SELECT DISTINCT ON (s.id) {_COLUMNS}
    FROM unnest(%(node)s::bigint[], %(lon)s::float8[], %(lat)s::float8[]) AS p (node, lon, lat)
    JOIN segments AS s ON s.geom && ST_Expand(ST_SetSRID(ST_MakePoint(p.lon, p.lat), 4326), 1e-7)
        AND (s.from_node = p.node OR s.to_node = p.node)
    LEFT JOIN segment_slopes AS a ON a.segment_id = s.id
    ORDER BY s.id
"""  # noqa: S608 - constants


_ONE = f"""
    SELECT coalesce(a.drives, 0), {_COLUMNS}
    FROM segments AS s LEFT JOIN segment_slopes AS a ON a.segment_id = s.id
    WHERE s.id = %(id)s
"""  # noqa: S608 - constants


_BY_IDS = f"""
    SELECT {_COLUMNS}
    FROM segments AS s LEFT JOIN segment_slopes AS a ON a.segment_id = s.id
    WHERE s.id = ANY(%(ids)s::bigint[])
"""  # noqa: S608 - constants


@dataclass(frozen=True)
class RoadHere:
    """A segment with what is known of its heights, metres; None where that is unknown.

    Measured heights are those of the network at its nodes; ``dem_heights_m`` are the elevation model's at its knots, at
    equal distances from ``from_node`` to ``to_node``, NaN where that has none.
    """

    id: int
    from_node: int
    to_node: int
    lon0_deg: float
    lat0_deg: float
    lon1_deg: float
    lat1_deg: float
    length_m: float
    structure: bool
    """A bridge or tunnel: the ground's height says nothing of it."""
    height_from_m: float | None
    height_to_m: float | None
    height_sigma_m: float | None
    slope_sigma_percent: float | None
    steepest_percent: float | None
    steepest_from_m: float | None
    steepest_to_m: float | None
    dem_heights_m: list[float] | None

    @property
    def measured(self) -> bool:
        """Whether the network has heights of both nodes."""
        return self.height_from_m is not None and self.height_to_m is not None

    @property
    def nodes(self) -> tuple[int, int]:
        """Its ends."""
        return self.from_node, self.to_node


def roads_near(session: Session, places: Floats, radius_m: float) -> list[list[RoadHere]]:
    """For each of the places, shape (n, 2), the segments whose box comes within ``radius_m`` of it; one statement."""
    wide = radius_m / (METRES_PER_DEGREE * np.maximum(np.cos(np.radians(places[:, 1])), 0.01))
    values = {"lon": places[:, 0], "lat": places[:, 1], "wide": wide, "high": radius_m / METRES_PER_DEGREE}
    near: list[list[RoadHere]] = [[] for _ in range(len(places))]
    known: dict[int, RoadHere] = {}
    for n, *columns in fetch_binary(session, _NEAR, values):
        near[n].append(known.setdefault(columns[0], RoadHere(*columns)))
    return near


def roads_at(session: Session, nodes: dict[int, tuple[float, float]]) -> list[RoadHere]:
    """The segments that meet at these nodes, which lie at longitude and latitude."""
    values = {
        "node": np.array(list(nodes), np.int64),
        "lon": np.array([lon for lon, _ in nodes.values()]),
        "lat": np.array([lat for _, lat in nodes.values()]),
    }
    return [RoadHere(*columns) for columns in fetch_binary(session, _AT_NODES, values)]


def one_road(session: Session, segment_id: int) -> tuple[RoadHere, int] | None:
    """A segment by its number, and how many drives measured it: 0 of a gap, whose heights are its neighbours'."""
    for drives, *columns in fetch_binary(session, _ONE, {"id": segment_id}):
        return RoadHere(*columns), int(drives)
    return None


def roads_of(session: Session, ids: Sequence[int]) -> dict[int, RoadHere]:
    """Segments by their numbers; those that there are."""
    values = {"ids": np.array(ids, np.int64)}
    return {columns[0]: RoadHere(*columns) for columns in fetch_binary(session, _BY_IDS, values)}
