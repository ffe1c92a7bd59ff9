"""The files that a simulation writes, read back by what reads them in earnest."""

from __future__ import annotations

import csv
import gzip
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import osmium
import pytest
import rasterio

from fusion.formats import read_log
from fusion.roads.osm import read_roads
from fusion.simulate.bundle import Bundle, demo_drives, write_all
from fusion.simulate.drive import simulate_drive
from fusion.simulate.motion.routes import structures
from fusion.simulate.scene.town import Town, make_town
from fusion.simulate.write import dem_file
from fusion.simulate.write.csv_file import csv_columns, write_csv
from fusion.simulate.write.dem_file import ERROR_LENGTH_M, ERROR_SIGMA_M, dem_heights, write_dem
from fusion.simulate.write.osm_file import write_osm
from fusion.simulate.write.truth_file import write_truth

COLUMNS = {
    "time_s",
    "time",
    "lat_deg",
    "lon_deg",
    "alt_msl_m",
    "height_ell_m",
    "h_acc_m",
    "v_acc_m",
    "vel_n_mps",
    "vel_e_mps",
    "vel_d_mps",
    "s_acc_mps",
    "speed_mps",
    "heading_deg",
    "acc_x_mps2",
    "acc_y_mps2",
    "acc_z_mps2",
    "gyr_x_dps",
    "gyr_y_dps",
    "gyr_z_dps",
    "roll_deg",
    "pitch_deg",
    "yaw_deg",
    "pitch_acc_deg",
    "wheel_left_rad",
    "wheel_right_rad",
    "odo_speed_mps",
    "pressure_hpa",
}
"""The columns of the Versant CSV, from the design."""


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    return write_all(tmp_path_factory.mktemp("bundle"), drives=6, seed=3, duration_s=240.0)


def rows_of(path: Path) -> list[dict[str, str]]:
    data = path.read_bytes()
    text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode()
    return list(csv.DictReader(text.splitlines()))


@pytest.mark.parametrize("seed", (1, 2, 3))
def test_the_map_reads_back_as_the_same_roads(tmp_path: Path, seed: int) -> None:
    town = make_town(seed)
    write_osm(town, tmp_path / "town.osm")
    roads = read_roads(tmp_path / "town.osm")
    for column in roads.columns():
        np.testing.assert_array_equal(getattr(roads, column), getattr(town.roads, column), err_msg=column)
    assert not roads.skipped


def test_the_map_holds_what_readers_must_pass_over(bundle: Bundle) -> None:
    tags = [dict(w.tags) for w in osmium.FileProcessor(str(bundle.osm), osmium.osm.WAY)]
    assert sum(t.get("highway") == "footway" for t in tags) >= 3
    assert sum("building" in t for t in tags) >= 20
    assert sum(t.get("junction") == "roundabout" and "oneway" not in t for t in tags) == 3
    motorways = [t for t in tags if t.get("highway") == "motorway"]
    assert 0 < sum("oneway" in t for t in motorways) < len(motorways)
    assert any(t.get("oneway") == "-1" for t in tags)
    assert any(t.get("tunnel") == "yes" and t["layer"] == "-1" for t in tags)


def test_every_node_of_a_way_is_in_the_file(bundle: Bundle) -> None:
    root = ET.parse(bundle.osm).getroot()  # noqa: S314  (our own file)
    nodes = [n.get("id") for n in root.iter("node")]
    assert len(nodes) == len(set(nodes))
    assert {nd.get("ref") for nd in root.iter("nd")} <= set(nodes)


def test_the_elevation_raster_is_the_ground_with_its_errors(bundle: Bundle) -> None:
    town = bundle.town
    with rasterio.open(bundle.dem) as source:
        assert source.crs.is_geographic
        assert "EGM96" in source.crs.to_wkt()
        assert source.res == pytest.approx((1 / 3600, 1 / 3600))
        z = source.read(1, masked=True)
        west, south, east, north = source.bounds
        top_left = source.xy(0, 0)
    assert west < town.node_lon_deg.min() - 0.002
    assert east > town.node_lon_deg.max() + 0.002
    assert south < town.node_lat_deg.min() - 0.002
    assert north > town.node_lat_deg.max() + 0.002
    assert 0.0005 < np.mean(z.mask) < 0.05
    expected, left, top = dem_heights(town)
    assert top_left == pytest.approx((left + 0.5 / 3600, top - 0.5 / 3600))
    np.testing.assert_array_equal(np.isnan(expected), z.mask)
    assert np.nanmax(np.abs(expected - z.filled(0))[~z.mask]) <= 0.5


def test_posts_without_error_are_the_ground(
    tmp_path: Path, town: Town, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dem_file, "ERROR_SIGMA_M", 0.0)
    write_dem(town, tmp_path / "dem.tif")
    with rasterio.open(tmp_path / "dem.tif") as source:
        z = source.read(1, masked=True).astype(float).filled(np.nan)
        rows, columns = np.indices(z.shape)
        lon, lat = source.xy(rows.ravel(), columns.ravel())
    ground = town.height(*town.projection.to_xy(lon, lat)).reshape(z.shape)
    assert np.nanmax(np.abs(z - ground)) <= 0.5 + 1e-6


def test_elevation_errors_are_correlated() -> None:
    squares, products, n = 0.0, np.zeros(2), 0
    for seed in range(20, 26):
        town = make_town(seed)
        z, west, north = dem_heights(town)
        lon = west + (np.arange(z.shape[1]) + 0.5) / 3600
        lat = north - (np.arange(z.shape[0]) + 0.5) / 3600
        error = z - town.height(*town.projection.to_xy(*np.meshgrid(lon, lat)))
        squares += float(np.nanmean(error**2))
        steps = (1, round(ERROR_LENGTH_M / 30.9))
        products += [np.nanmean(error[k:] * error[:-k]) for k in steps]
        n += 1
    assert np.sqrt(squares / n) == pytest.approx(ERROR_SIGMA_M, rel=0.2)
    near, at_length = products / squares
    assert near > 0.85
    assert at_length == pytest.approx(np.exp(-1), abs=0.15)


def test_csv_has_columns_of_the_design_and_empty_cells_without_gnss(tmp_path: Path, town: Town) -> None:
    drive = simulate_drive(town, 5, 100.0, outages=[(30.0, 10.0)])
    write_csv(drive, tmp_path / "drive.csv")
    rows = rows_of(tmp_path / "drive.csv")
    assert set(rows[0]) <= COLUMNS
    assert {"time_s", "lat_deg", "lon_deg", "alt_msl_m", "vel_d_mps", "acc_x_mps2", "pitch_deg"} <= set(
        rows[0]
    )
    assert len(rows) == len(drive.elapsed_s)
    for row, has in zip(rows, drive.has_gnss, strict=True):
        gnss = [row[c] for c in ("lat_deg", "lon_deg", "alt_msl_m", "vel_n_mps", "vel_d_mps", "h_acc_m")]
        assert all(gnss) if has else not any(gnss)
        assert all(row[c] for c in ("time_s", "acc_x_mps2", "gyr_z_dps", "pitch_deg", "odo_speed_mps"))
    heights = [float(r["alt_msl_m"] or "nan") for r in rows]
    np.testing.assert_allclose(heights, csv_columns(drive)["alt_msl_m"], atol=1e-4)


def test_a_gzipped_csv_holds_the_same(tmp_path: Path, town: Town) -> None:
    drive = simulate_drive(town, 5, 30.0)
    for name in ("a.csv", "b.csv.gz", "c.csv.gz"):
        write_csv(drive, tmp_path / name)
    packed = (tmp_path / "b.csv.gz").read_bytes()
    assert gzip.decompress(packed) == (tmp_path / "a.csv").read_bytes()
    assert packed == (tmp_path / "c.csv.gz").read_bytes()


def test_truth_of_the_whole_town(tmp_path: Path, town: Town) -> None:
    write_truth(town, tmp_path / "truth.csv")
    rows = rows_of(tmp_path / "truth.csv")
    assert list(rows[0]) == [
        "osm_way_id",
        "from_node",
        "to_node",
        "slope_percent",
        "driven_m",
        "length_m",
        "passes",
    ]
    assert [int(r["osm_way_id"]) for r in rows] == list(town.roads.osm_way_id)
    slopes = [float(r["slope_percent"]) for r in rows]
    np.testing.assert_allclose(slopes, town.true_slope_percent, atol=6e-4)
    assert all(r["passes"] == "1" and r["driven_m"] == r["length_m"] for r in rows)


def test_truth_of_drives_is_what_they_covered(bundle: Bundle) -> None:
    rows = rows_of(bundle.truth)
    roads = bundle.town.roads
    listed = {(int(r["osm_way_id"]), int(r["from_node"]), int(r["to_node"])): int(r["passes"]) for r in rows}
    long = [p.segment for d in bundle.simulated for p in d.passes() if p.driven_m >= 10]
    counts = np.bincount(long, minlength=len(roads))
    for k in range(len(roads)):
        key = (int(roads.osm_way_id[k]), int(roads.from_node[k]), int(roads.to_node[k]))
        assert listed.get(key, 0) == counts[k]
    assert 0 < len(rows) < len(roads)


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


def test_every_drive_of_a_bundle_is_read_back(bundle: Bundle) -> None:
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
    assert len(rows_of(made.truth)) == len(made.town.roads)


def test_a_bundle_comes_from_its_seed(tmp_path: Path) -> None:
    a, b = (write_all(tmp_path / name, 4, 7, duration_s=40.0) for name in "ab")
    for first, second in zip(
        (a.osm, a.dem, a.truth, *a.drives), (b.osm, b.dem, b.truth, *b.drives), strict=True
    ):
        assert first.read_bytes() == second.read_bytes()
