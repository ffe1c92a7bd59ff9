"""A whole demonstration on disk: map, elevations, drives in several formats, truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.motion.routes import structures
from fusion.simulate.scene.town import Town, make_town
from fusion.simulate.write.csv_file import write_csv, write_truth
from fusion.simulate.write.dem_file import write_dem
from fusion.simulate.write.osm_file import write_osm
from fusion.simulate.write.ubx_file import write_ubx
from fusion.types import Progress, no_progress

_MIX = (
    ("m8", "csv"),
    ("m8", "ubx"),
    ("f9p", "csv"),
    ("phone", "csv.gz"),
    ("f9p", "ubx"),
    ("phone", "ubx"),
)
"""Receiver and file suffix of the first, second, ... drive; then from the beginning."""


class NamedDrive(NamedTuple):
    """A drive and the file it is to become."""

    filename: str
    drive: SimulatedDrive

    def write(self, folder: Path) -> Path:
        """Write the file in the format of its suffix and return its path."""
        path = Path(folder) / self.filename
        if path.suffix == ".ubx":
            write_ubx(self.drive, path)
        else:
            write_csv(self.drive, path)
        return path


@dataclass(frozen=True)
class Demonstration:
    """The files of a demonstration. ``town`` and ``simulated`` hold what they were made from."""

    osm: Path
    dem: Path
    truth: Path
    drives: tuple[Path, ...]
    town: Town
    simulated: tuple[SimulatedDrive, ...]


def demo_drives(
    town: Town,
    count: int,
    seed: int = 1,
    *,
    duration_s: float = 600.0,
    rate_hz: float = 1.0,
    receiver: str | None = None,
) -> Iterator[NamedDrive]:
    """Yield ``count`` drives that together cover as much of the town as they can, in mixed receivers and
    formats; with a ``receiver``, each for itself, of that one and as CSV.

    The first ones take the motorway, the ramps, the bridges and the tunnel; six drives of 600 s pass most of
    the town, further ones pass it again. Each has its own start time, an hour and a half after the one
    before.
    """
    mix = _MIX if receiver is None else ((receiver, "csv"),)
    visits = np.zeros(len(town.roads), np.int64) if receiver is None else None
    for k in range(count):
        used, suffix = mix[k % len(mix)]
        drive = simulate_drive(
            town,
            1000 * seed + k,
            duration_s,
            rate_hz=rate_hz,
            receiver=used,
            visits=visits,
            first=structures(town),
        )
        yield NamedDrive(f"drive_{k + 1:02d}.{suffix}", drive)


def write_all(
    folder: Path,
    drives: int = 6,
    seed: int = 1,
    *,
    duration_s: float = 600.0,
    rate_hz: float = 1.0,
    receiver: str | None = None,
    progress: Progress = no_progress,
) -> Demonstration:
    """Make the town of ``seed`` and write town.osm, dem.tif, drive_01.csv ... and truth.csv into ``folder``.

    ``receiver`` as in ``demo_drives``. The folder is created where it is missing and files in it are overwritten.
    ``truth.csv`` holds the segments that the drives cover, or the whole town without drives. Raises ``OSError``
    where the folder cannot be written.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    progress("town", 0.0)
    town = make_town(seed)
    write_osm(town, folder / "town.osm")
    write_dem(town, folder / "dem.tif")
    paths: list[Path] = []
    simulated: list[SimulatedDrive] = []
    for named in demo_drives(town, drives, seed, duration_s=duration_s, rate_hz=rate_hz, receiver=receiver):
        progress("drives", len(paths) / max(drives, 1))
        paths.append(named.write(folder))
        simulated.append(named.drive)
    progress("truth", 1.0)
    write_truth(town, folder / "truth.csv", simulated or None)
    return Demonstration(
        folder / "town.osm", folder / "dem.tif", folder / "truth.csv", tuple(paths), town, tuple(simulated)
    )
