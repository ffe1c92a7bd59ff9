"""Estimates, aggregates and reading segments."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import text

from app.core.db import Sessions
from app.drives import store as drives
from app.map import store as map_store
from app.network import results as slopes
from app.network.marks import MarkedBy
from app.network.swap import solve_all_marked
from app.roads import store as road_store
from fusion.network.combine import combine
from fusion.roads.table import RoadTable
from fusion.types import Ints
from network_support import delete
from road_support import replace_roads

AddDrive = Callable[..., uuid.UUID]
Estimates = dict[int, tuple[float, float]]


def aggregates(sessions: Sessions) -> dict[int, tuple[float, float, int, int]]:
    query = "SELECT segment_id, slope_percent, slope_sigma_percent, drives, observations FROM segment_slopes"
    with sessions() as session:
        return {row[0]: tuple(row[1:]) for row in session.execute(text(query))}


def from_scratch(ids: Ints, alive: list[Estimates]) -> dict[int, tuple[float, float, int, int]]:
    out = {}
    for index, segment_id in enumerate(ids.tolist()):
        known = [estimates[index] for estimates in alive if index in estimates]
        if known:
            slope, sigma = np.array(known).T
            whole = combine(slope, sigma, np.full(len(known), 5))
            out[segment_id] = (
                whole.slope_percent, whole.slope_sigma_percent, whole.drives, whole.observations
            )  # fmt: skip
    return out


ESTIMATES = st.dictionaries(
    st.integers(0, 9), st.tuples(st.floats(-20, 20), st.floats(0.05, 10)), min_size=0, max_size=6
)


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(given_drives=st.lists(ESTIMATES, min_size=1, max_size=5), data=st.data())
def test_aggregates_are_those_of_the_drives_that_are_left(
    sessions: Sessions,
    segment_ids: Ints,
    add_drive: AddDrive,
    given_drives: list[Estimates],
    data: st.DataObject,
) -> None:
    with sessions() as session:
        rows = drives.list_drives(session)
    for row in rows:
        delete(sessions, row.id)
    assert aggregates(sessions) == {}
    order = data.draw(st.permutations(range(len(given_drives))))
    stored = {k: add_drive(segment_ids, given_drives[k]) for k in order}
    for k in data.draw(st.lists(st.sampled_from(order), unique=True)):
        delete(sessions, stored.pop(k))
    assert aggregates(sessions) == from_scratch(segment_ids, [given_drives[k] for k in stored])


def test_a_second_run_replaces_the_first(sessions: Sessions, segment_ids: Ints, add_drive: AddDrive) -> None:
    drive = add_drive(segment_ids, {0: (1.0, 1.0), 1: (2.0, 1.0)})
    with sessions.begin() as session:
        version = road_store.current_road_version(session)
        assert version is not None
        provenance = slopes.RunProvenance("dem", {}, "1.1", version.id, None)
        slopes.append_result(session, MarkedBy(drive, 1), segment_ids, [], provenance)
    solve_all_marked(sessions)
    with sessions() as session:
        assert map_store.drive_segment_rows(session, drive) == []
        assert session.execute(text("SELECT method FROM provenances")).scalars().all() == ["dem"]
    assert aggregates(sessions) == {}


def test_an_estimate_that_is_not_finite_is_left_out(
    sessions: Sessions, segment_ids: Ints, add_drive: AddDrive
) -> None:
    drive = add_drive(segment_ids, {0: (np.nan, 1.0), 1: (2.0, np.inf), 2: (3.0, 1.0)})
    with sessions() as session:
        (estimate,) = map_store.drive_segment_rows(session, drive)
    assert estimate.segment.id == segment_ids[2]


def test_many_drives_at_once_end_in_the_right_aggregates(
    sessions: Sessions, segment_ids: Ints, add_drive: AddDrive
) -> None:
    rng = np.random.default_rng(5)
    wanted = [
        {int(k): (float(rng.normal()), float(rng.uniform(0.2, 2))) for k in rng.permutation(10)[:7]}
        for _ in range(12)
    ]
    start = threading.Barrier(4)
    stored: dict[int, uuid.UUID] = {}

    def work(lane: int) -> None:
        start.wait()
        for k in range(lane, 12, 4):
            stored[k] = add_drive(segment_ids, wanted[k])
            if k % 3 == 0:
                delete(sessions, stored.pop(k))

    with ThreadPoolExecutor(4) as pool:
        for future in [pool.submit(work, lane) for lane in range(4)]:
            future.result(timeout=60)
    assert aggregates(sessions) == from_scratch(segment_ids, [wanted[k] for k in stored])


def test_all_segments_are_every_segment_once(
    sessions: Sessions, segment_ids: Ints, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(map_store, "PAGE", 3)
    with sessions() as session:
        assert [row.id for row in map_store.all_segments(session)] == sorted(segment_ids.tolist())


def test_items_within_a_box(sessions: Sessions, segment_ids: Ints) -> None:
    with sessions() as session:
        found = list(map_store.all_segments(session, bbox=(8.5025, 48.9, 8.5045, 49.1)))
        assert [row.id for row in found] == segment_ids[2:5].tolist()
        assert map_store.count_segments(session, bbox=(8.5025, 48.9, 8.5045, 49.1)) == 3
        assert list(map_store.all_segments(session, bbox=(8.5025, 49.0001, 8.5045, 49.1))) == []


def test_a_diagonal_segment_is_outside_a_box_that_it_passes_by(
    sessions: Sessions, chain: Callable[..., RoadTable]
) -> None:
    table = chain(1, lon0_deg=[8.0], lat0_deg=[48.0], lon1_deg=[8.1], lat1_deg=[48.1])
    with sessions.begin() as session:
        replace_roads(session, table, "x", "0" * 64)
        assert list(map_store.all_segments(session, bbox=(8.06, 48.0, 8.1, 48.04))) == []
        assert len(list(map_store.all_segments(session, bbox=(8.04, 48.0, 8.1, 48.06)))) == 1


def test_a_box_across_the_antimeridian(sessions: Sessions, chain: Callable[..., RoadTable]) -> None:
    table = chain(
        3,
        lon0_deg=[179.99, -179.99, 0.0],
        lat0_deg=[-17.0] * 3,
        lon1_deg=[179.995, -179.98, 0.1],
        lat1_deg=[-17.0] * 3,
    )
    with sessions.begin() as session:
        replace_roads(session, table, "x", "0" * 64)
        found = list(map_store.all_segments(session, bbox=(179.0, -18.0, -179.0, -16.0)))
    assert [row.from_node for row in found] == [100, 101]


def test_driven_and_undriven(sessions: Sessions, segment_ids: Ints, add_drive: AddDrive) -> None:
    add_drive(segment_ids, {4: (-3.0, 0.5)})
    with sessions() as session:
        (driven,) = map_store.all_segments(session, driven=True)
        undriven = list(map_store.all_segments(session, driven=False))
        assert map_store.get_segment(session, driven.id) == driven
        assert map_store.get_segment(session, 0) is None
        assert map_store.count_segments(session) == map_store.count_segments(session, driven=False) + 1
    assert (driven.id, driven.drives, driven.observations) == (segment_ids[4], 1, 5)
    assert (driven.slope_percent, driven.slope_sigma_percent) == pytest.approx((-3.0, 0.5))
    assert driven.updated_at is not None
    assert driven.coordinates == ((8.504, 49.0), (8.505, 49.0))
    assert len(undriven) == 9
    for row in undriven:
        assert (row.slope_percent, row.slope_sigma_percent, row.updated_at) == (None, None, None)
        assert (row.drives, row.observations) == (0, 0)


def test_observations_and_drive_segments_tell_where_a_slope_comes_from(
    sessions: Sessions, segment_ids: Ints, add_drive: AddDrive
) -> None:
    one = add_drive(segment_ids, {1: (1.0, 1.0), 0: (9.0, 1.0)})
    two = add_drive(segment_ids, {1: (3.0, 1.0)})
    with sessions() as session:
        behind = map_store.segment_observations(session, int(segment_ids[1]))
        own = map_store.drive_segment_rows(session, one)
    assert {row.drive_id: row.slope_percent for row in behind} == {one: 1.0, two: 3.0}
    assert {(row.method, row.code_version, tuple(row.options.items())) for row in behind} == {
        ("raw", "1.0", (("min_epochs", 4),))
    }
    assert [row.segment.id for row in own] == segment_ids[:2].tolist()
    assert [row.slope_percent for row in own] == [9.0, 1.0]
    assert own[1].segment.slope_percent == pytest.approx(2.0)
    assert own[1].segment.drives == 2
