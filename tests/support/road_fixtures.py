"""Road networks for tests, made from plain coordinates."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import ArrayLike

from fusion.frames import LocalProjection
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable

MakeTable = Callable[..., RoadTable]
MakeNetwork = Callable[..., RoadNetwork]


def table_of(
    lon0: ArrayLike, lat0: ArrayLike, lon1: ArrayLike, lat1: ArrayLike, oneway: ArrayLike = 0
) -> RoadTable:
    """One way per segment, numbered in order."""
    n = len(np.atleast_1d(lon0))
    return RoadTable.from_columns(
        osm_way_id=np.arange(n),
        from_node=2 * np.arange(n),
        to_node=2 * np.arange(n) + 1,
        lon0_deg=lon0,
        lat0_deg=lat0,
        lon1_deg=lon1,
        lat1_deg=lat1,
        oneway=np.broadcast_to(oneway, n),
        bridge=np.zeros(n, bool),
        tunnel=np.zeros(n, bool),
        layer=np.zeros(n),
        highway=["residential"] * n,
        name=[None] * n,
    )


def network_of(ends: ArrayLike, oneway: ArrayLike = 0) -> RoadNetwork:
    """A network with exactly these ends, shape (n, 4): x0 y0 x1 y1 in metres."""
    x0, y0, x1, y1 = (np.ascontiguousarray(c) for c in np.asarray(ends, float).reshape(-1, 4).T)
    plane = LocalProjection(8.0, 49.0)
    table = table_of(*plane.to_lonlat(x0, y0), *plane.to_lonlat(x1, y1), oneway)
    return RoadNetwork(table, plane, x0, y0, x1, y1, np.hypot(x1 - x0, y1 - y0), np.arctan2(y1 - y0, x1 - x0))


@pytest.fixture(scope="session")
def make_table() -> MakeTable:
    """``make_table(lon0, lat0, lon1, lat1, oneway=0)``."""
    return table_of


@pytest.fixture(scope="session")
def make_network() -> MakeNetwork:
    """``make_network(ends, oneway=0)``."""
    return network_of
