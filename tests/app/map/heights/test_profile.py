"""The heights along one segment over HTTP: measured, of a gap, of a road that nobody drove."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sqlalchemy import text

from app.map.segment import HEIGHT_DATUM
from fusion.network.unknowns import knot_positions
from fusion.roads.table import RoadTable
from problem_support import check
from road_support import replace_roads

WEST, LAT, STEP = 8.5, 49.0, 0.001
LENGTH_M = 73.2
COLUMNS = ("along_m", "height_m", "height_sigma_m", "dem_height_m")


@pytest.fixture
def street(web: Any) -> dict[int, int]:
    """A street of four segments over ground that rises eastwards; number of each by its place.

    The first was driven, the second lies between driven ones, nobody drove the third; the fourth has no ground.
    """
    k = np.arange(4)
    table = RoadTable.from_columns(
        osm_way_id=[1] * 4,
        from_node=100 + k,
        to_node=101 + k,
        lon0_deg=WEST + STEP * k,
        lat0_deg=[LAT] * 4,
        lon1_deg=WEST + STEP * (k + 1),
        lat1_deg=[LAT] * 4,
        oneway=[0] * 4,
        bridge=[False] * 4,
        tunnel=[False] * 4,
        layer=[0] * 4,
        highway=["primary"] * 4,
        name=[None] * 4,
    )
    lon, _ = knot_positions(table)
    ground = np.where(lon > WEST + 2.99 * STEP, np.nan, 100 + (lon - WEST) / STEP)
    with web.sessions.begin() as session:
        replace_roads(session, table, "street.osm", "0" * 64, dem_heights_m=ground)
        session.execute(
            text(
                """
                INSERT INTO segment_slopes (segment_id, slope_percent, slope_sigma_percent, drives, observations,
                    height_from_m, height_to_m, height_sigma_m, steepest_percent, steepest_from_m, steepest_to_m)
                SELECT id, 2, 1, 101 - from_node, 5, 50 + from_node, 51 + from_node, 0.5, 10, 10, 20
                FROM segments WHERE from_node IN (100, 101)
                """
            )
        )
        rows = session.execute(text("SELECT from_node - 100, id FROM segments"))
        return {int(place): int(number) for place, number in rows}


def profile(web: Any, number: int, **query: str) -> dict[str, Any]:
    answer = web.client.get(f"/v1/segments/{number}/profile", params=query)
    assert answer.status_code == 200, answer.text
    said = dict(answer.json())
    assert len({len(said[name]) for name in COLUMNS}) == 1
    assert said["along_m"] == sorted(said["along_m"])
    assert (said["along_m"][0], said["along_m"][-1]) == (0, said["length_m"])
    assert (said["segment_id"], said["datum"]) == (number, HEIGHT_DATUM)
    return said


def test_what_was_driven_has_its_steepest_stretch_and_the_elevation_model(
    web: Any, street: dict[int, int]
) -> None:
    said = profile(web, street[0])
    at = dict(zip(said["along_m"], said["height_m"], strict=True))
    assert (at[0], at[said["length_m"]], said["source"]) == (150, 151, "drives")
    assert at[20] - at[10] == pytest.approx(1.0, abs=0.002)
    assert said["height_sigma_m"][0] == said["height_sigma_m"][-1] == 0.5
    assert min(said["height_sigma_m"]) == 0.5
    slope = np.polyfit(said["along_m"], said["dem_height_m"], 1)[0]
    assert slope == pytest.approx(1 / LENGTH_M, rel=0.01)
    assert max(np.diff(said["along_m"])) < 20.0


def test_a_gap_has_the_heights_of_its_neighbours_for_who_asks(web: Any, street: dict[int, int]) -> None:
    plain, asked = profile(web, street[1]), profile(web, street[1], gaps="true")
    assert (plain["source"], asked["source"]) == (None, "neighbours")
    assert set(plain["height_m"]) == set(plain["height_sigma_m"]) == {None}
    assert (asked["height_m"][0], asked["height_m"][-1]) == (151, 152)
    assert plain["dem_height_m"] == asked["dem_height_m"]
    assert asked["links"][1]["href"].endswith(f"/v1/segments/{street[1]}?gaps=true")


def test_unknown_is_null(web: Any, street: dict[int, int]) -> None:
    undriven, off_ground = profile(web, street[2], gaps="true"), profile(web, street[3])
    assert undriven["source"] is None
    assert set(undriven["height_m"]) == {None}
    assert None not in undriven["dem_height_m"][:-1]
    assert set(off_ground["dem_height_m"]) == {None}


@pytest.mark.parametrize("number", ["999", "0", "x", "9" * 30])
def test_no_such_segment_is_a_problem(web: Any, number: str) -> None:
    check(web.client.get(f"/v1/segments/{number}/profile"), 404)


def test_a_segment_leads_to_it(web: Any, street: dict[int, int]) -> None:
    for query in ({}, {"gaps": "true"}):
        links = web.client.get(f"/v1/segments/{street[1]}", params=query).json()["links"]
        (address,) = [link["href"] for link in links if link["rel"] == "related"]
        assert profile(web, street[1], **query)["links"][0]["href"] == address
