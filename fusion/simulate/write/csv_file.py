"""A drive as the Versant CSV that a recording app would write, and true slopes as the CSV that ``roadtruth.py`` reads.

One row per GNSS epoch, all sensors beside it.
"""

from __future__ import annotations

import csv
import gzip
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fusion.simulate.drive import SimulatedDrive
from fusion.simulate.scene.town import Town
from fusion.types import Floats

_POSITION_COLUMNS = ("lat_deg", "lon_deg", "alt_msl_m", "h_acc_m", "v_acc_m")
_VELOCITY_COLUMNS = ("vel_n_mps", "vel_e_mps", "vel_d_mps", "s_acc_mps")
_DIGITS = {"time_s": 3, "lat_deg": 8, "lon_deg": 8}
_OTHER_DIGITS = 4
"""Digits after the decimal point; 1e-8 degree is about a millimetre."""


def write_csv(drive: SimulatedDrive, path: Path) -> None:
    """Write a Versant CSV, gzipped if the name ends in ``.gz``."""
    table = csv_columns(drive)
    cells = [[_cell(v, _DIGITS.get(name, _OTHER_DIGITS)) for v in values] for name, values in table.items()]
    text = io.StringIO(newline="")
    out = csv.writer(text)
    out.writerow(table)
    out.writerows(zip(*cells, strict=True))
    data = text.getvalue().encode("ascii")
    Path(path).write_bytes(gzip.compress(data, mtime=0) if str(path).endswith(".gz") else data)


def _cell(value: float, digits: int) -> str:
    return "" if np.isnan(value) else f"{value:.{digits}f}"


def csv_columns(drive: SimulatedDrive) -> dict[str, Floats]:
    """The columns of the Versant CSV, NaN where nothing was measured."""
    lon, lat = drive.lonlat()
    n, p, imu = len(lon), drive.profile, drive.inertial
    table = {"time_s": drive.time_s}
    position = (lat, lon, drive.gnss.alt_msl_m, np.full(n, p.h_acc_m), np.full(n, p.v_acc_m))
    velocity = (*drive.gnss.velocity_ned_mps.T, np.full(n, p.s_acc_mps))
    table |= zip(_POSITION_COLUMNS + _VELOCITY_COLUMNS, position + velocity, strict=True)
    table |= zip((f"acc_{axis}_mps2" for axis in "xyz"), imu.force_mps2.T, strict=True)
    table |= zip((f"gyr_{axis}_dps" for axis in "xyz"), np.degrees(imu.rate_radps).T, strict=True)
    table |= {
        "roll_deg": np.degrees(imu.roll_rad),
        "pitch_deg": np.degrees(imu.pitch_rad),
        "yaw_deg": np.degrees(imu.yaw_rad) % 360.0,
        "pitch_acc_deg": np.full(n, p.pitch_acc_deg),
        "odo_speed_mps": imu.odo_speed_mps,
    }
    if drive.wheels is not None:
        table["wheel_left_rad"] = drive.wheels.left_rad
        table["wheel_right_rad"] = drive.wheels.right_rad
    for name in _POSITION_COLUMNS + _VELOCITY_COLUMNS:
        table[name] = np.where(drive.has_gnss, table[name], np.nan)
    return table


COLUMNS = ("osm_way_id", "from_node", "to_node", "slope_percent", "driven_m", "length_m", "passes")
LEAST_DRIVEN_M = 10.0
"""A shorter passage over a segment, at the end of a drive, measures nothing of it."""


def write_truth(town: Town, path: Path, drives: Sequence[SimulatedDrive] | None = None) -> None:
    """Write every segment (one pass over all of it), or those that ``drives`` cover over at least 10 m.

    The slope is always that of the whole segment, even where a drive begins or ends inside it.
    """
    passes = np.ones(len(town.roads), np.int64)
    driven = town.length_m
    if drives is not None:
        passes = np.zeros(len(town.roads), np.int64)
        driven = np.zeros(len(town.roads))
        for p in (p for drive in drives for p in drive.passes() if p.driven_m >= LEAST_DRIVEN_M):
            passes[p.segment] += 1
            driven[p.segment] = max(driven[p.segment], p.driven_m)
    roads = town.roads
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(COLUMNS)
        for k in np.flatnonzero(passes):
            ids = (int(roads.osm_way_id[k]), int(roads.from_node[k]), int(roads.to_node[k]))
            figures = (f"{town.true_slope_percent[k]:.3f}", f"{driven[k]:.1f}", f"{town.length_m[k]:.1f}")
            out.writerow([*ids, *figures, int(passes[k])])
