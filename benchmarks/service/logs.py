"""Logs to upload: drives of ten kilometres over a real map, as an ordinary receiver records them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from accuracy.logs import Columns, write_columns
from accuracy.scoring import show_progress
from fusion.roads.osm import read_roads
from fusion.types import DriveLog
from profile_speed import record

LENGTH_M = 10_000.0
HOURS = 0.5
"""Recorded, of which the first 10 km are kept."""
APART_S = 7200.0
"""Between the beginnings of two drives."""


def make_logs(roads: Path, count: int, folder: Path) -> list[bytes]:
    """Versant CSVs of drives over the roads."""
    table = read_roads(roads)
    logs = []
    for seed in range(count):
        show_progress(f"log {seed + 1} of {count}")
        log = record(table, HOURS, seed)[0]
        path = write_columns(columns_of(log, seed * APART_S), folder / "log.csv")
        logs.append(path.read_bytes())
    return logs


def columns_of(log: DriveLog, later_s: float, length_m: float = LENGTH_M) -> Columns:
    """The first ``length_m`` of a log as columns, so much later."""
    speed = np.hypot(log.velocity.vel_n_mps, log.velocity.vel_e_mps)
    keep = np.cumsum(speed) <= length_m
    columns = {
        "time_s": log.fix.time_s + later_s,
        "lat_deg": log.fix.lat_deg,
        "lon_deg": log.fix.lon_deg,
        "alt_msl_m": log.fix.alt_msl_m,
        "h_acc_m": log.fix.h_acc_m,
        "v_acc_m": log.fix.v_acc_m,
        "vel_n_mps": log.velocity.vel_n_mps,
        "vel_e_mps": log.velocity.vel_e_mps,
        "vel_d_mps": log.velocity.vel_d_mps,
        "s_acc_mps": log.velocity.s_acc_mps,
        "acc_x_mps2": log.force.acc_x_mps2,
        "acc_z_mps2": log.force.acc_z_mps2,
        "pitch_deg": np.degrees(log.attitude.pitch_rad),
    }
    return {name: values[keep] for name, values in columns.items()}
