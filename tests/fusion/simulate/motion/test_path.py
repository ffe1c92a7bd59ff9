"""The driven line: on the right of two-way roads."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.simulate.drive import SimulatedDrive


def test_two_way_roads_are_driven_on_the_right(perfect: SimulatedDrive) -> None:
    town, truth = perfect.town, perfect.truth
    a, b = town.start[truth.segment], town.end[truth.segment]
    dx, dy = town.node_x_m[b] - town.node_x_m[a], town.node_y_m[b] - town.node_y_m[a]
    aside = dy * (truth.x_m - town.node_x_m[a]) - dx * (truth.y_m - town.node_y_m[a])
    right = np.where(truth.forward, 1, -1) * aside / town.length_m[truth.segment]
    two_way = town.roads.oneway[truth.segment] == 0
    assert np.median(right[two_way]) == pytest.approx(1.5, abs=0.4)
    if np.sum(~two_way) > 100:
        assert np.abs(np.median(right[~two_way])) < 1.0
