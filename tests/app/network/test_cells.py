"""The cells of the map: which a segment is shown in, and which a tile is made of."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from sqlalchemy import text

from app.core.db import Sessions
from app.network import ZOOM
from app.network.cells import beside, partitions_around

SIDE_M = 2 * math.pi * 6_378_137.0 / 2**ZOOM
HALF_M = math.pi * 6_378_137.0

_ALONG = text(
    "SELECT versant_cells_along(ST_SetSRID(ST_MakeLine(ST_Point(:x0, :y0), ST_Point(:x1, :y1)), 3857))"
)


def cell_at(x: float, y: float) -> int:
    column, row = math.floor((x + HALF_M) / SIDE_M), math.floor((HALF_M - y) / SIDE_M)
    return column << ZOOM | row


CELLS = st.floats(-4, 4).map(lambda n: n * SIDE_M)


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(x0=CELLS, y0=CELLS, x1=CELLS, y1=CELLS)
@example(x0=5e-310, y0=0.0, x1=0.0, y1=0.0)  # no width to divide by
@example(x0=-1e-9, y0=-3 * SIDE_M, x1=1e-9, y1=3 * SIDE_M)
def test_a_line_is_in_every_cell_that_it_meets_and_no_other(
    sessions: Sessions, x0: float, y0: float, x1: float, y1: float
) -> None:
    with sessions() as session:
        found = set(session.execute(_ALONG, {"x0": x0, "y0": y0, "x1": x1, "y1": y1}).scalars())
    shares = [k / 997 for k in range(998)]
    met = {cell_at(x0 + t * (x1 - x0), y0 + t * (y1 - y0)) for t in shares}
    assert met <= found
    # One that is met at a corner, or for less than a step, is not among those that were looked at.
    assert all(any(near in met for near in (cell, *beside(cell))) for cell in found)
    assert len(found) <= 2 * len(met) + 4


def test_a_line_around_the_world_costs_thousands_of_cells_and_not_millions(sessions: Sessions) -> None:
    with sessions() as session:
        ends = {"x0": -HALF_M, "y0": -HALF_M, "x1": HALF_M, "y1": HALF_M / 3}
        assert 16_000 < len(session.execute(_ALONG, ends).all()) < 33_000


@given(st.lists(st.integers(0, 2**28 - 1), min_size=1, max_size=30))
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_partitions_are_those_of_the_database(sessions: Sessions, cells: list[int]) -> None:
    query = text(
        "SELECT DISTINCT versant_partition(c) AS r FROM unnest(CAST(:c AS integer[])) AS c ORDER BY r"
    )
    with sessions() as session:
        stored = session.execute(query, {"c": cells}).scalars().all()
    assert partitions_around(np.array(cells)) == stored
