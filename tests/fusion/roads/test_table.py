"""Road tables: order, identity, boxes, lengths."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.roads.table import RoadTable, rows_of
from fusion.simulate.scene.town import Town

IDS = st.lists(st.tuples(*[st.integers(0, 4)] * 3), max_size=40)


def table_of_ids(ids: list[tuple[int, int, int]]) -> RoadTable:
    way, a, b = np.array(ids, np.int64).reshape(-1, 3).T
    n = len(ids)
    zeros = np.zeros(n)
    return RoadTable.from_columns(
        osm_way_id=way,
        from_node=a,
        to_node=b,
        lon0_deg=np.arange(n),
        lat0_deg=zeros,
        lon1_deg=zeros,
        lat1_deg=zeros,
        oneway=zeros,
        bridge=zeros,
        tunnel=zeros,
        layer=zeros,
        highway=["road"] * n,
        name=[str(k) for k in range(n)],
    )


@given(IDS)
def test_rows_are_sorted_and_unique_and_the_first_counts(ids: list[tuple[int, int, int]]) -> None:
    table = table_of_ids(ids)
    found = list(zip(table.osm_way_id, table.from_node, table.to_node, strict=True))
    assert found == sorted(set(ids))
    assert table.name.tolist() == [str(ids.index(key)) for key in found]
    assert table.lon0_deg.tolist() == [float(ids.index(key)) for key in found]


def test_columns_of_different_lengths_are_refused() -> None:
    good = {c: getattr(table_of_ids([(1, 2, 3)]), c) for c in RoadTable.columns()}
    with pytest.raises(ValueError, match="one length"):
        RoadTable.from_columns(**good | {"oneway": [0, 1]})


def test_subset_takes_masks_and_increasing_indices_only() -> None:
    table = table_of_ids([(k, 0, 1) for k in range(4)])
    assert table.subset(np.array([False, True, False, True])).osm_way_id.tolist() == [1, 3]
    assert table.subset(np.array([0, 2])).osm_way_id.tolist() == [0, 2]
    assert len(table.subset(np.array([], np.int64))) == 0
    with pytest.raises(ValueError, match="increase"):
        table.subset(np.array([2, 0]))


def test_within_takes_segments_that_cross_the_box_without_an_end_in_it(
    make_table: Callable[..., RoadTable],
) -> None:
    table = make_table([8.0, 8.0, 8.2], [49.0, 49.3, 49.0], [8.3, 8.3, 8.3], [49.2, 49.4, 49.05])
    assert table.within(8.1, 49.05, 8.15, 49.1).osm_way_id.tolist() == [0]
    assert table.within(8.3, 49.0, 9.0, 49.05).osm_way_id.tolist() == [0, 2]
    assert len(table.within(9.0, 49.0, 9.1, 49.1)) == 0


def test_length_is_geodesic(make_table: Callable[..., RoadTable]) -> None:
    table = make_table([8.0, 8.0], [49.0, 0.0], [8.0, 9.0], [50.0, 0.0])
    # a degree of meridian from 49 to 50 N, and of the equator, on WGS 84
    assert table.length_m == pytest.approx([111_218.8, 111_319.49], abs=1.0)


def test_empty_table_has_no_segments_and_no_bounds() -> None:
    assert len(RoadTable.empty()) == 0
    assert RoadTable.empty().length_m.shape == (0,)
    with pytest.raises(ValueError, match="zero-size"):
        RoadTable.empty().bounds_deg()


def test_rows_are_found_by_identity(town: Town) -> None:
    rows = np.flatnonzero(np.arange(len(town.roads)) % 7 == 3)
    assert rows_of(town.roads, town.roads.subset(rows)).tolist() == rows.tolist()
    assert rows_of(town.roads, RoadTable.empty()).tolist() == []
