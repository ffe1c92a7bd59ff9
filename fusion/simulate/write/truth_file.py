"""The true slopes as the CSV that ``roadtruth.py score`` reads."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fusion.simulate.drive import SimulatedDrive
from fusion.simulate.scene.town import Town

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
        for drive in drives:
            for p in drive.passes():
                if p.driven_m >= LEAST_DRIVEN_M:
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
