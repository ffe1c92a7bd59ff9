"""Tiles of single segments are those of PostGIS's own encoder, whatever the roads and slopes are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from sqlalchemy import text

from app.core.db import Sessions, fetch_binary
from app.map.derived.lines import HALF_WORLD, LINE
from app.map.tiles import store
from app.map.tiles.encoding import BUFFER, EXTENT
from app.map.tiles.road_store import Place, roads_of
from app.map.tiles.store import SEGMENTS, Address
from app.map.tiles.tiles import Tiles, plain
from app.network.cells import cells_over, raise_versions
from app.terrain.store import PendingHeights, note_renewed, set_terrain
from fusion.roads.table import RoadTable
from fusion.types import Ints
from mvt_support import features, layers
from network_support import drive_over
from road_support import replace_roads

# As tiles were made before they were encoded here: PostGIS clips, and writes what it clipped.
_REFERENCE = """
    WITH box AS (SELECT ST_TileEnvelope(%(z)s, %(x)s, %(y)s) AS tile, %(unit_m)s::float8 AS unit_m),
    road AS (
        SELECT * FROM unnest(
            %(ids)s::bigint[], %(x0)s::float8[], %(y0)s::float8[], %(x1)s::float8[], %(y1)s::float8[],
            %(highway)s::text[], %(oneway)s::bigint[], %(bridge)s::boolean[], %(dem)s::float8[],
            %(slope)s::float8[], %(sigma)s::float8[], %(drives)s::bigint[])
            AS r (id, x0, y0, x1, y1, highway, oneway, bridge, dem, slope, sigma, drives)
    ), line AS (
        SELECT r.*, ST_SetSRID(ST_MakeLine(ST_MakePoint(x0, y0), ST_MakePoint(x1, y1)), 3857) AS line,
               ST_SetSRID(ST_MakeLine(ST_MakePoint(x0, y0), ST_MakePoint(x0 + 1.5 * box.unit_m, y0)), 3857) AS short
        FROM road AS r, box
    ), feature AS (
        SELECT id, slope AS slope_percent, sigma AS slope_sigma_percent, drives, highway, oneway,
               nullif(bridge, false) AS bridge, dem AS dem_slope_percent,
               coalesce(ST_AsMVTGeom(line, box.tile, 4096, 64, true), ST_AsMVTGeom(short, box.tile, 4096, 64, true))
                   AS geom
        FROM line, box
    )
    SELECT ST_AsMVT(feature, 'segments', 4096, 'geom', 'id') FROM feature WHERE geom IS NOT NULL
"""
_ELEVATION = text("""
    INSERT INTO dem_versions (id, sources, datum, active, pending)
    OVERRIDING SYSTEM VALUE VALUES (:id, '[]', 'EGM96', true, '{"boxes_deg": [], "after_id": 0}')
""")
DEM = 77
HERE = Address(SEGMENTS, 14, 8579, 5626)
OUTERMOST = (-BUFFER, EXTENT + BUFFER)

units = st.one_of(
    st.floats(-300, EXTENT + 300),
    st.floats(-20_000, 20_000),
    st.sampled_from([-64.0, -63.5, -64.5, 0.0, 4096.0, 4159.5, 4160.0, 4160.5, 17.25, 17.5]),
)
lengths = st.one_of(st.floats(-3, 3), st.floats(-500, 500), st.floats(-30_000, 30_000), st.just(0.0))
roads = st.tuples(
    st.tuples(units, units, lengths, lengths),
    st.sampled_from(["residential", "motorway_link", "Straße"]),
    st.sampled_from([-1, 0, 1]),
    st.booleans(),
    st.none() | st.integers(-400, 400).map(lambda tenths: tenths / 10),
    st.none() | st.tuples(st.floats(-40, 40), st.floats(0.01, 9), st.integers(1, 10**6)),
)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    some=st.lists(roads, max_size=40),
    first=st.integers(0, 2**62),
    apart=st.integers(1, 300),
    z=st.integers(6, 18),
    data=st.data(),
)
def test_a_tile_is_what_postgis_writes(
    sessions: Sessions, some: list[Any], first: int, apart: int, z: int, data: st.DataObject
) -> None:
    at = Place(z, *(data.draw(st.integers(0, 2**z - 1)) for _ in "xy"))
    ids = [first + k * apart for k in range(len(some))]
    unit_m = 2 * HALF_WORLD / 2**z / EXTENT
    corner = (at.x * EXTENT * unit_m - HALF_WORLD, HALF_WORLD - at.y * EXTENT * unit_m)
    ends = np.array([[x, y, x + dx, y + dy] for (x, y, dx, dy), *_ in some]).reshape(-1, 4)
    places = np.column_stack([corner[k % 2] + (1 - 2 * (k % 2)) * unit_m * ends[:, k] for k in range(4)])
    lines = np.zeros(len(some), LINE)
    lines["xy"] = places.reshape(-1, 2, 2)
    rows = [
        (id_, line.tobytes(), highway, oneway, bridge, False, dem)
        for id_, line, (_, highway, oneway, bridge, dem, _) in zip(ids, lines, some, strict=True)
    ]
    slopes = [(id_, *one[-1]) for id_, one in zip(ids, some, strict=True) if one[-1] is not None]
    found = roads_of(at, rows[::-1])
    drawn = found.tile(SEGMENTS, slopes[::-1]) if len(found.ids) else b""
    columns = dict(zip(("x0", "y0", "x1", "y1"), places.T.tolist(), strict=True)) | {
        name: [one[k] for one in some] for k, name in enumerate(("highway", "oneway", "bridge", "dem"), 1)
    }
    measured = [one[-1] or (None, None, 0) for one in some]
    columns |= {name: [one[k] for one in measured] for k, name in enumerate(("slope", "sigma", "drives"))}
    with sessions() as session:
        values = {**at._asdict(), "unit_m": unit_m, "ids": ids, **columns}
        ((expected,),) = fetch_binary(session, _REFERENCE, values)
    assert_alike(drawn, bytes(expected or b""))


def assert_alike(drawn: bytes, expected: bytes) -> None:
    """The same features with the same properties; ends within a unit, or cut off elsewhere."""
    mine, theirs = ({f["id"]: f for f in layers(tile).get(SEGMENTS, [])} for tile in (drawn, expected))
    assert list(mine) == sorted(mine)
    for id_ in mine.keys() ^ theirs.keys():
        path = np.array((mine.get(id_) or theirs[id_])["path"])
        assert any((np.abs(path - edge) <= 2).any() for edge in OUTERMOST), path
    for id_ in mine.keys() & theirs.keys():
        assert mine[id_]["properties"] == theirs[id_]["properties"]
        ours, other = np.array(mine[id_]["path"]), np.array(theirs[id_]["path"])
        # What runs along the buffer's edge, or only touches it, depends on the last digit.
        if any((np.abs(line - edge) <= 1).all(axis=0).any() for line in (ours, other) for edge in OUTERMOST):
            continue
        # On the half between two units, of a line that is shorter, it hangs on that digit whether it is a point.
        most = 1 if max(np.ptp(ours, axis=0).max(), np.ptp(other, axis=0).max()) > 2 else 3
        near = np.abs(ours - other).max(axis=1) <= most
        # A start that is a unit off moves a cut end along the edge by more: the line itself is within a unit each way.
        cut = np.isin([ours, other], OUTERMOST).any(axis=(0, 2))
        assert (near | (cut & (aside(ours, other) <= np.sqrt(2)))).all(), (ours, other)
        assert ours.min() >= OUTERMOST[0]
        assert ours.max() <= OUTERMOST[1]


def aside(points: NDArray[Any], line: NDArray[Any]) -> NDArray[Any]:
    """How far points (n, 2) are from the line through two others, (n,)."""
    (dx, dy), off = line[1] - line[0], points - line[0]
    return np.asarray(np.abs(dx * off[:, 1] - dy * off[:, 0]) / np.hypot(dx, dy))


def new_slope(sessions: Sessions, table: RoadTable, ids: Ints) -> None:
    drive_over(sessions, table, ids, dict.fromkeys(range(8), (3.0, 0.5)), begin_s=1.6e9)


def new_class(sessions: Sessions, table: RoadTable, ids: Ints) -> None:
    with sessions.begin() as session:
        renamed = np.array(["primary" if k == 3 else name for k, name in enumerate(table.highway)], object)
        replace_roads(session, replace(table, highway=renamed), "x", "1" * 64)


def new_heights(sessions: Sessions, table: RoadTable, ids: Ints) -> None:
    """As a piece of the renewal writes them (``app.terrain.heights``)."""
    with sessions.begin() as session:
        pending = PendingHeights(DEM, (), 0)
        set_terrain(session, ids, np.full(len(ids), 7.5), [np.full(2, 100.0)] * len(ids))
        raise_versions(session, cells_over(session, ids.tolist()))
        note_renewed(session, pending, int(ids[-1]))


@pytest.mark.parametrize(("change", "again"), [(new_slope, False), (new_class, True), (new_heights, True)])
def test_roads_are_read_again_where_an_import_changed_them_and_only_then(
    in_processes: Any,
    sessions: Sessions,
    streets_apart: tuple[RoadTable, Ints],
    change: Callable[[Sessions, RoadTable, Ints], None],
    again: bool,
) -> None:
    drive_over(sessions, *streets_apart, dict.fromkeys(range(8), (2.0, 0.5)))
    with sessions.begin() as session:
        session.execute(_ELEVATION, {"id": DEM})

    async def scenario(process: Tiles, _: Tiles) -> None:
        tags, known = [], []
        for k in range(2):
            if k:
                change(sessions, *streets_apart)
            tags.append(str(await process.etag(HERE)))
            tile = await process.get(HERE, tags[-1])
            known.append(process._roads.kept[Place(*HERE[1:])])
            with sessions() as session:
                now = features(store.mvt(session, *HERE[1:]))
            assert features(await plain(tile.body)) == now != {}
        assert tags[0] != tags[1]
        assert (known[0] is not known[1]) is again

    in_processes(scenario)
