"""A hilly synthetic town with known slopes, and drives through it, all from one seed.

``write_all`` makes everything as files; ``make_town`` and ``Town.drive`` give the same as objects.
``make_interchange`` with ``calais_drive``, and ``lahrech_drive``, have the shapes of published experiments.
"""

from fusion.simulate.bundle import Bundle, NamedDrive, demo_drives, write_all
from fusion.simulate.calais import Interchange, calais_drive, make_interchange
from fusion.simulate.drive import Pass, SimulatedDrive, simulate_drive
from fusion.simulate.lahrech import lahrech_drive
from fusion.simulate.motion import Driver
from fusion.simulate.receiver import RECEIVERS, ReceiverProfile
from fusion.simulate.routes import Route, plan_route, structures
from fusion.simulate.satellite_dem import DEM_MODELS
from fusion.simulate.terrain import GEOID_UNDULATION_M
from fusion.simulate.town import Town, make_town
from fusion.simulate.wheels import PERFECT_WHEELS, TEN_PERCENT_WHEELS, WheelReadings, WheelSet

__all__ = [
    "DEM_MODELS",
    "GEOID_UNDULATION_M",
    "PERFECT_WHEELS",
    "RECEIVERS",
    "TEN_PERCENT_WHEELS",
    "Bundle",
    "Driver",
    "Interchange",
    "NamedDrive",
    "Pass",
    "ReceiverProfile",
    "Route",
    "SimulatedDrive",
    "Town",
    "WheelReadings",
    "WheelSet",
    "calais_drive",
    "demo_drives",
    "lahrech_drive",
    "make_interchange",
    "make_town",
    "plan_route",
    "simulate_drive",
    "structures",
    "write_all",
]
