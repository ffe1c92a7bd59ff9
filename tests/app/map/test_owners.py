"""What is told of the drives behind a segment, and to whom."""

from __future__ import annotations

from typing import Any

import pytest

from access_support import Holder, Keyed
from app.network import extracts
from problem_support import check
from web_fixtures import add_drive


def observations(holder: Holder, segment: int, **query: Any) -> list[dict[str, Any]]:
    answer = holder.get(f"/v1/segments/{segment}/observations", params=query)
    assert answer.status_code == 200, answer.text
    found: list[dict[str, Any]] = answer.json()["observations"]
    return found


def test_observations_are_of_one_s_own_drives_with_their_share_in_all(keyed_filled: Keyed) -> None:
    keyed = keyed_filled
    mine = keyed.give(add_drive(keyed.web.sessions, [0, 1], sigma_percent=0.5), keyed.a)
    theirs = [keyed.give(add_drive(keyed.web.sessions, [0], sigma_percent=0.5), keyed.b) for _ in range(3)]
    with keyed.web.sessions() as session:
        segment = int(extracts.all_roads(session)[1][0])
    all_of_them = {one["drive_id"]: one for one in observations(keyed.operator, segment)}
    assert set(all_of_them) == {mine, *theirs}
    assert observations(keyed.a.own, segment) == [all_of_them[mine]]
    assert all_of_them[mine]["weight"] == pytest.approx(0.25)
    assert {one["drive_id"] for one in observations(keyed.b.own, segment)} == set(theirs)
    address, found = f"/v1/segments/{segment}/observations?limit=2", []
    while address:
        page = keyed.b.own.get(address).json()
        found += [one["drive_id"] for one in page["observations"]]
        address = next((one["href"] for one in page["links"] if one["rel"] == "next"), "")
    assert sorted(found) == sorted(theirs)
    check(keyed.a.upload.get(f"/v1/segments/{segment}/observations"), 403)
    check(keyed.web.client.get(f"/v1/segments/{segment}/observations"), 401)


def test_nobody_reads_of_a_segment_what_names_a_drive(keyed_filled: Keyed) -> None:
    keyed = keyed_filled
    drive = keyed.give(add_drive(keyed.web.sessions, [0, 1]), keyed.a)
    with keyed.web.sessions() as session:
        segment = int(extracts.all_roads(session)[1][0])
    for path in ("", "/profile"):
        answer = keyed.web.client.get(f"/v1/segments/{segment}{path}")
        assert answer.status_code == 200
        assert drive not in answer.text
        assert "observations" not in {one["rel"] for one in answer.json()["links"]}
    links = keyed.b.own.get(f"/v1/segments/{segment}").json()["links"]
    assert "observations" in {one["rel"] for one in links}
