"""The stored map as formats read it: chains of ways, files of roads and what is told where they are missing."""

from __future__ import annotations

from typing import Any

import pytest

from app.core.db import Sessions
from app.exports.source import Query, Source
from app.map.segment import Segment
from fusion.errors import RoadsError
from road_support import replace_roads

Mapped = Any  # of conftest, which cannot be imported
ONE = Segment(
    id=1, osm_way_id=7, from_node=1, to_node=2, length_m=50.0, highway="track", name=None, oneway=0, bridge=False,
    tunnel=False, slope_percent=None, slope_sigma_percent=None, drives=0, observations=0, dem_slope_percent=None,
    updated_at=None, coordinates=((8.0, 49.0), (8.1, 49.1)),
)  # fmt: skip


def test_roads_without_a_file_are_told(sessions: Sessions, chain: Any, tmp_path: Any) -> None:
    with sessions() as session, pytest.raises(RoadsError, match="There are no roads yet"):
        _ = Source(session, tmp_path, Query()).road_files
    with sessions.begin() as session:
        replace_roads(session, chain(), "chain.osm", "0" * 64)
    with sessions() as session, pytest.raises(RoadsError, match="Of region 'roads' no file is kept"):
        _ = Source(session, tmp_path, Query()).road_files
