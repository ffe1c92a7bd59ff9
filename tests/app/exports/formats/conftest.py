"""The simulated town as a map that drives measured in part: what formats for other programs are written from."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sqlalchemy import text

from app.core import databases
from app.core.db import Bounds, Sessions, make_engine, session_factory
from app.embedded.cluster import EmbeddedPostgres
from app.exports.formats import FORMATS
from app.exports.source import Query, Source
from app.roads.imports import import_roads
from app.terrain.imports import import_dem
from fusion.simulate.scene.town import Town
from fusion.simulate.write.dem_file import write_dem
from fusion.simulate.write.osm_file import write_osm

OFFSET_M = 3.0
"""What the receivers' datum is above that of the elevation model."""
STATED = {"attribution": "Roads © OpenStreetMap contributors, ODbL", "height_datum": "mean sea level & so on"}

_MEASURED = text(
    """
    INSERT INTO segment_slopes (segment_id, slope_percent, slope_sigma_percent, drives, observations, driven_share,
        height_from_m, height_to_m, height_sigma_m, steepest_percent, steepest_from_m, steepest_to_m)
    SELECT s.id, m.slope, 0.3, 3, 40, 1.0, m.height_from, m.height_to, 0.4 + 0 * m.height_to,
        m.slope, 0, least(s.length_m, 20)
    FROM unnest(CAST(:way AS bigint[]), CAST(:a AS bigint[]), CAST(:b AS bigint[]), CAST(:slope AS float8[]),
                CAST(:height_from AS float8[]), CAST(:height_to AS float8[]))
        AS m (way, a, b, slope, height_from, height_to)
    JOIN segments AS s ON (s.osm_way_id, s.from_node, s.to_node) = (m.way, m.a, m.b)
    """
)


@dataclass(frozen=True)
class Mapped:
    """A database that knows the town, the folder of its rasters and roads, and what was measured.

    ``heights``: of nodes; segments of every fourth way have neither slope nor height, of the next a slope alone.
    """

    sessions: Sessions
    place: Path
    town: Town
    osm: Path
    heights: dict[int, float]

    @contextmanager
    def source(self, bbox: Bounds | None = None) -> Iterator[Source]:
        with self.sessions() as session:
            yield Source(session, self.place, Query(bbox))

    def write(
        self, name: str, path: Path, bbox: Bounds | None = None, **options: Any
    ) -> tuple[int, list[str]]:
        """Write a file; what it counts, and what it notes."""
        with self.source(bbox) as source:
            form = FORMATS[name]
            count = form.write(source, path, STATED, form.parse_options(options, local=True))
            return count, source.notes


@pytest.fixture(scope="session")
def mapped(
    cluster: EmbeddedPostgres,
    template_db: str,
    new_database: Callable[[str], str],
    town: Town,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Mapped]:
    """The town with its elevation model; read by tests, changed by none."""
    folder = tmp_path_factory.mktemp("handed")
    write_osm(town, folder / "town.osm")
    write_dem(town, folder / "town.tif")
    name = new_database(template_db)
    engine = make_engine(cluster.url_of(name))
    sessions = session_factory(engine)
    import_roads(sessions, folder / "town.osm", folder / "dem")
    import_dem(sessions, [folder / "town.tif"], folder / "dem")
    heights = _measure(sessions, town)
    yield Mapped(sessions, folder / "dem", town, folder / "town.osm", heights)
    engine.dispose()
    databases.drop_database(cluster.url, name)


def _measure(sessions: Sessions, town: Town) -> dict[int, float]:
    roads = town.roads
    driven = np.flatnonzero(roads.osm_way_id % 4 != 0)
    with_heights = roads.osm_way_id[driven] % 4 != 1
    ends = [town.node_height_m[side[driven]] + OFFSET_M for side in (town.start, town.end)]
    known = [[float(h) if k else None for h, k in zip(end, with_heights, strict=True)] for end in ends]
    values = {
        "way": roads.osm_way_id[driven].tolist(),
        "a": roads.from_node[driven].tolist(),
        "b": roads.to_node[driven].tolist(),
        "slope": town.true_slope_percent[driven].tolist(),
        "height_from": known[0],
        "height_to": known[1],
    }
    with sessions.begin() as session:
        session.execute(_MEASURED, values)
    heights: dict[int, float] = {}
    for nodes, end in ((values["a"], known[0]), (values["b"], known[1])):
        heights |= {node: h for node, h in zip(nodes, end, strict=True) if h is not None}
    return heights
