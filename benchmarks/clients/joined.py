"""How often slopes find the right lines of another map by geometry alone.

    PYTHONPATH=.:benchmarks python -m clients.joined MAP.osm.pbf [--crs EPSG] [--json FILE]

The other map is made of MAP's own ways: each is shifted by 6.4 m, simplified by 4 m, and every second one, by chance
(seed 1), is turned round; once whole, once cut at junctions. Segments of MAP look for their lines by a plain buffer, by
the nearest line, and by the query of ``docs/how-to/join-slopes.md``, as it stands there. Aim: the query is right for
nine of ten.
"""

from __future__ import annotations

import re
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import shapely
from pyproj import Transformer

import fusion
from accuracy.arguments import parser_of
from accuracy.scoring import show_progress, write_json
from app.embedded.cluster import EmbeddedPostgres
from fusion.roads.table import RoadTable

GUIDE = Path(__file__).parents[2] / "docs" / "how-to" / "join-slopes.md"
SHIFT_M, SIMPLIFIED_M, SEED = (5.0, -4.0), 4.0, 1
_TABLES = """
    DROP SCHEMA IF EXISTS other CASCADE; CREATE SCHEMA other; SET search_path = other, public;
    CREATE TABLE segments (id bigint, osm_way_id bigint, truth bigint, geom geometry);
    CREATE TABLE lines (id bigint, turned boolean, geom geometry);
"""
_INDEXES = """
    CREATE INDEX ON segments USING gist (geom); CREATE INDEX ON lines USING gist (geom);
    ANALYZE segments; ANALYZE lines;
"""
BUFFER = """
    CREATE TABLE joined AS SELECT s.id AS segment_id, l.id AS line_id, NULL::int AS direction
    FROM segments AS s JOIN lines AS l ON ST_Intersects(s.geom, ST_Buffer(l.geom, 10))
"""
"""What the query of the guide is better than."""
_NEAREST = """
    CREATE TABLE joined AS SELECT s.id AS segment_id, l.id AS line_id, NULL::int AS direction
    FROM segments AS s, LATERAL (SELECT id FROM lines ORDER BY geom <-> s.geom LIMIT 1) AS l
"""
_JUDGED = """
    SELECT count(*), count(*) FILTER (WHERE s.truth = j.line_id),
           count(DISTINCT s.id) FILTER (WHERE s.truth = j.line_id),
           avg(CAST((j.direction < 0) = l.turned AS int)) FILTER (WHERE s.truth = j.line_id)
    FROM joined AS j JOIN segments AS s ON s.id = j.segment_id JOIN lines AS l ON l.id = j.line_id
"""


def queries() -> list[str]:
    """The statements of the guide's part on geometry: the join, and what it is for."""
    part = GUIDE.read_text(encoding="utf-8").partition("\n## By geometry")[2]
    return re.findall(r"```sql\n(.*?);?\n```", part, re.DOTALL)


def chains(roads: RoadTable, *, cut: bool) -> Iterator[list[int]]:
    """Rows of consecutive segments of one way, in their order; ``cut``: until a junction."""
    joined = Counter([*roads.from_node.tolist(), *roads.to_node.tolist()])
    begin, end = roads.from_node.tolist(), roads.to_node.tolist()
    ways: dict[int, list[int]] = {}
    for row, way in enumerate(roads.osm_way_id.tolist()):
        ways.setdefault(way, []).append(row)
    for rows in ways.values():
        following, reached = {begin[row]: row for row in rows}, {end[row] for row in rows}
        left = set(rows)
        # A ring begins anywhere.
        for first in [*(row for row in rows if begin[row] not in reached), *rows]:
            chain, row = list[int](), first
            while row in left:
                left.discard(row)
                chain.append(row)
                if cut and joined[end[row]] != 2:
                    yield chain
                    chain = []
                row = following.get(end[row], -1)
            if chain:
                yield chain


def fill(connection: psycopg.Connection[Any], roads: RoadTable, crs: int, *, cut: bool) -> None:
    """The tables of the guide, and which line is whose."""
    to_metres = Transformer.from_crs(4326, crs, always_xy=True)
    ends = np.stack(
        [np.column_stack(to_metres.transform(*p)) for p in (
            (roads.lon0_deg, roads.lat0_deg), (roads.lon1_deg, roads.lat1_deg))], axis=1
    )  # fmt: skip
    rng = np.random.default_rng(SEED)
    connection.execute(_TABLES)
    truth = np.full(len(roads), -1)
    with connection.cursor().copy("COPY lines FROM STDIN") as copy:
        for number, chain in enumerate(chains(roads, cut=cut)):
            truth[chain] = number
            places = np.concatenate([ends[chain, 0], ends[chain[-1:], 1]])
            line = shapely.simplify(shapely.linestrings(places), SIMPLIFIED_M)
            moved, turned = shapely.get_coordinates(line) + SHIFT_M, bool(rng.random() < 0.5)
            copy.write_row((number, turned, _hex(shapely.linestrings(moved[::-1] if turned else moved), crs)))
    with connection.cursor().copy("COPY segments FROM STDIN") as copy:
        rows = zip(roads.osm_way_id.tolist(), truth.tolist(), shapely.linestrings(ends), strict=True)
        for number, (way, line_id, line) in enumerate(rows):
            copy.write_row((number, way, line_id, _hex(line, crs)))
    connection.execute(_INDEXES)


def _hex(line: Any, crs: int) -> str:
    return str(shapely.to_wkb(shapely.set_srid(line, crs), hex=True, include_srid=True))


def judged(connection: psycopg.Connection[Any], query: str, segments: int) -> dict[str, float | None]:
    """Shares in percent: of pairs that are right, of segments with their own line, of these with their direction."""
    connection.execute("DROP TABLE IF EXISTS joined")
    connection.execute(query)
    ((pairs, right, own, directed),) = connection.execute(_JUDGED).fetchall()
    return {
        "pairs_right": 100 * right / pairs,
        "segments_right": 100 * own / segments,
        "directions_right": None if directed is None else 100 * float(directed),
    }


def main() -> None:
    """Make both maps, join them, print the shares."""
    parser = parser_of(__doc__)
    parser.add_argument("map", type=Path)
    parser.add_argument("--crs", type=int, default=25832, help="EPSG number of a projection in metres")
    chosen = parser.parse_args()
    roads = fusion.read_roads(chosen.map)
    ways = {"a buffer of 10 m": BUFFER, "the nearest": _NEAREST, "the guide's query": queries()[0]}
    figures: dict[str, dict[str, float | None]] = {}
    with tempfile.TemporaryDirectory() as folder:
        cluster = EmbeddedPostgres(Path(folder) / "data")
        cluster.start()
        try:
            with psycopg.connect(cluster.url.replace("+psycopg", ""), autocommit=True) as connection:
                connection.execute("CREATE EXTENSION IF NOT EXISTS postgis")
                for cut in (False, True):
                    fill(connection, roads, chosen.crs, cut=cut)
                    for name, query in ways.items():
                        what = f"{name}, lines cut at junctions" if cut else name
                        show_progress(what)
                        figures[what] = judged(connection, query, len(roads))
        finally:
            cluster.stop()
    show_progress("")
    print(f"{chosen.map.name}: {len(roads):,} segments")
    for name, of in figures.items():
        print(f"{name:45}", *(f"{k} {'-' if v is None else f'{v:.1f} %'}" for k, v in of.items()))
    write_json(chosen.json, figures)


if __name__ == "__main__":
    main()
