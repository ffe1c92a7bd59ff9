"""Energy of a path over HTTP: a road that drives measured in its first half, over flat ground of the model's."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
import pytest
from sqlalchemy import text

from app.map.heights.energy import Kind
from fusion.network.unknowns import knot_positions
from fusion.roads.energy import VEHICLES, Pieces, energy_along
from fusion.roads.table import RoadTable
from problem_support import check
from road_support import replace_roads

WEST, LAT, STEP, SEGMENTS = 8.5, 49.0, 0.001, 6
RISE_M, SIGMA_PERCENT = 3.0, 0.5
LINE = [[WEST + STEP * k, LAT] for k in range(SEGMENTS + 1)]


@pytest.fixture
def hill(web: Any) -> Any:
    """Three segments that rise by three metres each, and three that nobody drove."""
    k = np.arange(SEGMENTS)
    table = RoadTable.from_columns(
        osm_way_id=[1] * SEGMENTS, from_node=100 + k, to_node=101 + k, lon0_deg=WEST + STEP * k,
        lat0_deg=[LAT] * SEGMENTS, lon1_deg=WEST + STEP * (k + 1), lat1_deg=[LAT] * SEGMENTS, oneway=[0] * SEGMENTS,
        bridge=[False] * SEGMENTS, tunnel=[False] * SEGMENTS, layer=[0] * SEGMENTS, highway=["primary"] * SEGMENTS,
        name=[None] * SEGMENTS,
    )  # fmt: skip
    ground = np.full(len(knot_positions(table)[0]), 100.0)
    with web.sessions.begin() as session:
        replace_roads(session, table, "hill.osm", "0" * 64, dem_heights_m=ground)
        session.execute(
            text(
                """
                INSERT INTO segment_slopes (segment_id, slope_percent, slope_sigma_percent, drives, observations,
                    height_from_m, height_to_m, height_sigma_m)
                SELECT id, 4, :sigma, 1, 5, :rise * (from_node - 100), :rise * (from_node - 99), 0.5
                FROM segments WHERE from_node < 103
                """
            ),
            {"rise": RISE_M, "sigma": SIGMA_PERCENT},
        )
    return web


def energy(web: Any, **asked: Any) -> dict[str, Any]:
    answer = web.client.post("/v1/energy", json=asked)
    assert answer.status_code == 200, answer.text
    return dict(answer.json())


def line(coordinates: list[list[float]]) -> dict[str, Any]:
    return {"type": "LineString", "coordinates": coordinates}


def ids(web: Any) -> list[int]:
    with web.sessions() as session:
        return [row.id for row in session.execute(text("SELECT id FROM segments ORDER BY from_node"))]


def test_a_line_takes_what_its_slopes_say_beside_what_the_model_says(hill: Any) -> None:
    found = energy(hill, path=line(LINE[:4]))
    length = found["length_m"] / 3
    slope = RISE_M / length
    ones = np.ones(3)
    pieces = Pieces(length * ones, slope * ones, SIGMA_PERCENT / 100 * ones, np.arange(3), ones > 0)
    wanted = energy_along(VEHICLES["electric-car"], pieces)
    assert found["energy_kwh"] == pytest.approx(wanted.kwh, rel=5e-3)
    assert found["sigma_kwh"] == pytest.approx(wanted.sigma_kwh, rel=1e-2)
    assert found["elevation_model"] == {
        "energy_kwh": pytest.approx(found["level_kwh"], rel=1e-3),
        "known_share": 1.0,
    }
    assert (found["measured_share"], found["known_share"]) == (1.0, 1.0)
    assert found["vehicle"]["mass_kg"] == 1800
    back = energy(hill, path=line(LINE[3::-1]))
    assert back["energy_kwh"] < found["level_kwh"] < found["energy_kwh"]


def test_segments_that_follow_each_other_are_the_same_path(hill: Any) -> None:
    rows = ids(hill)
    by_line, by_ids = energy(hill, path=line(LINE)), energy(hill, segments=rows)
    for name in ("energy_kwh", "sigma_kwh", "level_kwh", "length_m"):
        assert by_ids[name] == pytest.approx(by_line[name], rel=5e-3)
    assert by_ids["measured_share"] == pytest.approx(0.5, abs=0.01)
    back = energy(hill, segments=rows[::-1])
    assert back["energy_kwh"] == pytest.approx(energy(hill, path=line(LINE[::-1]))["energy_kwh"], rel=5e-3)
    assert energy(hill, segments=rows[:1])["energy_kwh"] > energy(hill, segments=rows[:1])["level_kwh"]


def test_numbers_of_one_s_own_count(hill: Any) -> None:
    usual = energy(hill, path=line(LINE[:4]), vehicle={"kind": "truck"})
    light = energy(hill, path=line(LINE[:4]), vehicle={"kind": "truck", "mass_kg": 20_000, "auxiliary_w": 0})
    assert light["vehicle"] == usual["vehicle"] | {"mass_kg": 20_000, "auxiliary_w": 0}
    assert light["energy_kwh"] < 0.6 * usual["energy_kwh"]
    assert light["sigma_kwh"] == pytest.approx(usual["sigma_kwh"] / 2, rel=0.05)
    assert set(get_args(Kind)) == set(VEHICLES)


def test_off_the_roads_nothing_is_known(hill: Any) -> None:
    found = energy(hill, path=line([[8.6, 49.2], [8.61, 49.2]]))
    assert found["known_share"] == found["elevation_model"]["known_share"] == 0
    assert found["energy_kwh"] == found["level_kwh"] > 0 and found["sigma_kwh"] == 0
    assert energy(hill, path=line([LINE[0], LINE[0]]))["length_m"] == 0


@pytest.mark.parametrize(
    ("asked", "field"),
    [
        ({}, "path"),
        ({"path": line(LINE), "segments": [1]}, "path"),
        ({"path": line([[8.5], [8.6]])}, "path"),
        ({"path": line([[8.5, 49.0], [8.6, 149.0]])}, "path"),
        ({"segments": [10**15]}, "segments"),
        ({"path": line(LINE), "vehicle": {"kind": "horse"}}, "vehicle.kind"),
        ({"path": line(LINE), "vehicle": {"efficiency": 0}}, "vehicle.efficiency"),
    ],
)
def test_what_makes_no_sense_is_refused(hill: Any, asked: dict[str, Any], field: str) -> None:
    problem = check(hill.client.post("/v1/energy", json=asked), 422)
    assert [one["field"] for one in problem["errors"]] == [field]


def test_segments_that_do_not_meet_are_refused(hill: Any) -> None:
    rows = ids(hill)
    answer = hill.client.post("/v1/energy", json={"segments": [rows[0], rows[1], rows[3]]})
    assert check(answer, 422)["detail"].count("3 of the path") == 1
