"""The bare endpoint: FastAPI, a pool of psycopg, one statement; no version, no cache, no cut of low zooms."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI, Response
from psycopg_pool import AsyncConnectionPool

_MVT = """
    WITH box AS (SELECT ST_TileEnvelope(%(z)s, %(x)s, %(y)s) AS tile,
                        ST_TileEnvelope(%(z)s, %(x)s, %(y)s, margin => 64 / 4096.0) AS wide),
    feature AS (
        SELECT s.id, a.slope_percent, a.slope_sigma_percent, coalesce(a.drives, 0) AS drives, s.highway, s.oneway,
               ST_AsMVTGeom(s.geom_3857, box.tile, 4096, 64, true) AS geom
        FROM box JOIN segments AS s ON s.geom_3857 && box.wide
        LEFT JOIN segment_slopes AS a ON a.segment_id = s.id AND a.drives > 0)
    SELECT ST_AsMVT(feature, 'segments', 4096, 'geom', 'id') FROM feature WHERE geom IS NOT NULL
"""


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    options = {"options": "-c jit=off -c max_parallel_workers_per_gather=0", "autocommit": True}
    async with AsyncConnectionPool(
        os.environ["BENCH_DSN"], min_size=2, max_size=4, kwargs=options, open=False
    ) as pool:
        app.state.pool = pool
        yield


app = FastAPI(lifespan=_lifespan)


@app.get("/healthz")
async def health() -> dict[str, str]:
    """It is there."""
    return {"status": "ok"}


@app.get("/{z}/{x}/{y}")
async def tile(z: int, x: int, y: int) -> Response:
    """A tile."""
    async with app.state.pool.connection() as connection:
        cursor = await connection.execute(_MVT, {"z": z, "x": x, "y": y}, prepare=True)
        row = await cursor.fetchone()
    return Response(bytes(row[0]), media_type="application/vnd.mapbox-vector-tile")
