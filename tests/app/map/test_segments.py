"""Drives that are solved together, as the API shows them."""

from __future__ import annotations

from typing import Any

import pytest

from app.map.segment import HEIGHT_DATUM
from app.network import extracts as roads
from fusion.network.combine import NETWORK_ONLY
from network_support import drive_over, new_drive, pass_over, publish
from problem_support import check
from processing_support import carry_out_removals

ITEMS = "/collections/segments/items"


FIRST = 56  # row of the grid at which the southernmost street, 146 m a segment, begins


@pytest.fixture
def street(filled: Any) -> list[int]:
    """Ids of a street's segments; 0, 1 and 3 were driven, 0 by three drives, one of which contradicts."""
    with filled.sessions() as session:
        table, ids = roads.all_roads(session)
    for slope in (2.0, 2.1):
        drive_over(filled.sessions, table, ids, dict.fromkeys((FIRST, FIRST + 1, FIRST + 3), (slope, 0.4)))
    odd = new_drive(filled.sessions)
    publish(filled.sessions, odd, ids, [pass_over(table, FIRST, 9.0, 0.3)])
    return [int(i) for i in ids[FIRST : FIRST + 7]]


def items(web: Any, **query: str) -> dict[int, dict[str, Any]]:
    answer = web.client.get(ITEMS, params={"limit": 50, "bbox": "8.39,48.99,8.5,49.0001", **query})
    assert answer.status_code == 200, answer.text
    return {f["id"]: f["properties"] for f in answer.json()["features"]}


def test_gaps_have_a_slope_for_who_asks(filled: Any, street: list[int]) -> None:
    gap = street[2]
    plain, asked = items(filled), items(filled, gaps="true")
    assert plain[gap]["slope_percent"] is None
    assert plain[gap]["updated_at"] is None
    assert asked[gap]["slope_percent"] is not None
    assert (asked[gap]["drives"], asked[gap]["observations"]) == (0, 0)
    assert items(filled, gaps="false") == plain
    assert gap not in items(filled, gaps="true", driven="true")
    assert asked[gap] == items(filled, gaps="true", driven="false")[gap]
    assert {i for i, p in plain.items() if p["drives"]} == {street[k] for k in (0, 1, 3)}


def test_heights_are_wherever_a_segment_is(filled: Any, street: list[int]) -> None:
    """The same in items, in a GeoJSON tile and by itself; null off the network, and in no vector tile."""
    shown = items(filled)
    tile = filled.client.get("/tiles/14/8574/5626.geojson").json()
    assert tile["height_datum"] == filled.client.get(ITEMS).json()["height_datum"] == HEIGHT_DATUM
    in_tile = {f["id"]: f["properties"] for f in tile["features"]}
    for segment, driven in ((street[0], True), (street[1], True), (street[5], False)):
        alone = filled.client.get(f"/v1/segments/{segment}").json()["properties"]
        assert alone == shown[segment] == in_tile[segment]
        for name in NETWORK_ONLY:
            assert (alone[name] is not None) == driven, name
    rounding = 0.002 * shown[street[0]]["height_sigma_m"]  # smaller changes are not written
    assert shown[street[0]]["height_to_m"] == pytest.approx(shown[street[1]]["height_from_m"], abs=rounding)
    assert shown[street[0]]["driven_share"] == 1.0
    assert shown[street[0]]["steepest_to_m"] - shown[street[0]]["steepest_from_m"] == pytest.approx(20.0)
    gap = items(filled, gaps="true")[street[2]]
    assert gap["driven_share"] == 0.0
    assert gap["height_from_m"] == pytest.approx(shown[street[1]]["height_to_m"], abs=rounding)
    fields = filled.client.get("/tiles.json").json()["vector_layers"][0]["fields"]
    assert not set(fields) & set(NETWORK_ONLY)


@pytest.mark.parametrize("route", ["/v1/segments", ITEMS])
def test_a_single_gap_has_a_slope_for_who_asks(filled: Any, street: list[int], route: str) -> None:
    def one(k: int, **query: str) -> dict[str, Any]:
        answer = filled.client.get(f"{route}/{street[k]}", params=query)
        assert answer.status_code == 200, answer.text
        (self_link,) = [link["href"] for link in answer.json()["links"] if link["rel"] == "self"]
        assert ("gaps=true" in self_link) == (query == {"gaps": "true"})
        return dict(answer.json()["properties"])

    assert one(2)["slope_percent"] is None
    assert one(2, gaps="true") == items(filled, gaps="true")[street[2]]
    assert one(2, gaps="false") == one(2)
    assert one(1, gaps="true") == one(1)


def test_next_links_keep_asking_for_gaps(filled: Any, street: list[int]) -> None:
    page = filled.client.get(ITEMS, params={"limit": 1, "gaps": "true"}).json()
    following = [link["href"] for link in page["links"] if link["rel"] == "next"]
    assert "gaps=true" in following[0]


def test_a_gap_is_no_driven_road(filled: Any, street: list[int]) -> None:
    stats = filled.client.get("/v1/admin/stats").json()
    assert stats["segments_driven"] == 3
    driven_km = sum(items(filled)[street[k]]["length_m"] for k in (0, 1, 3)) / 1000
    assert sum(stats["driven_km_by_highway"].values()) == pytest.approx(driven_km, abs=1e-5)
    tile = filled.client.get("/tiles/14/8574/5626.geojson")
    shown = {f["id"]: f["properties"]["slope_percent"] for f in tile.json()["features"]}
    assert shown[street[1]] is not None
    assert shown[street[2]] is None


def test_observations_say_which_drives_are_accepted(filled: Any, street: list[int]) -> None:
    found = filled.client.get(f"/v1/segments/{street[0]}/observations").json()["observations"]
    assert len(found) == 3
    assert all(one["in_network"] for one in found)
    (odd,) = [one for one in found if not one["accepted"]]
    assert (odd["slope_percent"], odd["weight"]) == (9.0, 0.0)
    assert sum(one["weight"] for one in found) == pytest.approx(1.0, abs=1e-3)
    assert items(filled)[street[0]]["drives"] == 2
    (own,) = filled.client.get(f"/v1/drives/{odd['drive_id']}/segments").json()["features"]
    properties = own["properties"]
    assert (properties["in_network"], properties["accepted"], properties["combined_drives"]) == (
        True,
        False,
        2,
    )


def test_slope_only_drives_are_neither_accepted_nor_rejected(filled: Any, drive_maker: Any) -> None:
    drive = drive_maker(filled.sessions, [0])
    first = filled.client.get(f"/v1/drives/{drive}/segments").json()["features"][0]
    found = filled.client.get(f"/v1/segments/{first['id']}/observations").json()["observations"]
    assert [(one["in_network"], one["accepted"], one["weight"]) for one in found] == [(False, None, 1.0)]
    alone = filled.client.get(f"/v1/segments/{first['id']}").json()["properties"]
    assert [alone[name] for name in NETWORK_ONLY] == [None] * len(NETWORK_ONLY)


def test_deleting_the_drives_takes_the_gaps_along(filled: Any, street: list[int]) -> None:
    behind = filled.client.get(f"/v1/segments/{street[0]}/observations").json()["observations"]
    for one in behind:
        assert filled.client.delete(f"/v1/drives/{one['drive_id']}").status_code == 202
        carry_out_removals(filled.sessions, filled.blobs)
    assert all(p["slope_percent"] is None for p in items(filled, gaps="true").values())


def all_pages(web: Any, path: str, member: str) -> tuple[list[dict[str, Any]], int]:
    found: list[dict[str, Any]] = []
    pages = 0
    while path:
        document = web.client.get(path).json()
        found, pages = found + document[member], pages + 1
        path = next((link["href"] for link in document["links"] if link["rel"] == "next"), "")
    return found, pages


def test_observations_come_in_pages_and_each_has_its_share_of_all(filled: Any, street: list[int]) -> None:
    """Also where two drives came there at the same moment."""
    path = f"/v1/segments/{street[0]}/observations"
    whole = filled.client.get(path).json()["observations"]
    found, pages = all_pages(filled, f"{path}?limit=1", "observations")
    assert found == whole
    assert pages == len(whole) == 3
    moments = [one["first_at"] for one in found]
    assert moments == sorted(moments, reverse=True)
    assert sum(one["weight"] for one in found) == pytest.approx(1.0, abs=1e-3)


def test_a_drive_s_estimates_come_in_pages_in_the_order_of_driving(filled: Any, drive_maker: Any) -> None:
    drive = drive_maker(filled.sessions, [5, 3, 4, 0, 9])
    path = f"/v1/drives/{drive}/segments"
    whole = filled.client.get(path).json()["features"]
    moments = [one["properties"]["first_at"] for one in whole]
    assert moments == sorted(moments)
    assert all_pages(filled, f"{path}?limit=2", "features") == (whole, 3)
    assert all_pages(filled, f"{path}?limit=99999", "features") == (whole, 1)


@pytest.mark.parametrize(
    ("query", "field"), [("limit=0", "limit"), ("after=x", "after"), ("after=f" + "_" * 31, "after")]
)
def test_pages_that_there_are_not(reading: Any, query: str, field: str) -> None:
    drive = reading.client.get("/v1/drives").json()["drives"][0]["id"]
    for path in ("/v1/segments/1/observations", f"/v1/drives/{drive}/segments"):
        problem = check(reading.client.get(f"{path}?{query}"), 422)
        assert [error["field"] for error in problem["errors"]] == [field]


def test_no_segment_has_such_a_number(reading: Any) -> None:
    drive = reading.client.get("/v1/drives").json()["drives"][0]["id"]
    check(reading.client.get(f"/v1/drives/{drive}/segments?after=" + "_" * 32), 422)
