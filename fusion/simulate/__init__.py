"""A hilly synthetic town with known slopes, and drives through it, all from one seed.

``write_all`` makes everything as files; ``make_town`` and ``Town.drive`` give the same as objects.
"""

from fusion.simulate.bundle import Bundle, NamedDrive, demo_drives, write_all
from fusion.simulate.drive import Pass, SimulatedDrive, simulate_drive
from fusion.simulate.receiver import RECEIVERS, ReceiverProfile
from fusion.simulate.routes import Route, plan_route, structures
from fusion.simulate.terrain import GEOID_UNDULATION_M
from fusion.simulate.town import Town, make_town

__all__ = [
    "GEOID_UNDULATION_M",
    "RECEIVERS",
    "Bundle",
    "NamedDrive",
    "Pass",
    "ReceiverProfile",
    "Route",
    "SimulatedDrive",
    "Town",
    "demo_drives",
    "make_town",
    "plan_route",
    "simulate_drive",
    "structures",
    "write_all",
]
