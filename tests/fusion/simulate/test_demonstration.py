"""A whole demonstration: complete, of its seed, and read back by what reads it in earnest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fusion.formats import read_log
from fusion.simulate.demonstration import Demonstration, demo_drives, write_all
from fusion.simulate.motion.routes import structures
from fusion.simulate.scene.town import make_town
from fusion.simulate.write.csv_file import csv_columns


def test_a_bundle_is_complete_and_reports_progress(tmp_path: Path) -> None:
    said: list[tuple[str, float]] = []
    made = write_all(
        tmp_path / "new" / "folder", 3, 1, duration_s=30.0, progress=lambda *args: said.append(args)
    )
    assert [p.name for p in made.drives] == ["drive_01.csv", "drive_02.ubx", "drive_03.csv"]
    assert all(p.stat().st_size > 1000 for p in (made.osm, made.dem, *made.drives))
    shares = [share for stage, share in said if stage == "drives"]
    assert shares == sorted(shares)
    assert said[-1][1] == 1.0
    starts = [d.start_time_s for d in made.simulated]
    assert len(set(starts)) == 3


def test_every_drive_of_a_bundle_is_read_back(bundle: Demonstration) -> None:
    assert {p.suffix for p in bundle.drives} == {".csv", ".ubx", ".gz"}
    assert {d.receiver for d in bundle.simulated} == {"m8", "phone", "f9p"}
    for path, drive in zip(bundle.drives, bundle.simulated, strict=True):
        log = read_log(path)
        has = drive.has_gnss
        np.testing.assert_allclose(log.fix.time_s, drive.time_s[has], atol=1e-3)
        np.testing.assert_allclose(log.fix.lat_deg, csv_columns(drive)["lat_deg"][has], atol=1e-7)
        np.testing.assert_allclose(log.fix.alt_msl_m, drive.gnss.alt_msl_m[has], atol=1e-3)
        assert len(log.force) >= len(drive.elapsed_s)
        assert np.median(log.force.acc_z_mps2) == pytest.approx(9.8, abs=0.7)


@pytest.mark.slow
@pytest.mark.parametrize("seed", (1, 2, 3))
def test_demonstration_drives_show_everything(seed: int) -> None:
    town = make_town(seed)
    driven = np.zeros(len(town.roads), bool)
    for k, named in enumerate(demo_drives(town, 6, seed)):
        driven[[p.segment for p in named.drive.passes()]] = True
        if k == 2:
            assert np.mean(driven[structures(town)]) > 0.9
            assert np.all(driven[town.roads.tunnel])
    assert np.mean(driven) > 0.7


def test_a_bundle_without_drives_has_the_truth_of_the_town(tmp_path: Path) -> None:
    made = write_all(tmp_path, 0, 1)
    assert made.drives == ()
    assert len(made.truth.read_text().splitlines()) - 1 == len(made.town.roads)


def test_a_bundle_comes_from_its_seed(tmp_path: Path) -> None:
    a, b = (write_all(tmp_path / name, 4, 7, duration_s=40.0) for name in "ab")
    for first, second in zip(
        (a.osm, a.dem, a.truth, *a.drives), (b.osm, b.dem, b.truth, *b.drives), strict=True
    ):
        assert first.read_bytes() == second.read_bytes()
