"""The servers that are compared, each a process on the same database: this service, tipg, and a bare endpoint.

tipg runs in an environment of its own (its packages want other versions of ours); it reads a flat table that it is
given, without a join. The bare endpoint is FastAPI with an asynchronous pool around one ``ST_AsMVT``, on the geometry
of the tiles: what anybody writes first.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import text

from app.core.db import Sessions
from service.processes import await_answer, ended

SCHEMA = "bench"
PROPERTIES = ("slope_percent", "slope_sigma_percent", "drives", "highway", "oneway")

FLAT = """
    CREATE SCHEMA IF NOT EXISTS bench;
    DROP TABLE IF EXISTS bench.tiles, bench.items;
    CREATE TABLE bench.tiles AS
        SELECT s.id, a.slope_percent, a.slope_sigma_percent, coalesce(a.drives, 0) AS drives, s.highway, s.oneway,
               s.geom
        FROM segments AS s LEFT JOIN segment_slopes AS a ON a.segment_id = s.id AND a.drives > 0 ORDER BY s.id;
    ALTER TABLE bench.tiles ADD PRIMARY KEY (id);
    CREATE INDEX ON bench.tiles USING gist (geom);
    CREATE TABLE bench.items AS
        SELECT s.id, s.osm_way_id, s.from_node, s.to_node, s.length_m, s.highway, s.name, s.oneway, s.bridge, s.tunnel,
               a.slope_percent, a.slope_sigma_percent, coalesce(a.drives, 0) AS drives,
               coalesce(a.observations, 0) AS observations, s.dem_slope_percent, a.updated_at, a.height_from_m,
               a.height_to_m, a.height_sigma_m, a.steepest_percent, a.steepest_from_m, a.steepest_to_m, a.driven_share,
               s.geom
        FROM segments AS s LEFT JOIN segment_slopes AS a ON a.segment_id = s.id AND a.drives > 0 ORDER BY s.id;
    ALTER TABLE bench.items ADD PRIMARY KEY (id);
    CREATE INDEX ON bench.items USING gist (geom);
    ANALYZE bench.tiles, bench.items
"""
_TIPG = """
import json, os, types
import tipg.database
url = os.environ["BENCH_DSN"]
tipg.database.PostgresSettings = lambda: types.SimpleNamespace(
    database_url=url, db_min_conn_size=2, db_max_conn_size=4, db_max_queries=50000, db_max_inactive_conn_lifetime=300.0)
from tipg.main import app
import uvicorn
uvicorn.run(app, host="127.0.0.1", port=int(os.environ["BENCH_PORT"]), access_log=False, log_level="warning")
"""


def make_flat(sessions: Sessions) -> None:
    """Make the tables that tipg reads."""
    with sessions.begin() as session:
        for statement in FLAT.split(";"):
            session.execute(text(statement))


@contextmanager
def tipg(python: Path, dsn: str, port: int) -> Iterator[None]:
    """tipg by the interpreter of its environment, until the block ends."""
    settings = {
        "BENCH_DSN": dsn,
        "BENCH_PORT": str(port),
        "TIPG_DB_SCHEMAS": json.dumps([SCHEMA]),
        "TIPG_MAX_FEATURES_PER_TILE": "200000",
        "TIPG_TILE_BUFFER": "64",
        "TIPG_DB_SPATIAL_EXTENT": "false",
        "TIPG_DB_DATETIME_EXTENT": "false",
    }
    process = subprocess.Popen([str(python), "-c", _TIPG], env={**os.environ, **settings})
    with ended(process, 30):
        await_answer(f"http://127.0.0.1:{port}/healthz")
        yield


@contextmanager
def bare(dsn: str, port: int) -> Iterator[None]:
    """The bare endpoint, until the block ends."""
    here = Path(__file__).resolve().parents[1]
    command = [sys.executable, "-m", "uvicorn", "served.bare:app", "--host", "127.0.0.1", "--port", str(port)]
    settings = {"BENCH_DSN": dsn, "PYTHONPATH": str(here)}
    process = subprocess.Popen(
        [*command, "--no-access-log", "--log-level", "warning"], env={**os.environ, **settings}
    )
    with ended(process, 30):
        await_answer(f"http://127.0.0.1:{port}/healthz")
        yield
