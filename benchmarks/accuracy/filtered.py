"""Logs of altitudes that a receiver has low-passed: what they are worth to one drive and to ten, beside the bound.

The bound is of the same altitudes before the low-pass, which takes nothing away that could not be put back.
"""

from __future__ import annotations

from collections.abc import Sequence as Several
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np

from accuracy.bounds import AS_FITTED, RoadBound
from accuracy.poor import RUNGS, poor_log, road_of
from accuracy.scoring import Errors, Row, figures, rms, show_progress
from accuracy.sequences import Sequence, among, fuse, make_log, slopes_of

RECEIVERS = ("m8", "phone")
LOW_PASS_S = (0.0, 1.0, 2.0, 4.0)
MANY = 10
"""Drives in the larger sets."""
SENSORS = ("alt",)
COLUMNS = {
    "log": ("log", ""),
    "receiver": ("receiver", ""),
    "drives": ("drives", "d"),
    "rmse_percent": ("RMSE %", ".3f"),
    "rmse_spread": ("(spread)", ".3f"),
    "coverage": ("cover", ".1%"),
    "within_95": ("in 1.96s", ".1%"),
    "z_rms": ("z-rms", ".2f"),
    "bound_percent": ("bound %", ".3f"),
}


@dataclass(frozen=True, eq=False)
class Drives:
    """Which logs are made on each road, and what with."""

    tool: ModuleType
    bound: ModuleType | None
    folder: Path
    method: str
    seeds: int

    def groups(self) -> dict[int, list[list[int]]]:
        """Seeds by number of drives: single ones, and a set of ten for every five of them, one at least."""
        sets = max(1, self.seeds // 5)
        many = [list(range(MANY * k, MANY * (k + 1))) for k in range(sets)]
        return {1: [[seed] for seed in range(self.seeds)], MANY: many}

    def all_seeds(self) -> list[int]:
        """Every seed of the groups."""
        return sorted({seed for of_size in self.groups().values() for group in of_size for seed in group})

    def errors(self, sequence: Sequence, receiver: str, low_pass_s: float) -> dict[int, list[Errors]]:
        """Errors of one road by number of drives, one for each group; each log is fused once."""
        rung = RUNGS["altitude"]._replace(low_pass_s=low_pass_s)
        logs = {
            seed: poor_log(self.tool, sequence, seed, self.folder, rung, receiver=receiver)
            for seed in self.all_seeds()
        }
        fused = fuse(road_of(sequence, rung), logs.values(), self.method)
        return {
            drives: [
                Errors.of(sequence.truth, slopes_of(among(fused, [logs[seed] for seed in group])))
                for group in of_size
            ]
            for drives, of_size in self.groups().items()
        }

    def bounds(self, road: RoadBound, sequence: Sequence, receiver: str) -> dict[int, list[float]]:
        """The bound's RMSE on one road by number of drives, one for each group."""
        observed = {
            seed: road.drive(
                make_log(self.tool, sequence, seed, self.folder, receiver), receiver, seed, SENSORS
            )
            for seed in self.all_seeds()
        }
        return {
            drives: [rms(road.errors([observed[seed] for seed in group])[AS_FITTED]) for group in of_size]
            for drives, of_size in self.groups().items()
        }


def filtered_rows(drives: Drives, sequences: Several[Sequence]) -> list[Row]:
    """A row for each receiver, number of drives and low-pass: means over the roads and groups."""
    roads = [RoadBound.of(drives.bound, s) for s in sequences] if drives.bound is not None else []
    rows = []
    for receiver in RECEIVERS:
        show_progress(f"altitude, {receiver}: bound")
        bounds = [drives.bounds(road, s, receiver) for road, s in zip(roads, sequences, strict=False)]
        for low_pass_s in LOW_PASS_S:
            show_progress(f"altitude, {receiver}, low-pass {low_pass_s:g} s")
            found = [drives.errors(s, receiver, low_pass_s) for s in sequences]
            for count in drives.groups():
                by_group = list(map(list, zip(*(of_road[count] for of_road in found), strict=True)))
                of = [of_road[count] for of_road in bounds]
                rows.append(
                    {
                        "log": name_of(low_pass_s),
                        "receiver": receiver,
                        "low_pass_s": low_pass_s,
                        "drives": count,
                        "coverage": 0.0,
                        **(figures(by_group) or {}),
                        "bound_percent": float(np.mean(of)) if of else None,
                    }
                )
    return sorted(rows, key=lambda row: (row["receiver"], row["drives"], row["low_pass_s"]))


def name_of(low_pass_s: float) -> str:
    """What a row is called."""
    return f"altitude, low-pass {low_pass_s:g} s" if low_pass_s else "altitude"
