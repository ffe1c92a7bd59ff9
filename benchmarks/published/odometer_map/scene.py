"""A drive of the shape of the experiment of Lahrech, Boucher, Choquel and Noyer 2005 (section 4.1)."""

from __future__ import annotations

import numpy as np

from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.motion.routes import plan_route
from fusion.simulate.motion.vehicle import Driver
from fusion.simulate.receiver.wheels import WheelSet
from fusion.simulate.scene.town import make_town

DURATION_S = 325.0
OUTAGES_S = (40.0, 31.0)
_FIRST_OUTAGE_S = (60.0, 110.0)
_SECOND_OUTAGE_S = (190.0, 270.0)
_DRIVER = Driver(top_speed_mps=16.5, stop_chance=0.3)
_THROUGH = ("primary", "secondary", "tertiary")
TEN_PERCENT_WHEELS = WheelSet(slip=0.1, slip_each=0.01)
"""Lahrech et al. 2005 say that their odometers' "reliability was evaluated at 90 %", for slip and tyre pressure, and no
more. Read here as an error of 10 % (one sigma) of what the wheels turn between two readings, common to both, which at
10 m/s gives the speed error of about 1 m/s that they show; what the wheels do not share is a tenth of it. An error of
10 % of each wheel on its own (``slip_each=0.1``) would be 0.9 rad of heading per second at that speed, and their
odometers do detect turns."""


def lahrech_drive(seed: int, *, wheels: WheelSet = TEN_PERCENT_WHEELS) -> SimulatedDrive:
    """A drive of 325 s at 1 Hz through the town of ``seed``, with wheels and two outages, of 40 s and of 31 s.

    It keeps to streets (neither motorway nor tunnel), goes at up to 16.5 m/s where they allow it, and halts at many
    junctions, as the paper says of its own. When the outages begin is drawn from the seed. The paper's receiver was a
    Novatel of 2005 without corrections; an M8 stands in for it. Its reference was differential GPS,
    here it is the truth.
    """
    town = make_town(seed)
    highway = town.roads.highway.astype(str)
    rng = np.random.default_rng([seed, 30])
    route = plan_route(
        town,
        2 * DURATION_S,
        rng,
        first=np.isin(highway, _THROUGH),
        closed=np.isin(highway, ["motorway", "motorway_link"]) | town.roads.tunnel,
    )
    begins = rng.uniform(*_FIRST_OUTAGE_S), rng.uniform(*_SECOND_OUTAGE_S)
    return simulate_drive(
        town,
        seed,
        DURATION_S,
        outages=list(zip(begins, OUTAGES_S, strict=True)),
        route=route,
        wheels=wheels,
        driver=_DRIVER,
    )
