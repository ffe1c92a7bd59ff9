"""Where a drive's positions lie is an unknown of the drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from factor_support import POSITION_SIGMA_M, Profile, driven, street, without_place
from fusion.network.adjust import adjust
from fusion.types import Floats
from street_support import EVERYTHING


def test_drives_whose_positions_are_wrong_find_out_where_they_were() -> None:
    """Over a hill one drive alone can't tell the road from its place; of ten the middle is known better than any."""
    table = street(*[25.0] * 8)
    edge = np.concatenate([[0.0], np.cumsum(table.length_m)])

    def height(row: int, at: np.ndarray) -> np.ndarray:
        return np.asarray(100 + 2 * np.sin((edge[row] + at) / 25))

    truth = 100 * np.array([slope_of(height, row, 25.0) for row in range(8)])
    misses: dict[str, list[Floats]] = {"one": [], "ten": [], "one as if right": []}
    for seed in range(12):
        rng = np.random.default_rng(seed)
        drives = {
            k: driven(table, range(8), height, replace(EVERYTHING, farther_m=float(farther_m)), rng)
            for k, farther_m in enumerate(POSITION_SIGMA_M * rng.normal(size=10))
        }
        one, ten = adjust(table, {0: drives[0]}), adjust(table, drives)
        blind = adjust(table, {0: [without_place(p) for p in drives[0]]})
        assert np.all(ten.slope_sigma_percent < one.slope_sigma_percent)
        for name, found in zip(misses, (one, ten, blind), strict=True):
            misses[name].append((found.slope_percent - truth) / found.slope_sigma_percent)
    z_rms = {name: float(np.sqrt(np.mean(np.square(v)))) for name, v in misses.items()}
    assert z_rms["one"] < 1.1
    assert z_rms["ten"] < 1.1
    assert z_rms["one as if right"] > 1.3, "which is what the unknown is for"


def slope_of(height: Profile, row: int, length: float) -> float:
    """The regression of height on distance over a row."""
    at = np.linspace(0.0, length, 2001)
    return float(np.polyfit(at, height(row, at), 1)[0])
