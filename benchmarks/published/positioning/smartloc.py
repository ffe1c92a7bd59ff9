"""smartLoc (TU Chemnitz, CC BY-SA 4.0) as measurements, aids and truth, and as files of the project's own formats.

``Input.txt`` has lines ``pseudorange3`` (free of satellite clock and atmosphere; satellites where they were at
transmission, in the frame of that moment) and ``odom3`` (speed, turn rates; x forward, y left, z up), ``GT.txt`` the
true ECEF places, all at the same epochs.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from fusion.gnss.earth import EARTH_RATE_RADPS, elevation_azimuth
from fusion.gnss.measurements import Aids, Measurements
from fusion.signals import GLONASS, GPS, LIGHT_MPS, satellite_name
from fusion.types import Floats
from published.positioning.scoring import Scene

STEM = "smartLoc__Berlin_Potsdamer_Platz"
BEGAN_UNIX_S = 1_400_000_000.0
"""The log's time begins at 0 and says nothing of the date; any will do."""
_SYSTEMS = {1: (GPS, 0), 4: (GLONASS, 300)}
"""Number of the system in the file -> ours, and what its satellites' numbers are raised by."""


def read(folder: Path) -> Scene:
    """The Potsdamer Platz drive from a folder that has its two text files."""
    ranges, odometry = _lines(folder)
    truth = np.loadtxt(folder / f"{STEM}_GT.txt", usecols=(1, 2, 3, 4))
    times, first = np.unique(ranges[:, 0], return_index=True)
    first = np.append(first, len(ranges)).astype(np.int64)
    if not (np.array_equal(times, odometry[:, 0]) and np.array_equal(times, truth[:, 0])):
        raise ValueError(f"{folder}: ranges, odometry and truth are not of the same epochs")
    systems, numbers = _identities(ranges)
    keys, satellite = np.unique(np.column_stack([systems, numbers]), axis=0, return_inverse=True)
    kinds, group = np.unique(systems, return_inverse=True)
    rough = _rough(ranges[: first[1]])
    place = turned(ranges[:, 3:6], rough)
    elevation, azimuth = elevation_azimuth(rough, place)
    unknown = np.full(len(ranges), np.nan)
    measured = Measurements(
        time_s=BEGAN_UNIX_S + times,
        first=first,
        satellite=satellite.astype(np.int64),
        group=group.astype(np.int64),
        pseudorange_m=ranges[:, 1],
        range_rate_mps=unknown,
        cn0_dbhz=ranges[:, 9],
        sigma_m=np.sqrt(ranges[:, 2]),
        elevation_rad=elevation,
        azimuth_rad=azimuth,
        satellite_m=place,
        satellite_mps=np.full((len(ranges), 3), np.nan),
        names=tuple(satellite_name(int(system), int(number)) for system, number in keys),
        groups=tuple("GR"[kind] for kind in kinds),
        rough_m=rough,
    )
    return Scene(measured, _aids(odometry), truth[:, 1:4])


def _rough(ranges: Floats) -> Floats:
    """A place near the drive (3,): least squares over one epoch's lines (n, 10), from the earth's centre."""
    place, clock = np.zeros(3), 0.0
    for _ in range(10):
        sight = ranges[:, 3:6] - place
        distance = np.linalg.norm(sight, axis=1)
        rows = np.column_stack([-sight / distance[:, None], np.ones(len(ranges))])
        change = np.linalg.lstsq(rows, ranges[:, 1] - distance - clock, rcond=None)[0]
        place, clock = place + change[:3], clock + change[3]
    return np.asarray(np.round(place, -2))


def turned(satellite_m: Floats, user_m: Floats) -> Floats:
    """Satellites (n, 3) at transmission in the frame of reception: the earth turns while the signal flies (Sagnac)."""
    flight_s = np.linalg.norm(satellite_m - user_m, axis=1) / LIGHT_MPS
    angle = EARTH_RATE_RADPS * flight_s
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, z = satellite_m.T
    return np.column_stack([cos * x + sin * y, cos * y - sin * x, z])


def convert(folder: Path, out: Path) -> tuple[Path, Path]:
    """Write the drive as the project's CSV of pseudoranges and a Versant CSV with odometer and gyroscope."""
    ranges, odometry = _lines(folder)
    out.mkdir(parents=True, exist_ok=True)
    pseudoranges, sensors = out / "smartloc_pseudoranges.csv", out / "smartloc_sensors.csv"
    systems, numbers = _identities(ranges)
    with pseudoranges.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            ["time_s", "system", "satellite", "pseudorange_m", "sat_x_m", "sat_y_m", "sat_z_m", "cn0_dbhz"]
        )
        for row, system, number in zip(ranges, systems, numbers, strict=True):
            time = f"{BEGAN_UNIX_S + row[0]:.3f}"
            places = (f"{value:.4f}" for value in row[3:6])
            writer.writerow([time, "GR"[system], int(number), f"{row[1]:.4f}", *places, f"{row[9]:.0f}"])
    with sensors.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time_s", "odo_speed_mps", "gyr_z_dps"])
        for row in odometry:
            time = f"{BEGAN_UNIX_S + row[0]:.3f}"
            writer.writerow([time, f"{row[1]:.6f}", f"{np.degrees(row[6]):.8f}"])
    return pseudoranges, sensors


def _lines(folder: Path) -> tuple[Floats, Floats]:
    """Lines of ranges (n, 10), by time and satellite, and of odometry (m, 13), without the word they begin with."""
    kinds: dict[str, list[list[float]]] = {"pseudorange3": [], "odom3": []}
    with (folder / f"{STEM}_Input.txt").open() as file:
        for line in file:
            word, *values = line.split()
            kinds[word].append([float(value) for value in values])
    ranges, odometry = np.array(kinds["pseudorange3"]), np.array(kinds["odom3"])
    return ranges[np.lexsort((ranges[:, 6], ranges[:, 7], ranges[:, 0]))], odometry


def _identities(ranges: Floats) -> tuple[Floats, Floats]:
    letters = [_SYSTEMS[int(kind)] for kind in ranges[:, 7]]
    systems, raised = np.array(letters, np.int64).T
    return systems, ranges[:, 6].astype(np.int64) - raised


def _aids(odometry: Floats) -> Aids:
    """Speed with the stated sigma (5 cm/s); the turn rate is seen from above, anticlockwise in the file."""
    nothing = np.full(len(odometry), np.nan)
    return Aids(np.abs(odometry[:, 1]), np.sqrt(odometry[:, 7]), -odometry[:, 6], nothing, nothing)
