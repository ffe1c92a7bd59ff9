"""An owner's zones over HTTP: set together, seen by nobody else."""

from __future__ import annotations

from typing import Any

import pytest

from access_support import Keyed
from problem_support import check


def zone(lon: Any = 8.67, lat: Any = 49.41, radius: Any = 300.0, name: Any = "home") -> dict[str, Any]:
    return {
        "type": "Feature",
        "geometry": {"type": "Point", "coordinates": [lon, lat]},
        "properties": {"name": name, "radius_m": radius},
    }


def put(guarded: Keyed, caller: str, *features: dict[str, Any]) -> Any:
    document = {"type": "FeatureCollection", "features": list(features)}
    return guarded.ask(caller, "PUT", "/v1/owner/zones", json=document)


def test_they_are_set_together(guarded: Keyed) -> None:
    both = [zone(), zone(-180, -90, 5000.0, "the office's gate")]
    assert put(guarded, "anna", *both).status_code == 204
    answer = guarded.ask("anna", "GET", "/v1/owner/zones")
    assert answer.headers["content-type"] == "application/geo+json"
    assert answer.json() == {"type": "FeatureCollection", "features": both}
    assert put(guarded, "anna", both[1]).status_code == 204
    assert guarded.ask("anna", "GET", "/v1/owner/zones").json()["features"] == [both[1]]
    for other in ("ben", "operate"):
        assert guarded.ask(other, "GET", "/v1/owner/zones").json()["features"] == []
    assert put(guarded, "ben").status_code == 204
    assert guarded.ask("anna", "GET", "/v1/owner/zones").json()["features"] == [both[1]]


def test_there_are_fifty_at_most(guarded: Keyed) -> None:
    assert put(guarded, "anna", *[zone()] * 50).status_code == 204
    check(put(guarded, "anna", *[zone()] * 51), 422)
    assert len(guarded.ask("anna", "GET", "/v1/owner/zones").json()["features"]) == 50


@pytest.mark.parametrize(
    "wrong",
    [
        zone(lon=181),
        zone(lat=91),
        zone(lon="x"),
        zone(radius=49),
        zone(radius=5001),
        zone(radius=None),
        zone(name=""),
        zone(name="a\nb"),
        {**zone(), "id": 5},
        {**zone(), "geometry": {"type": "Point", "coordinates": [8.67]}},
        {**zone(), "geometry": {"type": "LineString", "coordinates": [[8.67, 49.4], [8.7, 49.4]]}},
    ],
)
def test_what_is_no_zone(guarded: Keyed, wrong: dict[str, Any]) -> None:
    check(put(guarded, "anna", wrong), 422)


def test_the_audit_has_how_many_and_no_place(guarded: Keyed) -> None:
    put(guarded, "anna", zone())
    rows = guarded.ask("operate", "GET", "/v1/admin/audit?days=1").text
    assert "zones changed" in rows
    assert "8.67" not in rows
    assert "home" not in rows
