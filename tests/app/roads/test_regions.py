"""Regions side by side: an import touches its own, says what it will do, and asks before it takes much away."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st
from sqlalchemy import text

from app.core.db import Sessions
from app.network import extracts, locks
from app.roads import imports, store
from app.roads.documents import ImportCounts, Wishes
from app.roads.imports import remove_region
from fusion.errors import RoadsError
from fusion.roads.table import RoadTable
from network_support import drive_over, rows_of
from region_support import METRE, bring, ids_of, stored

Chain = Callable[..., RoadTable]
AddDrive = Callable[..., uuid.UUID]


def everything(sessions: Sessions) -> list[tuple[object, ...]]:
    tables = ("segments", "regions", "road_versions", "drive_segments", "drive_passes", "segment_slopes",
              "retired_segments", "touched_drives", "cells")  # fmt: skip
    with sessions() as session:
        return [
            tuple(row) for t in tables for row in session.execute(text(f"SELECT * FROM {t} ORDER BY 1, 2"))
        ]


def test_a_second_town_takes_nothing_from_the_first(sessions: Sessions, chain: Chain) -> None:
    here, there = chain(6), chain(4, lon=9.5, way=8, from_node=np.arange(4) + 900, to_node=np.arange(4) + 901)
    assert bring(sessions, here) == ImportCounts("here", added=6)
    drive_over(sessions, here, ids_of(sessions, here), dict.fromkeys(range(6), (2.0, 0.5)))
    before = rows_of(sessions)
    assert bring(sessions, there, "there", yes=False) == ImportCounts("there", added=4)
    assert rows_of(sessions) == before
    assert sorted({tuple(names) for _, names in stored(sessions).values()}) == [("here",), ("there",)]
    with sessions() as session:
        figures = {one.name: (one.segments, one.measured) for one in store.region_figures(session)}
        assert figures == {"here": (6, 6), "there": (4, 0)}
        assert (
            session.execute(text("SELECT segments FROM road_versions ORDER BY id DESC LIMIT 1")).scalar()
            == 10
        )


def test_roads_of_two_regions_are_there_once_and_stay_while_either_has_them(
    sessions: Sessions, chain: Chain
) -> None:
    whole = chain(8)
    west, east = whole.subset(np.arange(5)), whole.subset(np.arange(3, 8))
    bring(sessions, west, "west")
    assert bring(sessions, east, "east") == ImportCounts("east", kept=2, added=3)
    ids = ids_of(sessions, whole)
    drive_over(sessions, whole, ids, dict.fromkeys(range(8), (2.0, 0.5)))
    counts = bring(sessions, west.subset(np.arange(2)), "west")
    assert counts == ImportCounts("west", kept=2, dropped=1, released=2, measured_lost=1, drives_again=1)
    assert {key[1]: names for key, (_, names) in stored(sessions).items()} == {
        100: ["west"], 101: ["west"], **{k: ["east"] for k in range(103, 108)},
    }  # fmt: skip
    assert remove_region(sessions, "east", Path("nowhere"), wishes=Wishes(accept_losses=True)).dropped == 5
    assert {key[1] for key in stored(sessions)} == {100, 101}
    with sessions() as session:
        assert [one.name for one in store.all_regions(session)] == ["west"]
        with pytest.raises(RoadsError, match=r"no region 'east'\. There are: west\."):
            store.known_region(session, "east")


def test_the_newest_file_counts_between_the_nodes_that_it_has(sessions: Sessions, chain: Chain) -> None:
    whole = chain(8)
    bring(sessions, whole, "large")
    short = chain(2, from_node=[100, 101], to_node=[101, 103], lon0_deg=[8.5, 8.501], lon1_deg=[8.501, 8.503])
    assert bring(sessions, short, "small") == ImportCounts("small", kept=1, merged=2, added=1)
    assert {key[1]: names for key, (_, names) in stored(sessions).items()} == {
        100: ["large", "small"], 101: ["small"], **{k: ["large"] for k in range(103, 108)},
    }  # fmt: skip


def test_more_than_a_tenth_of_what_is_measured_has_to_be_meant(
    sessions: Sessions, chain: Chain, add_drive: AddDrive
) -> None:
    bring(sessions, chain(30))
    add_drive(ids_of(sessions, chain(30)), dict.fromkeys(range(20), (1.0, 1.0)))
    before = everything(sessions)
    with pytest.raises(
        RoadsError, match=r"3 of the 20 measured segments of here\. Nothing was changed\. .*--region"
    ):
        bring(sessions, chain(30).subset(np.arange(3, 30)), yes=False)
    assert everything(sessions) == before
    assert bring(sessions, chain(30).subset(np.arange(2, 25)), yes=False).measured_lost == 2
    with pytest.raises(RoadsError, match=r"Nothing was changed\. See with .*--yes"):
        remove_region(sessions, "here", Path("nowhere"))
    assert bring(sessions, chain(30).subset(np.arange(9, 30))).measured_lost == 7


def test_a_trial_run_changes_nothing_and_says_what_the_import_does(
    sessions: Sessions, chain: Chain, add_drive: AddDrive
) -> None:
    bring(sessions, chain(10))
    add_drive(ids_of(sessions, chain(10)), dict.fromkeys(range(10), (1.0, 1.0)))
    lat1 = np.full(10, 49.0)
    lat1[2], lat1[5] = 49 + METRE, 49 + 30 * METRE
    other = chain(10, lat1_deg=lat1).subset(np.arange(1, 10))
    before = everything(sessions)
    trial = bring(sessions, other, dry_run=True, yes=False)
    assert everything(sessions) == before
    assert trial == ImportCounts(
        "here", kept=7, moved=1, far=1, dropped=1, measured_lost=2, drives_again=1, dry_run=True
    )
    assert bring(sessions, other) == replace(trial, dry_run=False)
    assert bring(sessions, other) == ImportCounts("here", kept=9)


def test_an_import_that_is_cut_off_goes_on_when_it_is_begun_again(
    sessions: Sessions, chain: Chain, monkeypatch: pytest.MonkeyPatch
) -> None:
    bring(sessions, chain(10))
    drive_over(sessions, chain(10), ids_of(sessions, chain(10)), dict.fromkeys(range(10), (2.0, 0.5)))
    lat1 = np.full(10, 49.0)
    lat1[5] = 49 + METRE
    parts = (
        chain(10, lat1_deg=lat1).subset(np.arange(1, 10)),
        chain(3, lat=49.1, way=8, from_node=[1, 2, 3], to_node=[2, 3, 4]),
    )
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in RoadTable.columns()
    }
    other = RoadTable.from_columns(**columns)

    def fails(*_: object) -> None:
        raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr(imports.steps.changing, "drop", fails)
        with pytest.raises(MemoryError):
            bring(sessions, other)
    assert len(stored(sessions)) == 13
    assert bring(sessions, other) == ImportCounts("here", kept=12, dropped=1, measured_lost=1, drives_again=1)
    assert len(stored(sessions)) == 12
    with sessions() as session:
        assert not locks.roads_change(session)
        assert session.execute(text("SELECT count(*) FROM touched_drives")).scalar_one() == 1


def test_names_come_from_files() -> None:
    for file, name in (
        ("Karlsruhe-regbez.osm.pbf", "karlsruhe-regbez"), ("a b/c.osm.gz", "a-b-c"), (".osm", "roads"),
        ("Köln.osm", "köln"), ("changes.osc.gz", "changes"), ("x" * 200 + ".pbf", "x" * 100),
    ):  # fmt: skip
        assert store.region_name(file) == name
    for bad in ("", "a b", "x" * 101, "a/b"):
        with pytest.raises(RoadsError, match="region's name"):
            store.check_name(bad)


nodes = st.lists(st.integers(1, 8), min_size=2, max_size=5, unique=True)
maps = st.tuples(
    st.lists(st.tuples(st.integers(1, 3), nodes), min_size=1, max_size=3, unique_by=lambda way: way[0]),
    st.dictionaries(st.integers(1, 8), st.sampled_from([1.0, 20.0]), max_size=3),
)
Map = tuple[list[tuple[int, list[int]]], dict[int, float]]


def made(chain: Chain, one: Map) -> RoadTable:
    """Ways of nodes that lie 50 m from each other, some of them a little or far to the side."""
    ways, moved = one
    rows = [(way, a, b) for way, some in ways for a, b in pairwise(some)]
    way, a, b = np.array(rows).T
    side = {node: m * METRE for node, m in moved.items()}
    return chain(
        len(rows), osm_way_id=way, from_node=a, to_node=b,
        lon0_deg=8.5 + 50 * METRE * a, lon1_deg=8.5 + 50 * METRE * b,
        lat0_deg=[49 + side.get(int(k), 0.0) for k in a], lat1_deg=[49 + side.get(int(k), 0.0) for k in b],
    )  # fmt: skip


@settings(
    max_examples=8,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
    phases=[Phase.explicit, Phase.reuse, Phase.generate],  # one example takes long enough
)
@example(  # two ways over the same nodes: what comes back goes to each its own
    ([(1, [6, 8, 4, 2, 5]), (2, [4, 1, 6, 5, 2]), (3, [3, 8, 4])], {6: 1.0, 2: 20.0, 7: 20.0}),
    ([(2, [6, 8, 1, 2]), (1, [7, 4])], {5: 1.0, 1: 20.0}),
)
@given(first=maps, second=maps)
def test_any_map_follows_any_other_as_it_was_foretold_and_the_first_brings_its_evidence_back(
    sessions: Sessions, chain: Chain, first: Map, second: Map
) -> None:
    one, two = made(chain, first), made(chain, second)
    with sessions.begin() as session:
        session.execute(text("DELETE FROM drives"))
        session.execute(text("DELETE FROM retired_segments"))
    bring(sessions, one)
    drive = drive_over(sessions, one, ids_of(sessions, one), dict.fromkeys(range(len(one)), (2.0, 0.5)))
    foretold = bring(sessions, two, dry_run=True)
    assert bring(sessions, two) == replace(foretold, dry_run=False)
    assert len(stored(sessions)) == len(two) == foretold.segments
    again = bring(sessions, two)
    assert again == ImportCounts("here", kept=len(two), skipped=again.skipped)
    with sessions() as session:
        table, ids = extracts.all_roads(session)
    for name in RoadTable.columns():
        assert np.array_equal(getattr(table, name), getattr(two, name)), name
    bring(sessions, one)
    with sessions() as session:
        query = text(
            "SELECT segment_id FROM drive_passes WHERE drive_id = :drive UNION ALL SELECT 0 WHERE false"
        )
        said = set(session.execute(query, {"drive": drive}).scalars())
        assert said == set(ids_of(sessions, one).tolist())
        assert session.execute(text("SELECT count(*) FROM retired_passes")).scalar_one() == 0
    assert {row[2] for row in rows_of(sessions).values()} <= {1}
    assert set(rows_of(sessions)) >= said
    assert len(ids) == len(two)
