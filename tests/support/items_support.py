"""A few hundred segments with all that can stand in their columns, and what is asked of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core import databases
from app.core.db import Sessions, fetch_binary, make_engine, session_factory
from app.core.settings import Settings
from app.embedded.cluster import EmbeddedPostgres
from app.map.items.collections import COLLECTIONS
from app.map.items.request import parse_items
from app.map.items.store import Page, page

N = 240
_ROADS = text(
    f"""
    INSERT INTO segments (osm_way_id, from_node, to_node, geom, geom_3857, length_m, highway, name, oneway, bridge,
                          tunnel, layer, dem_slope_percent, road_version_id)
    SELECT 70 + g / 7, 5000000000 + g, 5000000001 + g, line, ST_Transform(line, 3857), (g * 37 % 101) / 8.0 + 1,
        (ARRAY['residential', 'primary', 'track', 'motor"way'])[1 + g / 2 % 4],
        (ARRAY[NULL, 'Straße', 'Allée', 'O''Brien', E'a\\\\b\\n%_', 'ÉCOLE', ''])[1 + g % 7], g % 3 - 1,
        g % 5 = 0, g % 11 = 0, 0,
        (ARRAY[NULL, 'NaN', 2.67495, -0.00001, 12.5, -3, 'Infinity'])[1 + g % 7], 1
    FROM generate_series(0, {N - 1}) AS g, LATERAL (
        SELECT ST_SetSRID(ST_MakeLine(ST_MakePoint(x, y), ST_MakePoint(least(x + 0.0031, 180), y + 0.0017)),
                         4326) AS line
        FROM (SELECT CASE WHEN g % 10 = 0 THEN 179.99 WHEN g % 10 = 1 THEN -180 ELSE 8.4 + g % 13 * 0.01 END AS x,
                     49 + g / 13 * 0.01 AS y) AS place) AS lines
    """
)
_SLOPES = text(
    """
    INSERT INTO segment_slopes (segment_id, slope_percent, slope_sigma_percent, drives, observations, updated_at,
                                height_from_m, height_to_m, height_sigma_m, steepest_percent, driven_share)
    SELECT id, (id * 13 % 40 - 20) / 4.0, 1 / (1 + id % 9.0), id % 4, id % 30,
        timestamptz '2026-11-01 00:00:00.123456+00' + id % 17 * interval '1 day' + id % 5 * interval '999 us',
        NULLIF(id % 6, 0) * 33.33351, 151.2045, 2.5, (id * 7 % 23 - 11) / 2.0, id % 3 / 3.0
    FROM segments WHERE id % 3 > 0
    """
)
_WAYS = text(
    """
    INSERT INTO ways (id, osm_way_id, from_node, to_node, segments, length_m, highway, name, oneway, bridge, tunnel,
                      slope_percent, slope_sigma_percent, drives, observations, updated_at, measured_share, geom,
                      geom_3857)
    SELECT min(id), osm_way_id, min(from_node), max(to_node), count(*), sum(length_m), min(highway), min(name), 0,
           bool_or(bridge), bool_or(tunnel), -1.23456, 0.5, 2, 9, timestamptz '2026-11-02 03:04:05.678901+00', 0.5,
           ST_MakeLine(geom), ST_MakeLine(geom_3857)
    FROM segments GROUP BY osm_way_id
    """
)


class Items:
    """The engine of items on a database of its own."""

    def __init__(self, sessions: Sessions, settings: Settings, stored: list[dict[str, Any]]) -> None:
        """``stored``: what the columns of segments hold, by ascending id."""
        self.sessions, self.settings, self.stored = sessions, settings, stored

    def page(self, collection: str = "segments", **params: str) -> Page:
        """What a request with these parameters gives."""
        return self.asked(list(params.items()), collection)

    def asked(self, pairs: list[tuple[str, str]], collection: str = "segments") -> Page:
        """The same of pairs of name and text."""
        with self.sessions() as session:
            return page(session, parse_items(COLLECTIONS[collection], pairs, self.settings))

    def ids(self, **params: str) -> list[int]:
        """The ids of all segments, on as many pages as it takes."""
        found: list[int] = []
        pairs = {"limit": "10000", **params}
        while True:
            one = self.page(**pairs)
            found += ids_of(one)
            if one.next_cursor is None:
                return found
            pairs["after"] = one.next_cursor


def ids_of(one: Page) -> list[int]:
    return [json.loads(feature)["id"] for feature in one.features]


def _stored(session: Session) -> list[dict[str, Any]]:
    segments = COLLECTIONS["segments"]
    columns = ", ".join(f"{one.sql} AS {name}" for name, one in segments.properties.items())
    rows = fetch_binary(session, f"SELECT {columns} FROM {segments.source} ORDER BY s.id", {})
    return [dict(zip(segments.properties, row, strict=True)) for row in rows]


def fill(session: Session) -> None:
    """The segments, their slopes and the ways."""
    session.execute(
        text(
            "INSERT INTO road_versions (source_name, sha256, segments, kept, moved, dropped, added)"
            " VALUES ('x', '0', 0, 0, 0, 0, 0)"
        )
    )
    session.execute(_ROADS)
    session.execute(_SLOPES)
    session.execute(_WAYS)


@pytest.fixture(scope="session")
def items(
    cluster: EmbeddedPostgres,
    template_db: str,
    new_database: Callable[[str], str],
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Items]:
    """For tests that only read."""
    name = new_database(template_db)
    folder: Path = tmp_path_factory.mktemp("items")
    settings = Settings(database_url=cluster.url_of(name), data_dir=folder)
    engine = make_engine(str(settings.database_url))
    sessions = session_factory(engine)
    with sessions.begin() as session:
        fill(session)
        stored = _stored(session)
    yield Items(sessions, settings, stored)
    engine.dispose()
    databases.drop_database(cluster.url, name)
