"""Precise orbits and clocks of satellites, as analysis centres publish them: SP3 and RINEX clock files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fusion.signals import GPS_EPOCH_S, SYSTEMS
from fusion.types import Floats, Ints


@dataclass(frozen=True)
class Precise:
    """Precise places (k, 3) in m and clocks (k,) in s of satellites at GPS seconds (k,)."""

    gps_s: Floats
    system: Ints
    number: Ints
    position_m: Floats
    clock_s: Floats


def read_sp3(path: Path) -> Precise:
    """Places and clocks of an SP3 file whose times are GPS time; unknown clocks (999999) are NaN."""
    rows: list[tuple[float, ...]] = []
    now = np.nan
    for line in path.read_text().splitlines():
        if line.startswith("*"):
            year, month, day, hour, minute = (int(word) for word in line[1:].split()[:5])
            stamp = np.datetime64(f"{year:04d}-{month:02d}-{day:02d}T{hour:02d}:{minute:02d}:00")
            now = float(stamp.astype("datetime64[s]").astype(np.int64)) - GPS_EPOCH_S
        elif line.startswith("P"):
            x, y, z, clock = (float(line[4 + 14 * k : 18 + 14 * k]) for k in range(4))
            clock_s = np.nan if clock > 999_999 else 1e-6 * clock
            rows.append((now, SYSTEMS.index(line[1]), int(line[2:4]), 1e3 * x, 1e3 * y, 1e3 * z, clock_s))
    table = np.array(rows)
    return Precise(
        table[:, 0], table[:, 1].astype(np.int64), table[:, 2].astype(np.int64), table[:, 3:6], table[:, 6]
    )


def read_clk(path: Path) -> dict[tuple[int, int, float], float]:
    """Clocks (s) of satellites in a RINEX clock file by system, number and GPS seconds."""
    clocks: dict[tuple[int, int, float], float] = {}
    for line in path.read_text().splitlines():
        if line.startswith("AS "):
            words = line.split()
            year, month, day, hour, minute = (int(word) for word in words[2:7])
            stamp = np.datetime64(f"{year:04d}-{month:02d}-{day:02d}T{hour:02d}:{minute:02d}:00")
            gps_s = float(stamp.astype("datetime64[s]").astype(np.int64)) - GPS_EPOCH_S + float(words[7])
            clocks[SYSTEMS.index(words[1][0]), int(words[1][1:]), gps_s] = float(words[9])
    return clocks
