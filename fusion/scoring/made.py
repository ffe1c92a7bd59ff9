"""References that are made: the road under a route through a simulated town, to the millimetre.

The towns are those of ``versant simulate --seed``, so that whoever wants to be measured has the roads and the elevation
model that belong to them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fusion.scoring.profiles import Profile
from fusion.simulate.motion.path import draw_path
from fusion.simulate.motion.routes import plan_route
from fusion.simulate.scene.town import make_town
from fusion.simulate.write.dem_file import write_dem

SEEDS = {"town-1": 1, "town-2": 2, "town-3": 3}
"""By name: the seed of the town."""
DURATION_S = 900.0
"""Of the route, about."""
STEP_M = 5.0
_STREAM = 40
"""Of random numbers, which nothing else draws from."""


def made_reference(name: str) -> Profile:
    """The profile of that name, one of ``SEEDS``."""
    town = make_town(SEEDS[name])
    rng = np.random.default_rng([town.seed, _STREAM])
    path = draw_path(town, plan_route(town, DURATION_S, rng), lane_m=0.0, wander_m=0.0, rng=rng)
    along = np.arange(0.0, path.length_m, STEP_M)
    x, y, height = path.curve(along).T
    places = np.column_stack(town.projection.to_lonlat(x, y))
    return Profile(height, along, places, np.zeros(len(along)))


def made_elevation(name: str, path: Path) -> None:
    """Write the elevation model of that reference's town, with the errors of one from satellites."""
    write_dem(make_town(SEEDS[name]), path)
