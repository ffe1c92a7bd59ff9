"""A drive as a Versant CSV, read back: the design's columns, empty cells where nothing was measured."""

from __future__ import annotations

import csv
import gzip
from pathlib import Path

import numpy as np

from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import csv_columns, write_csv

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


def rows_of(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text().splitlines()))


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
