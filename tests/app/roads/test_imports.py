"""The road import and extracts."""

from __future__ import annotations

import threading
import uuid
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from sqlalchemy import text

from app.core.db import Sessions
from app.map import store as map_store
from app.network import cells, extracts, locks
from app.roads import store as road_store
from app.roads.documents import ImportCounts
from fusion.roads.table import RoadTable
from fusion.simulate.scene.town import Town
from fusion.types import Ints
from road_support import replace_roads

Chain = Callable[..., RoadTable]
AddDrive = Callable[..., uuid.UUID]


def imported(sessions: Sessions, table: RoadTable, name: str = "map.osm") -> ImportCounts:
    with sessions.begin() as session:
        return replace_roads(session, table, name, "a" * 64)


def assert_equal(left: RoadTable, right: RoadTable) -> None:
    for column in RoadTable.columns():
        a, b = getattr(left, column), getattr(right, column)
        assert a.dtype == b.dtype, column
        assert np.array_equal(a, b), column


def test_a_town_comes_back_bit_for_bit(sessions: Sessions, town: Town) -> None:
    imported(sessions, town.roads)
    with sessions() as session:
        table, ids = extracts.all_roads(session)
    assert_equal(table, town.roads)
    assert len(set(ids.tolist())) == len(town.roads)


AROUND_THE_WORLD = [(-180.0, -85.0, 360.0, 170.0, True), (-0.0, 5e-324, 0.0, -0.0, False)]


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    ends=st.lists(
        st.tuples(
            st.floats(-180, 180),
            st.floats(-85, 85),
            st.floats(-0.5, 0.5),
            st.floats(-0.5, 0.5),
            st.booleans(),
        ),
        min_size=1,
        max_size=20,
    )
)
@example(AROUND_THE_WORLD)
def test_any_coordinates_come_back_bit_for_bit(
    sessions: Sessions, chain: Chain, ends: list[tuple[float, float, float, float, bool]]
) -> None:
    # Places and how far it goes from there: lines around the world are shown in thousands of cells.
    lon0, lat0, east, north, named = (np.array(column) for column in zip(*ends, strict=True))
    lon1, lat1 = np.clip(lon0 + east, -180, 180), np.clip(lat0 + north, -85, 85)
    table = chain(
        len(ends),
        lon0_deg=lon0,
        lat0_deg=lat0,
        lon1_deg=lon1,
        lat1_deg=lat1,
        name=[f"Nr. {k} %s\\N\t" if known else None for k, known in enumerate(named)],
        oneway=np.resize([-1, 0, 1], len(ends)),
        layer=np.resize([-2, 0, 3], len(ends)),
        bridge=named,
        tunnel=~named,
    )
    imported(sessions, table)
    with sessions() as session:
        assert_equal(extracts.all_roads(session)[0], table)


def test_a_reimport_keeps_what_is_unchanged(
    sessions: Sessions, chain: Chain, segment_ids: Ints, add_drive: AddDrive
) -> None:
    add_drive(segment_ids, {k: (float(k), 1.0) for k in range(10)})
    lon1 = 8.5 + 0.001 * np.arange(1, 11)
    lon1[3] = np.nextafter(lon1[3], 9)  # the smallest move there is
    lon1[5] += 1e-4  # seven metres
    changed = chain(10, lon1_deg=lon1, highway=["primary"] * 10).subset(np.arange(1, 10))
    more = chain(2, way=8, from_node=[500, 501], to_node=[501, 502])
    columns: dict[str, Any] = {
        c: np.concatenate([getattr(changed, c), getattr(more, c)]) for c in RoadTable.columns()
    }
    both = RoadTable.from_columns(**columns)

    add_drive(segment_ids, {7: (7.0, 1.0)})  # one that the import does not touch
    assert imported(sessions, both) == ImportCounts(
        "roads", kept=7, moved=1, far=1, dropped=1, added=2, measured_lost=2, drives_again=1
    )

    with sessions() as session:
        table, ids = extracts.all_roads(session)
        rows = {row.id: row for row in map_store.all_segments(session)}
        version = road_store.current_road_version(session)
    assert_equal(table, both)
    assert ids[:9].tolist() == segment_ids[1:].tolist()
    assert [rows[int(i)].slope_percent for i in ids] == pytest.approx(
        [1, 2, 3, 4, None, 6, 7, 8, 9, None, None]
    )
    assert {row.highway for row in rows.values()} == {"primary", "residential"}
    assert version is not None
    assert (version.segments, version.kept, version.moved, version.dropped, version.added) == (11, 7, 2, 1, 2)


def test_an_import_tells_what_it_costs_and_leaves_out(
    sessions: Sessions, chain: Chain, segment_ids: Ints, add_drive: AddDrive
) -> None:
    add_drive(segment_ids, {8: (1.0, 1.0), 0: (1.0, 1.0)})
    add_drive(segment_ids, {8: (1.0, 1.0)})
    less = replace(chain(5), skipped=Counter({"node missing from the file": 3}))
    assert imported(sessions, less) == ImportCounts(
        "roads", kept=5, dropped=5, measured_lost=1, drives_again=2, skipped={"node missing from the file": 3},
    )  # fmt: skip


def test_a_dropped_segment_takes_its_estimates_along(
    sessions: Sessions, chain: Chain, segment_ids: Ints, add_drive: AddDrive
) -> None:
    drive = add_drive(segment_ids, {0: (1.0, 1.0), 9: (2.0, 1.0)})
    imported(sessions, chain(5))
    with sessions() as session:
        (estimate,) = map_store.drive_segment_rows(session, drive)
        assert estimate.segment.id == segment_ids[0]
        assert session.execute(text("SELECT count(*) FROM segment_slopes")).scalar_one() == 1


def test_an_import_that_fails_changes_nothing(sessions: Sessions, chain: Chain, segment_ids: Ints) -> None:
    def fail(stage: str, share: float) -> None:
        if stage == "dropping":
            raise RuntimeError("stop")

    with sessions() as session:
        before = list(map_store.all_segments(session)), cells.data_version(session)
    with pytest.raises(RuntimeError, match="stop"), sessions.begin() as session:
        replace_roads(session, chain(3, lat=48.0), "x", "b" * 64, fail)
    with sessions() as session:
        assert (list(map_store.all_segments(session)), cells.data_version(session)) == before


def test_an_import_raises_the_version_if_anything_changed(
    sessions: Sessions, chain: Chain, segment_ids: Ints
) -> None:
    with sessions() as session:
        before = cells.data_version(session)
    imported(sessions, chain())
    with sessions() as session:
        assert cells.data_version(session) == before
    imported(sessions, chain(name=["Gasse", *["Straße"] * 9]))
    with sessions() as session:
        assert cells.data_version(session) == before + 1


def test_the_columns_of_the_map_agree_with_postgis(sessions: Sessions, town: Town) -> None:
    imported(sessions, town.roads)
    query = text(
        """
        SELECT max(ST_HausdorffDistance(geom_3857, ST_Transform(geom, 3857))) AS off_m,
               max(abs(length_m - ST_Length(geom::geography))) AS length_off_m, bool_and(ST_IsValid(geom)) AS valid
        FROM segments
        """
    )
    with sessions() as session:
        row = session.execute(query).one()
    assert row.off_m < 1e-6
    assert row.length_off_m < 1e-6
    assert row.valid


def test_the_slope_of_the_elevation_model_is_stored(sessions: Sessions, chain: Chain) -> None:
    table = chain(4)
    for slope in ([1.5, np.nan, -2.0, 0.0], [np.nan, 3.0, -2.0, 0.0]):
        with sessions.begin() as session:
            counts = replace_roads(session, table, "x", "c" * 64, dem_slope_percent=np.array(slope))
        with sessions() as session:
            stored = [row.dem_slope_percent for row in map_store.all_segments(session)]
        assert stored == [None if np.isnan(v) else v for v in slope]
    assert counts == ImportCounts("roads", kept=4)


def test_an_import_waits_for_writers_of_estimates(
    sessions: Sessions, chain: Chain, segment_ids: Ints
) -> None:
    done = threading.Event()

    def run() -> None:
        imported(sessions, chain(5))
        done.set()

    with sessions.begin() as session:
        locks.share_network(session)
        thread = threading.Thread(target=run)
        thread.start()
        assert not done.wait(0.5)
    thread.join(timeout=30)
    assert done.is_set()


def test_progress_is_told_in_order(sessions: Sessions, chain: Chain) -> None:
    told: list[tuple[str, float]] = []
    with sessions.begin() as session:
        replace_roads(session, chain(), "x", "d" * 64, lambda stage, share: told.append((stage, share)))
    assert list(dict.fromkeys(stage for stage, _ in told)) == [
        "copying", "adding"
    ]  # fmt: skip
    for name in ("copying", "adding"):
        shares = [share for stage, share in told if stage == name]
        assert shares == sorted(shares)
        assert shares[-1] == 1.0
