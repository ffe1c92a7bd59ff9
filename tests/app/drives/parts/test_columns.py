"""What columns are taken as over HTTP: of a stored log, of a file to be, and corrected by another run."""

from __future__ import annotations

import gzip
from typing import Any

from problem_support import check

HEADER = b"Timestamp,Latitude,Longitude,Hoehe,Speed (km/h)\n"
ROWS = b"".join(b"2026-01-01T00:00:%02dZ,49.0,8.4,%d,50\n" % (k, 300 + k) for k in range(60))
LOG = HEADER + ROWS


def uploaded(web: Any, content: bytes = LOG, name: str = "ride.csv", **params: Any) -> str:
    answer = web.client.post("/v1/drives", files={"file": (name, content)}, params=params)
    assert answer.status_code == 202, answer.text
    return f"/v1/drives/{answer.json()['id']}"


def taken(answer: Any) -> dict[str, Any]:
    assert answer.status_code == 200, answer.text
    return {one["name"]: one["taken_as"] for one in answer.json()["columns"]}


def test_of_a_stored_log_gzipped_or_not(web: Any) -> None:
    drive = uploaded(web, gzip.compress(LOG), "ride.csv.gz")
    answer = web.client.get(f"{drive}/columns")
    assert taken(answer) == {
        "Timestamp": "time",
        "Latitude": "lat_deg",
        "Longitude": "lon_deg",
        "Hoehe": None,
        "Speed (km/h)": "speed_mps",
    }
    speed = answer.json()["columns"][-1]
    assert speed == {
        "name": "Speed (km/h)",
        "taken_as": "speed_mps",
        "unit": "km/h",
        "guessed": True,
        "values": ["50", "50", "50"],
    }
    assert f"{drive}/columns" in str(web.client.get(drive).json()["links"])


def test_corrected_by_another_run(web: Any) -> None:
    drive = uploaded(web, columns=["alt_msl_m=Hoehe"])
    assert taken(web.client.get(f"{drive}/columns"))["Hoehe"] == "alt_msl_m"
    columns = {"height_ell_m": "Hoehe", "speed_mps": "-"}
    again = web.client.post(f"{drive}/reprocess", json={"options": {"columns": columns}})
    assert again.status_code == 202, again.text
    found = taken(web.client.get(f"{drive}/columns"))
    assert (found["Hoehe"], found["Speed (km/h)"]) == ("height_ell_m", None)
    assert web.client.get(drive).json()["options"]["columns"] == columns


def test_before_it_is_uploaded(web: Any) -> None:
    incomplete = LOG.replace(b"Latitude", b"Breite")
    assert web.client.post("/v1/drives", content=incomplete).status_code == 422
    answer = web.client.post("/v1/drives/columns", content=gzip.compress(incomplete))
    assert taken(answer)["Breite"] is None
    named = web.client.post("/v1/drives/columns", content=incomplete, params={"columns": "lat_deg=Breite"})
    assert taken(named)["Breite"] == "lat_deg"
    assert web.client.get("/v1/drives").json()["drives"] == []
    check(web.client.post("/v1/drives/columns", content=LOG, params={"columns": "nonsense=Breite"}), 422)
    check(web.client.post("/v1/drives/columns", content=LOG * 60), 413)


def test_what_is_no_table_has_none(web: Any) -> None:
    files = [("file", ("a.csv", LOG)), ("file", ("b.csv", LOG.replace(b"49.0", b"49.1")))]
    both = web.client.post("/v1/drives", params={"grouping": "one"}, files=files).json()["id"]
    assert taken(web.client.get(f"/v1/drives/{both}/columns")) == {}
    assert taken(web.client.post("/v1/drives/columns", content=b"\x1f\x8bbroken")) == {}
    assert taken(web.client.post("/v1/drives/columns", content=b"")) == {}
    check(web.client.get("/v1/drives/3f1c9a52-8f0e-4b57-9d0a-5a9f6c1f0f11/columns"), 404)


def test_a_lost_log_is_said_to_be_lost(web: Any) -> None:
    drive = uploaded(web)
    for key in web.blobs.keys():  # noqa: SIM118 - no mapping
        web.blobs.delete(key)
    check(web.client.get(f"{drive}/columns"), 404)
