"""A zip of several drives becomes as many, what belongs together one, and each file that comes to nothing says why."""

from __future__ import annotations

import gzip
import io
import uuid
import zipfile
from pathlib import Path
from typing import Any

from sqlalchemy import text

from app.drives.process import Outcome
from app.drives.receiving.zips import MAX_FILES
from fusion.formats import read_log
from fusion.simulate.write.rinex_file import navigation, observations
from garmin_files import drive_fit
from gnss_tables import some_navigation, some_signals
from log_samples import START, sensor_logger
from processing_support import process_drive

DAY_S = 86400
T0 = 1_600_000_000


def ride(day: int, rows: int = 40, began_s: int = 0, lat: float = 49.0) -> bytes:
    """A CSV that goes north."""
    at = T0 + day * DAY_S + began_s
    lines = (f"{at + k},{lat + 1e-4 * k:.5f},8.4" for k in range(rows))
    return ("time_s,lat_deg,lon_deg\n" + "\n".join(lines) + "\n").encode()


def zipped(**files: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name.replace("_", "."), data)
    return out.getvalue()


RIDES = {f"ride{k}_csv": ride(k) for k in range(4)} | {"garmin_fit": drive_fit(40)}


def sent(web: Any, data: bytes, status: int = 202, **query: str) -> dict[str, Any]:
    answer = web.client.post("/v1/drives", params={"filename": "rides.zip", **query}, content=data)
    assert answer.status_code == status, answer.text
    document: dict[str, Any] = answer.json()
    first = document["drives"][0]
    assert {name: document[name] for name in ("id", "status", "links")} == {
        name: first[name] for name in ("id", "status", "links")
    }
    assert answer.headers["location"].endswith(f"/v1/drives/{document['id']}")
    return document


def files_of(document: dict[str, Any]) -> list[list[str]]:
    return [drive["files"] for drive in document["drives"]]


def test_five_rides_are_five_drives_with_their_own_bytes_and_the_same_zip_makes_no_more(web: Any) -> None:
    data = zipped(**RIDES)
    document = sent(web, data)
    names = [name.replace("_", ".") for name in RIDES]
    assert files_of(document) == [[name] for name in names]
    assert document["left_out"] == []
    assert all(not drive["known"] and drive["unclear"] == [] for drive in document["drives"])
    for drive, content in zip(document["drives"], RIDES.values(), strict=True):
        log = web.client.get(f"/v1/drives/{drive['id']}/log")
        assert log.content == content
        row = web.client.get(f"/v1/drives/{drive['id']}").json()
        assert ([row["filename"]], row["size_bytes"]) == (drive["files"], len(content))
    assert len(web.blobs.keys()) == 5
    again = sent(web, data, 200)
    assert [drive["id"] for drive in again["drives"]] == [drive["id"] for drive in document["drives"]]
    assert all(drive["known"] for drive in again["drives"])
    form = [
        ("file", (name, gzip.compress(content))) for name, content in zip(names, RIDES.values(), strict=True)
    ]
    apart = web.client.post("/v1/drives", files=form)
    assert apart.status_code == 200
    assert {drive["id"] for drive in apart.json()["drives"]} == {drive["id"] for drive in document["drives"]}
    alone = web.client.post("/v1/drives?filename=r", content=RIDES["ride2_csv"])
    assert (alone.status_code, alone.json()["id"]) == (200, document["drives"][2]["id"])
    assert len(web.blobs.keys()) == 5
    assert web.client.delete(f"/v1/drives/{document['id']}").status_code == 202
    assert [one["known"] for one in sent(web, data)["drives"]] == [False, True, True, True, True]


def test_each_broken_file_says_why_and_the_others_go_on(web: Any) -> None:
    broken = {
        "readme_txt": b"These are my rides.",
        "empty_gpx": b"<gpx><trk/></gpx>",
        "copy_csv": RIDES["ride1_csv"],
        "packed_gz": gzip.compress(RIDES["ride1_csv"]),
        "imu_csv": b"time_s,gyr_z_dps\n%d,0.1\n" % (T0 + 50 * DAY_S),
        "photo_jpg": b"\xff\xd8\xff" * 30,
    }
    document = sent(web, zipped(**RIDES, **broken))
    assert len(document["drives"]) == 5
    assert {one["file"]: one["kind"] for one in document["left_out"]} == {
        "readme.txt": "unknown-format",
        "empty.gpx": "empty-log",
        "copy.csv": "repeated",
        "packed.gz": "repeated",
        "imu.csv": "no-drive",
        "photo.jpg": "unknown-format",
    }
    reasons = {one["file"]: one["reason"] for one in document["left_out"]}
    assert reasons["copy.csv"] == "It holds the same as ride1.csv, and counts once."
    assert "JPEG picture" in reasons["photo.jpg"]
    assert all(reason.endswith(".") and len(reason) < 150 for reason in reasons.values())
    assert len(web.blobs.keys()) == 5


def test_observations_and_navigation_are_one_drive_kept_as_the_zip_that_came(web: Any) -> None:
    signals = some_signals(1, 30, 1.38e9)
    day = {
        "a_rnx": observations(signals).encode(),
        "n_rnx": navigation(some_navigation(2, 60, 1.38e9)).encode(),
    }
    imu = {
        "imu_csv": b"time_s,gyr_z_dps\n" + b"".join(b"%d,0.1\n" % (signals.time_s[0] + k) for k in range(30))
    }
    data = zipped(**day, **imu, notes_txt=b"hello there")
    document = sent(web, data)
    assert files_of(document) == [["a.rnx", "n.rnx", "imu.csv"]]
    assert [one["file"] for one in document["left_out"]] == ["notes.txt"]
    assert web.client.get(f"/v1/drives/{document['id']}/log").content == data
    # With a ride of another day there are two, each whole.
    both = sent(web, zipped(**day, **imu, ride_csv=ride(3)))
    assert files_of(both) == [["a.rnx", "n.rnx", "imu.csv"], ["ride.csv"]]
    kept = web.client.get(f"/v1/drives/{both['id']}/log").content
    log = read_log(kept)
    assert (log.raw is not None and len(log.raw.signals), len(log.rate)) == (30, 30)
    with zipfile.ZipFile(io.BytesIO(kept)) as archive:
        assert archive.read("a.rnx") == day["a_rnx"]
    again = sent(web, zipped(**{name: gzip.compress(data) for name, data in (day | imu).items()}), 200)
    assert again["id"] == both["id"]


def test_the_sensors_of_a_phone_are_one_drive_without_a_doubt(web: Any) -> None:
    at = round(START.timestamp() * 1e9)
    axes = "time,seconds_elapsed,z,y,x\n" + "".join(f"{at + k * 10**9},{k},9.8,0,0\n" for k in range(20))
    pressure = "time,seconds_elapsed,pressure\n" + "".join(f"{at + k * 10**9},{k},980\n" for k in range(20))
    files = {
        "Location_csv": sensor_logger(),
        "LocationGps_csv": sensor_logger().replace(b",158", b",159"),
        "TotalAcceleration_csv": axes.encode(),
        "Barometer_csv": pressure.encode(),
        "Orientation_csv": b"time,seconds_elapsed,yaw,qx\n%d,0.0,1,0\n" % at,
    }
    document = sent(web, zipped(**files))
    assert len(document["drives"]) == 1
    assert document["drives"][0]["unclear"] == document["left_out"] == []


def test_what_is_unclear_is_said_and_decided_by_who_sent_it(web: Any) -> None:
    parts = {"a_csv": ride(0, 60), "b_csv": ride(0, 60, 61, 49.006), "other_csv": ride(5)}
    document = sent(web, zipped(**parts))
    assert files_of(document) == [["a.csv", "b.csv"], ["other.csv"]]
    assert document["drives"][0]["unclear"] == [{"files": ["a.csv", "b.csv"], "why": "continues"}]
    apart = sent(web, zipped(**parts), grouping="apart")
    assert files_of(apart) == [["a.csv"], ["b.csv"], ["other.csv"]]
    assert [drive["known"] for drive in apart["drives"]] == [False, False, True]
    one = sent(web, zipped(**parts), grouping="one")
    assert files_of(one) == [["a.csv", "b.csv", "other.csv"]]
    device = {"bike_csv": ride(9, 60), "phone_csv": ride(9, 50, lat=49.0001)}
    assert sent(web, zipped(**device))["drives"][0]["unclear"][0]["why"] == "overlaps"
    refused = web.client.post("/v1/drives?grouping=some", content=ride(0))
    assert refused.status_code == 422


def test_a_worker_says_where_one_drive_looks_like_several(files: Path) -> None:
    first = (files / "1.csv").read_bytes()
    header, *rows = first.decode().splitlines()
    later = "\n".join(
        [header, *(f"{float(row.split(',', 1)[0]) + DAY_S},{row.split(',', 1)[1]}" for row in rows)]
    )
    log = read_log(zipped(a_csv=first, b_csv=later.encode()))
    assert any("look like 2, which begin with a.csv, b.csv" in warning for warning in log.warnings)
    assert not any("look like" in warning for warning in read_log(zipped(a_csv=first)).warnings)


def test_each_drive_of_a_zip_is_computed_by_itself(web: Any) -> None:
    document = sent(web, zipped(**RIDES))
    for drive in document["drives"][:2]:
        assert process_drive(web.context, uuid.UUID(drive["id"]), 1) is Outcome.FAILED
        assert web.client.get(f"/v1/drives/{drive['id']}").json()["failure"]["kind"] == "no-roads"


def test_a_quota_leaves_out_what_it_has_no_room_for(web: Any) -> None:
    with web.sessions.begin() as session:
        session.execute(text("UPDATE owners SET quota_drives = 2"))
    document = sent(web, zipped(**RIDES))
    assert len(document["drives"]) == 2
    assert [(one["file"], one["kind"]) for one in document["left_out"]] == [
        (name.replace("_", "."), "quota") for name in list(RIDES)[2:]
    ]
    assert len(web.blobs.keys()) == 2
    assert web.client.post("/v1/drives", content=zipped(x_csv=ride(70), y_csv=ride(80))).status_code == 429
    assert len(web.blobs.keys()) == 2


def test_more_files_than_are_taken_are_refused_with_what_to_do(web: Any) -> None:
    many = zipped(**{f"r{k}_csv": ride(k, 3) for k in range(MAX_FILES + 1)})
    answer = web.client.post("/v1/drives", content=many)
    assert answer.status_code == 413
    assert "Send fewer at a time" in answer.json()["detail"]
    assert web.blobs.keys() == []
