"""What a manifest says of the files of archives: zips in zips, lists of sports, files that cannot be read."""

from __future__ import annotations

import gzip
import io
import tracemalloc
import zipfile
from datetime import timedelta
from pathlib import Path

import pytest

from fusion.errors import MalformedLogError
from fusion.formats.archives import files as walking
from fusion.formats.archives.files import MOST_DEPTH
from fusion.formats.archives.look import Kind, Looked, Looker, ends_of, told_by
from fusion.formats.archives.manifest import Manifest, manifest_of
from fusion.formats.archives.sheets import is_list, sports_of
from fusion.formats.glance import Ends
from garmin_files import tcx, track
from log_samples import sensor_logger
from ride_archive import FIRST, csv_ride, fit_ride, gpx_ride, tcx_ride, zipped


def manifest(tmp_path: Path, files: dict[str, bytes], looker: Looker | None = None) -> Manifest:
    path = tmp_path / "archive.zip"
    path.write_bytes(zipped(files))
    return manifest_of(path, looker or Looker())


def by_name(found: Manifest) -> dict[str, Looked]:
    return {one.name: one for one in found.files}


def test_zips_in_zips_are_opened_to_a_depth(tmp_path: Path) -> None:
    data = csv_ride(FIRST)
    for depth in range(MOST_DEPTH):
        data = zipped({f"{depth}.zip" if depth else "ride.csv": data})
    found = manifest(tmp_path, {"d.zip": data, "e.csv": csv_ride(FIRST + timedelta(days=1))})
    (deep, flat) = found.files
    assert (deep.kind, flat.kind) == (Kind.BROKEN, Kind.DRIVE)
    assert "more than 3 zips deep" in deep.reason
    shallow = manifest(tmp_path, {"a.zip": zipped({"b.zip": zipped({"ride.csv": csv_ride(FIRST)})})})
    assert [(one.name, one.kind) for one in shallow.files] == [("a.zip/b.zip/ride.csv", Kind.DRIVE)]


def test_files_of_one_folder_may_be_one_drive_and_of_two_are_not(tmp_path: Path) -> None:
    found = manifest(
        tmp_path, {"a/x.csv": csv_ride(FIRST), "b/x.gpx": gpx_ride(FIRST), "phone.zip": sensor_logger()}
    )
    assert len(found.drives) == 3
    together = manifest(tmp_path, {"a/x.csv": csv_ride(FIRST), "a/x.gpx": gpx_ride(FIRST)})
    assert together.drives == ((0, 1),)
    assert [one.files for one in together.unclear] == [(0, 1)]


def test_the_list_of_an_export_says_of_which_sport_files_are(tmp_path: Path) -> None:
    rows = "id,date,name,type,x,Filename\n1,d,Bike to swim,Swim,,activities/1.gpx\n2,d,n,Ride,,activities/2.gpx\n"
    files = {
        "e/activities/1.gpx": gpx_ride(FIRST, "cycling"),
        "e/activities/2.gpx": gpx_ride(FIRST + timedelta(days=1), "running"),
        "e/activities.csv": rows.encode(),
    }
    found = by_name(manifest(tmp_path, files))
    assert found["e/activities/1.gpx"].kind is Kind.NOT_ON_ROADS
    assert (found["e/activities/2.gpx"].kind, found["e/activities/2.gpx"].sport) == (Kind.DRIVE, "cycling")
    assert found["e/activities.csv"].kind is Kind.NOT_A_LOG


def test_the_columns_of_a_list_are_known_by_what_is_in_them() -> None:
    moved = b"name;sort;file;a;b;c;d;e;f;g;h;i\nAbend;Lauf;activities/7.fit.gz;;;;;;;;;\n"
    assert is_list(moved)
    assert sports_of(moved) == {"activities/7.fit.gz": "Lauf"}
    assert sports_of(b"a,b\nactivities/7.fit,nothing known\n") == {}
    assert not is_list(b"<gpx>\nactivities/7.gpx")


def test_what_a_file_says_of_itself() -> None:
    def told(data: bytes) -> tuple[str, float]:
        said = told_by(Ends.of(data))
        return said.sport, round(said.distance_m)

    assert told(gpx_ride(FIRST, "Ride")) == ("Ride", 73)
    assert told(fit_ride(FIRST)) == ("cycling", 123)
    assert told_by(Ends.of(tcx_ride(FIRST))).sport == "Biking"
    lap = tcx([[track(0, 3)]]).replace(b"<Lap>", b"<Lap><DistanceMeters>250.5</DistanceMeters>")
    assert told_by(Ends.of(lap)).distance_m == 250.5
    assert told_by(Ends.of(b"hello")).sport == ""


def test_files_that_cannot_be_read_are_told(tmp_path: Path) -> None:
    secret = io.BytesIO()
    with zipfile.ZipFile(secret, "w") as archive:
        archive.writestr("secret.csv", csv_ride(FIRST))
    locked = bytearray(secret.getvalue())
    locked[locked.index(b"PK\x01\x02") + 8] |= 1  # as if it had a password
    damaged = bytearray(zipped({"x.csv": csv_ride(FIRST) * 3}))
    damaged[60:90] = bytes(30)
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "locked.zip").write_bytes(locked)
    (folder / "damaged.zip").write_bytes(damaged)
    (folder / "no.zip").write_bytes(b"PK\x03\x04")
    (folder / "cut.csv.gz").write_bytes(gzip.compress(csv_ride(FIRST))[:40])
    (folder / ".hidden").write_bytes(csv_ride(FIRST))
    found = by_name(manifest_of(folder, Looker()))
    assert sorted(found) == ["cut.csv.gz", "damaged.zip/x.csv", "locked.zip/secret.csv", "no.zip"]
    assert all(one.kind is not Kind.DRIVE and one.reason for one in found.values())


def test_a_file_that_is_too_large_and_a_bomb_are_read_up_to_a_bound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = manifest(tmp_path, {"a.csv": csv_ride(FIRST) + bytes(1 << 21)}, Looker(max_bytes=1 << 20))
    assert found.files[0].kind is Kind.TOO_LARGE
    bomb = gzip.compress(bytes(200 << 20))
    tracemalloc.start()
    ends, _ = ends_of(io.BufferedReader(io.BytesIO(bomb)), 1 << 40, len(bomb))  # type: ignore[arg-type]
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert ends.size <= 65 << 20
    assert peak < 32 << 20
    monkeypatch.setattr(walking, "MOST_NESTED_BYTES", 1000)
    nested = manifest(tmp_path, {"large.zip": zipped({f"{k}.csv": csv_ride(FIRST) for k in range(9)})})
    assert (nested.files[0].name, nested.files[0].kind) == ("large.zip", Kind.BROKEN)
    monkeypatch.setattr(walking, "MOST_FILES", 3)
    with pytest.raises(MalformedLogError):
        manifest(tmp_path, {f"{k}.txt": b"x" for k in range(4)})


def test_a_name_that_a_zip_holds_twice_is_two_files(tmp_path: Path) -> None:
    path = tmp_path / "twice.zip"
    with zipfile.ZipFile(path, "w") as archive, pytest.warns(UserWarning, match="Duplicate name"):
        for day in range(2):
            archive.writestr("ride.csv", csv_ride(FIRST + timedelta(days=day)))
    found = manifest_of(path, Looker())
    assert [one.name for one in found.files] == ["ride.csv", "ride.csv (2)"]
    assert len({one.content for one in found.files}) == len(found.drives) == 2
