"""What was recorded as another sport than is asked for is left out of an upload, and says so."""

from __future__ import annotations

import gzip
from datetime import timedelta
from typing import Any

from garmin_files import drive_fit
from ride_archive import FIRST, csv_ride, fit_ride, gpx_ride, tcx_ride, zipped

DAY = timedelta(days=1)
FILES = {
    "swim.fit": fit_ride(FIRST, 5),
    "ride.tcx": tcx_ride(FIRST + DAY),
    "run.gpx": gpx_ride(FIRST + 2 * DAY, "running"),
    "untold.csv": csv_ride(FIRST + 3 * DAY),
}


def test_files_of_other_sports_are_left_out_where_that_is_asked_for(web: Any) -> None:
    data = zipped(FILES)
    every = web.client.post("/v1/drives", content=data).json()
    assert [one["files"] for one in every["drives"]] == [[name] for name in FILES]
    roads = web.client.post("/v1/drives?sports=roads", content=data).json()
    assert [one["files"] for one in roads["drives"]] == [["ride.tcx"], ["untold.csv"]]
    assert all(one["known"] for one in roads["drives"])
    assert {one["file"]: one["kind"] for one in roads["left_out"]} == {
        "swim.fit": "not-on-roads", "run.gpx": "not-on-roads",
    }  # fmt: skip
    assert roads["left_out"][0]["said"]["parameters"] == {"sport": "swimming"}
    both = web.client.post("/v1/drives?sports=roads&sports=run", content=data).json()
    assert [one["file"] for one in both["left_out"]] == ["swim.fit"]
    wrong = web.client.post("/v1/drives?sports=chess", content=data)
    assert wrong.status_code == 422
    assert "'chess' is no sport" in wrong.json()["detail"]


def test_one_drive_among_other_sports_is_kept_without_them(web: Any) -> None:
    data = zipped({name: FILES[name] for name in ("swim.fit", "ride.tcx")})
    sent = web.client.post("/v1/drives?sports=roads", content=data).json()
    assert sent["drives"][0]["files"] == ["ride.tcx"]
    assert web.client.get(f"/v1/drives/{sent['id']}/log").content == FILES["ride.tcx"]
    assert len(web.blobs.keys()) == 1


def test_nothing_but_other_sports_is_refused_and_leaves_nothing(web: Any) -> None:
    for data in (FILES["swim.fit"], gzip.compress(FILES["run.gpx"]), zipped({"a.fit": FILES["swim.fit"]})):
        answer = web.client.post("/v1/drives?sports=roads", content=data)
        assert (answer.status_code, answer.json()["type"].rpartition("/")[2]) == (422, "not-on-roads")
        assert web.blobs.keys() == []
    assert web.client.post("/v1/drives?sports=roads", content=drive_fit()).status_code == 202


def test_a_list_among_the_files_says_their_sports(web: Any) -> None:
    rows = "id,date,name,type,x,Filename\n1,d,n,Swim,,activities/ride.tcx\n2,d,n,Ride,,activities/run.gpx\n"
    form = [("file", (name, FILES[name])) for name in ("ride.tcx", "run.gpx")]
    form.append(("file", ("activities.csv", rows.encode())))
    sent = web.client.post("/v1/drives?sports=roads", files=form).json()
    assert sent["drives"][0]["files"] == ["run.gpx"]
    assert {one["file"]: one["kind"] for one in sent["left_out"]} == {
        "ride.tcx": "not-on-roads", "activities.csv": "unknown-format",
    }  # fmt: skip
