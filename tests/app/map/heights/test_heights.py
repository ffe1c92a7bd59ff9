"""Heights of the road over HTTP: a bridge over a valley road, of which a part was measured."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import text

from app.core.errors import BadRequestError
from app.map.heights import places as reading
from app.map.heights.road_heights import MODEL_SIGMA_M
from fusion.network.unknowns import knot_positions
from fusion.roads.table import RoadTable
from problem_support import check
from road_support import replace_roads

WEST, LAT, STEP = 8.5, 49.0, 0.001
BRIDGE = (3, 4, 5)  # of the ten segments of the upper road
LOWER_LON = WEST + 4.5 * STEP
LOWER_M, UPPER_M = 100.0, 120.0
FAR = '{"shape":[{"lat":0,"lon":0},{"lat":50,"lon":50}],"resample_distance":1}'


def scene() -> RoadTable:
    """A road of ten segments eastwards with a bridge in it, and one of four that passes below from south to north."""
    k, j = np.arange(10), np.arange(4)
    return RoadTable.from_columns(
        osm_way_id=[1] * 10 + [2] * 4,
        from_node=[*(100 + k), *(200 + j)],
        to_node=[*(101 + k), *(201 + j)],
        lon0_deg=[*(WEST + STEP * k), *([LOWER_LON] * 4)],
        lat0_deg=[*([LAT] * 10), *(LAT + STEP * (j - 2.0))],
        lon1_deg=[*(WEST + STEP * (k + 1)), *([LOWER_LON] * 4)],
        lat1_deg=[*([LAT] * 10), *(LAT + STEP * (j - 1.0))],
        oneway=[0] * 14,
        bridge=[n in BRIDGE for n in range(14)],
        tunnel=[False] * 14,
        layer=[0] * 14,
        highway=["primary"] * 14,
        name=[None] * 14,
    )


@pytest.fixture
def valley(web: Any) -> Any:
    """The service with these roads: the ground is low under the bridge, the first two segments are measured."""
    table = scene()
    lon, _ = knot_positions(table)
    low = np.abs(lon - LOWER_LON) < 1.4 * STEP
    ground = np.where(low, LOWER_M, UPPER_M)
    with web.sessions.begin() as session:
        replace_roads(session, table, "valley.osm", "0" * 64, dem_heights_m=ground)
        for node, start, end in ((100, 150.0, 151.0), (101, 151.0, 153.0)):
            session.execute(
                text(
                    """
                    INSERT INTO segment_slopes (segment_id, slope_percent, slope_sigma_percent, drives, observations,
                        height_from_m, height_to_m, height_sigma_m, steepest_percent, steepest_from_m, steepest_to_m)
                    SELECT id, 2, 1, 1, 5, :start, :end, 0.5, 10, 10, 20 FROM segments WHERE from_node = :node
                    """
                ),
                {"node": node, "start": start, "end": end},
            )
    return web


def height(web: Any, *places: tuple[float, float], **options: Any) -> dict[str, Any]:
    shape = [{"lat": lat, "lon": lon} for lon, lat in places]
    answer = web.client.post("/height", json={"shape": shape, **options})
    assert answer.status_code == 200, answer.text
    return dict(answer.json())


def upper(at: float) -> tuple[float, float]:
    """A place on the upper road, so many segments from its west."""
    return WEST + STEP * at, LAT


def test_measured_heights_come_first_then_the_model_then_bridges_between_their_ends(valley: Any) -> None:
    got = height(valley, *[upper(at) for at in (0.0, 1.0, 2.0, 2.5, 3.5, 4.5, 5.5, 8.0)])
    assert got["height"] == pytest.approx([150, 151, 153, UPPER_M, UPPER_M, UPPER_M, UPPER_M, UPPER_M])
    assert got["source"] == [
        *["measured"] * 3, "elevation model", *["between the ends of a bridge or tunnel"] * 3, "elevation model"
    ]  # fmt: skip
    assert got["sigma"][:4] == pytest.approx([0.5, 0.5, 0.5, MODEL_SIGMA_M])
    assert got["sigma"][5] > got["sigma"][4] > MODEL_SIGMA_M
    assert "mean sea level" in got["datum"]
    assert "OpenStreetMap" in got["attribution"]


def test_the_steepest_stretch_is_in_a_measured_course(valley: Any) -> None:
    """10 % from 10 m to 20 m of a segment that rises by 1 m in all: what lies around it falls a little or is level."""
    length_m = 73.2
    before, after = (upper(metres / length_m) for metres in (10.0, 20.0))
    low, high = height(valley, before, after)["height"]
    assert high - low == pytest.approx(1.0, abs=0.02)
    assert low == pytest.approx(150, abs=0.02)


def test_a_line_has_the_heights_of_the_road_that_it_follows(valley: Any) -> None:
    """Where roads cross without meeting, both are near: the line says which is meant, a single place cannot."""
    crossing = (LOWER_LON, LAT)
    along = [upper(at) for at in (4.1, 4.3, 4.5, 4.7, 4.9)]
    below = [(LOWER_LON, LAT + STEP * at) for at in (-0.5, -0.2, 0.0, 0.2, 0.5)]
    assert along[2] == pytest.approx(crossing)
    assert height(valley, *along)["height"] == pytest.approx([UPPER_M] * 5)
    assert height(valley, *below)["height"] == pytest.approx([LOWER_M] * 5)
    assert height(valley, *reversed(below))["height"] == pytest.approx([LOWER_M] * 5)


def test_slopes_are_those_of_the_line_and_steps_between_sources_are_no_hills(valley: Any) -> None:
    """Two measured segments rise by 1 and 2 m; then the model begins 33 m below and is level, under a bridge too."""
    up = [upper(0.02), upper(9.98)]
    there = height(valley, *up, slope=True, resample_distance=2)
    back = height(valley, *reversed(up), slope=True, resample_distance=2)
    plain = height(valley, *up, resample_distance=2)
    assert not {"slope_percent", "slope_sigma_percent", "climb"} & plain.keys()
    assert there["height"] == plain["height"]
    slope = np.array(there["slope_percent"])
    assert slope.max() == pytest.approx(10, abs=0.5)  # the steepest stretch
    assert slope[there["source"].index("elevation model") + 5 :] == pytest.approx(0)
    assert np.array(back["slope_percent"])[::-1] == pytest.approx(-slope, abs=0.6)
    sigma = np.array(there["slope_sigma_percent"])
    assert sigma[0] == 1
    assert sigma[-1] == pytest.approx(100 * 1.5 * 2**0.5 / 73.2, abs=0.01)
    climb = there["climb"]
    assert climb["ascent_m"] - climb["descent_m"] == pytest.approx(3.0, abs=0.1)
    assert climb["ascent_m"] == pytest.approx(back["climb"]["descent_m"], abs=0.1)
    assert climb["measured_share"] == pytest.approx(0.2, abs=0.01)
    assert climb["known_share"] == 1
    # Each of the measured segments is wrong by 1 % of what rises of it.
    assert 0.2 < climb["ascent_sigma_m"] < 1.1


def test_a_line_across_a_road_and_one_off_all_roads_have_no_slope(valley: Any) -> None:
    place = WEST + 0.5 * STEP
    got = height(valley, (place, LAT - 1e-4), (place, LAT + 1e-4), (place, LAT + 0.1), slope=True)
    assert got["slope_percent"] == [None] * 3
    assert got["climb"]["known_share"] == 0
    assert got["climb"]["ascent_m"] == 0
    one = height(valley, upper(0.5), slope=True)
    assert "climb" not in one


def test_off_the_network_is_null_and_the_radius_is_a_choice(valley: Any) -> None:
    off = (WEST + 0.5 * STEP, LAT + 40 / 111_132)
    assert height(valley, off)["height"] == [None]
    assert height(valley, off)["source"] == [None]
    assert height(valley, off, radius_m=60)["height"] == pytest.approx([150.5], abs=0.5)


def test_range_resampling_precision_and_polylines_are_valhallas(valley: Any) -> None:
    got = height(valley, upper(6.5), upper(7.5), range=True, resample_distance=10, height_precision=0, id="a")
    assert got["id"] == "a"
    assert [d for d, _ in got["range_height"]] == pytest.approx(np.linspace(0, 73.1, 8), abs=0.3)
    assert {h for _, h in got["range_height"]} == {UPPER_M}
    assert len(got["shape"]) == 8
    line = encode([upper(6.5), upper(7.5)], 6)
    by_query = valley.client.get("/height", params={"json": json.dumps({"encoded_polyline": line})}).json()
    assert by_query["encoded_polyline"] == line
    assert by_query["height"] == [UPPER_M, UPPER_M]


def test_elevation_is_the_answer_that_googles_clients_read(valley: Any) -> None:
    places = [upper(0.0), upper(6.5), (WEST, LAT + 1)]
    query = "|".join(f"{lat},{lon}" for lon, lat in places)
    answer = valley.client.get("/v1/elevation", params={"locations": query, "key": "abc"}).json()
    assert answer["status"] == "OK"
    assert [one["elevation"] for one in answer["results"]] == [150.0, UPPER_M, None]
    where = [(r["location"]["lng"], r["location"]["lat"]) for r in answer["results"]]
    assert np.array(where) == pytest.approx(np.array(places))
    encoded = valley.client.get("/v1/elevation", params={"locations": "enc:" + encode(places, 5)}).json()
    assert [one["elevation"] for one in encoded["results"]] == [150.0, UPPER_M, None]
    path = f"{LAT},{upper(3.2)[0]}|{LAT},{upper(5.8)[0]}"
    along = valley.client.get("/v1/elevation", params={"path": path, "samples": 5}).json()
    assert [one["elevation"] for one in along["results"]] == pytest.approx([UPPER_M] * 5)


@pytest.mark.parametrize(
    ("path", "status", "field"),
    [
        ("/v1/elevation", 422, "locations"),
        ("/v1/elevation?locations=", 422, "locations"),
        ("/v1/elevation?locations=a,b", 422, "locations"),
        ("/v1/elevation?locations=91,8", 422, "locations"),
        ("/v1/elevation?locations=nan,8", 422, "locations"),
        ("/v1/elevation?locations=49,8&path=49,8", 422, "locations"),
        ("/v1/elevation?path=49,8|49,9", 422, "samples"),
        ("/v1/elevation?path=49,8&samples=3", 422, "path"),
        ("/v1/elevation?locations=enc:_p~iF~ps", 422, "locations"),
        ("/v1/elevation?locations=enc:%20", 422, "locations"),
        ("/v1/elevation?locations=49,8&radius_m=1000", 422, "radius_m"),
        ("/v1/elevation?locations=" + "|".join(["49,8"] * 513), 422, "locations"),
        ("/height", 422, "json"),
        ("/height?json=[", 422, "json"),
        ("/height?json={}", 422, "shape"),
        ('/height?json={"shape":[]}', 422, "shape"),
        ('/height?json={"shape":[{"lat":95,"lon":8}]}', 422, "json"),
        ('/height?json={"shape":[{"lat":49,"lon":8}],"height_precision":9}', 422, "json"),
        (f"/height?json={FAR}", 422, "resample_distance"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_named(valley: Any, path: str, status: int, field: str) -> None:
    problem = check(valley.client.get(path), status)
    assert problem["errors"][0]["field"] == field


def test_an_empty_service_knows_no_height(web: Any) -> None:
    assert height(web, (8.0, 49.0), (8.1, 49.0))["height"] == [None, None]


def encode(places: list[tuple[float, float]], digits: int) -> str:
    """A polyline, by the published steps."""
    text_ = ""
    last = [0, 0]
    for lon, lat in places:
        for axis, value in enumerate((lat, lon)):
            now = round(value * 10**digits)
            step = now - last[axis]
            last[axis] = now
            bits = ~(step << 1) if step < 0 else step << 1
            while bits >= 0x20:
                text_ += chr((0x20 | (bits & 0x1F)) + 63)
                bits >>= 5
            text_ += chr(bits + 63)
    return text_


@given(
    st.lists(st.tuples(st.floats(-180, 180), st.floats(-90, 90)), min_size=1, max_size=20),
    st.sampled_from([5, 6]),
)
def test_polylines_come_back(places: list[tuple[float, float]], digits: int) -> None:
    got = reading.from_polyline(encode(places, digits), digits, "x", 100)
    assert np.abs(got - np.array(places)).max() <= 0.51 * 10**-digits


def test_the_documented_polyline_is_read() -> None:
    got = reading.from_polyline("_p~iF~ps|U_ulLnnqC_mqNvxq`@", 5, "x", 3)
    assert got == pytest.approx(np.array([(-120.2, 38.5), (-120.95, 40.7), (-126.453, 43.252)]))


@given(st.text(st.characters(max_codepoint=200), max_size=30))
def test_any_text_is_read_or_refused(line: str) -> None:
    try:
        places = reading.from_polyline(line, 5, "x", 100)
    except BadRequestError:
        return
    assert np.abs(places[:, 1]).max() <= 90


def test_places_along_a_line_are_equally_far_apart() -> None:
    line = np.array([(8.0, 49.0), (8.01, 49.0), (8.01, 49.02)])
    wanted_m = reading.distances_along_m(line)[-1] / 6
    steps_m = np.diff(reading.distances_along_m(reading.spread(line, 7)))
    straight = [0, *range(2, 6)]  # the second step cuts the corner
    assert steps_m[straight] == pytest.approx([wanted_m] * 5, rel=1e-3)
    assert steps_m[1] < wanted_m
