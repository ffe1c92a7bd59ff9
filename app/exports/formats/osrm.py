"""Speeds for OSRM: the file of ``--segment-speed-file``.

Consumer: OSRM (``osrm-contract``, ``osrm-customize``), ``src/updater/csv_source.cpp`` and
``include/updater/csv_file_parser.hpp``. Grammar: lines without a header,

    from_node "," to_node "," km/h [ "," rate ] [ "," comment ] EOL

with OpenStreetMap's numbers of consecutive nodes of a way, directed. Older versions read speeds as whole numbers, so
whole numbers are the default. Of equal pairs the last line counts; none is written twice here. A line of 0 km/h would
close the road: there is none.

How fast a vehicle goes on a slope is the balance of forces at constant speed. Engine and resistances are in balance,
with mass m, gradient angle a, rolling resistance c_r, drag area A, density r:

    P = v (m g sin a + c_r m g cos a + r A v^2 / 2)

The speed is the one that solves this for the power that the vehicle has, and no more than it may go on roads of the
class. Uphill it falls; downhill it is bounded by the class, by what a rider dares, and for heavy vehicles by the
power that their lasting brakes (engine and retarder) take up. It is a constant speed: who comes to a short climb with
a run-up is faster.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from app.core.messages import say
from app.exports.format import Format, NoOptions, Stated
from app.map.segment import Segment
from fusion.types import Floats

if TYPE_CHECKING:
    from app.exports.source import Source

DEM_HEIGHT_SIGMA_M = 1.5
"""By how much heights of an elevation model at the ends of one segment are off against each other, about."""
USUAL_SLOPE_PERCENT = 4.0
"""How steep roads are, about: what a doubtful slope is drawn towards the level by."""


class Unmeasured(StrEnum):
    """What is assumed of segments that nobody measured."""

    DEM = "dem"
    LEVEL = "level"
    SKIP = "skip"


def slope_of(segment: Segment, unmeasured: Unmeasured) -> float | None:
    """The slope to go by, percent along the way; None where it is unknown.

    By the elevation model it is drawn towards the level, the more the shorter the segment: its heights are off by
    metres, which is nothing over a kilometre and a wall over ten metres. On bridges and in tunnels it says nothing.
    """
    if segment.slope_percent is not None:
        return segment.slope_percent
    dem = segment.dem_slope_percent
    if unmeasured is not Unmeasured.DEM or dem is None or segment.bridge or segment.tunnel:
        return None
    error = 100 * math.sqrt(2) * DEM_HEIGHT_SIGMA_M / max(segment.length_m, 1.0)
    return dem * USUAL_SLOPE_PERCENT**2 / (USUAL_SLOPE_PERCENT**2 + error**2)


def directions(segment: Segment) -> list[tuple[int, int, int]]:
    """The ways in which it may be driven: from a node, to a node, and the sign of its slope in that direction."""
    along = (segment.from_node, segment.to_node, 1)
    against = (segment.to_node, segment.from_node, -1)
    if segment.oneway:
        return [along if segment.oneway > 0 else against]
    return [along, against]


GRAVITY_MPS2 = 9.81
AIR_KGPM3 = 1.2
MPS_PER_KMH = 1 / 3.6
_HALVINGS = 50  # of 150 km/h: far below a rounding


class Kind(StrEnum):
    """The vehicles that can be named."""

    CAR = "car"
    TRUCK = "truck"
    BICYCLE = "bicycle"
    E_BIKE = "e-bike"


@dataclass(frozen=True)
class Vehicle:
    """What the balance needs; see the module."""

    mass_kg: float
    power_w: float
    """At the wheel, for as long as a climb takes."""
    drag_area_m2: float
    """Drag coefficient times frontal area."""
    rolling: float
    """Coefficient of rolling resistance."""
    class_kmh: Mapping[str, float]
    """The highest speed on the level, by ``highway``; ``*`` of all others."""
    lasting_brake_w: float | None = None
    """What brakes take up downhill without end; None: enough for any road."""
    assisted_w: float = 0.0
    """Further power, below ``assisted_kmh``."""
    assisted_kmh: float = 25.0
    lowest_kmh: float = 3.0
    """Somebody pushes, or the lowest gear crawls."""

    def limit_kmh(self, highway: str) -> float:
        """The highest speed on roads of a class."""
        return self.class_kmh.get(highway.removesuffix("_link"), self.class_kmh["*"])

    def speeds_kmh(self, slope_percent: Floats, highway: str) -> Floats:
        """Speeds (n,) in km/h, up slopes (n,) (negative: down) of a class of roads."""
        slope = np.asarray(slope_percent, float)
        limit = self.limit_kmh(highway)
        climbing = self._balance_kmh(slope, self.power_w, limit)
        if self.assisted_w:
            bound = min(limit, self.assisted_kmh)
            helped = self._balance_kmh(slope, self.power_w + self.assisted_w, bound)
            climbing = np.maximum(climbing, helped)
        if self.lasting_brake_w is not None:
            climbing = np.minimum(climbing, self._braked_kmh(slope, limit))
        return np.clip(climbing, min(self.lowest_kmh, limit), limit)

    def speed_kmh(self, slope_percent: float, highway: str) -> float:
        """One speed, km/h, interpolated between those at ``SLOPES_PERCENT``, which are kept."""
        if highway not in self._tables:
            self._tables[highway] = self.speeds_kmh(SLOPES_PERCENT, highway)
        return float(np.interp(slope_percent, SLOPES_PERCENT, self._tables[highway]))

    @cached_property
    def _tables(self) -> dict[str, Floats]:
        return {}

    def _balance_kmh(self, slope_percent: Floats, power_w: float, limit_kmh: float) -> Floats:
        """The highest speed up to the limit at which the power is enough: by halving, as the surplus may rise first.

        Downhill the resistance is negative at low speeds, and every speed up to the balance is within the power.
        """
        low, high = np.zeros_like(slope_percent), np.full_like(slope_percent, limit_kmh)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            enough = self._needed_w(slope_percent, middle * MPS_PER_KMH) <= power_w
            low, high = np.where(enough, middle, low), np.where(enough, high, middle)
        return np.asarray(high)

    def _braked_kmh(self, slope_percent: Floats, limit_kmh: float) -> Floats:
        """The highest speed up to the limit below which brakes hold the vehicle without end."""
        brake = self.lasting_brake_w or 0.0
        speeds = np.linspace(0.0, limit_kmh, 400)[1:]
        held = self._needed_w(slope_percent[:, None], speeds * MPS_PER_KMH) >= -brake
        first_lost = np.where(held.all(axis=1), len(speeds), np.argmin(held, axis=1))
        return np.asarray(np.append(0.0, speeds)[first_lost])

    def _needed_w(self, slope_percent: Floats, speed_mps: Floats) -> Floats:
        angle = np.arctan(slope_percent / 100)
        weight = self.mass_kg * GRAVITY_MPS2
        force = weight * (np.sin(angle) + self.rolling * np.cos(angle))
        drag = 0.5 * AIR_KGPM3 * self.drag_area_m2 * speed_mps**2
        return np.asarray(speed_mps * (force + drag))


SLOPES_PERCENT = np.linspace(-40.0, 40.0, 801)
"""At which speeds are tabulated; steeper ones count as the steepest."""

_CAR_KMH = {
    "motorway": 120.0, "trunk": 95.0, "primary": 75.0, "secondary": 65.0, "tertiary": 55.0, "unclassified": 45.0,
    "residential": 30.0, "living_street": 10.0, "service": 20.0, "track": 15.0, "road": 30.0, "*": 30.0,
}  # fmt: skip
_TRUCK_KMH = _CAR_KMH | {
    "motorway": 85.0, "trunk": 80.0, "primary": 65.0, "secondary": 55.0, "tertiary": 50.0, "unclassified": 40.0,
}  # fmt: skip
_BICYCLE_KMH = {"track": 25.0, "living_street": 15.0, "service": 25.0, "*": 45.0}

VEHICLES: dict[Kind, Vehicle] = {
    Kind.CAR: Vehicle(1500.0, 70_000.0, 0.65, 0.012, _CAR_KMH),
    Kind.TRUCK: Vehicle(40_000.0, 300_000.0, 6.0, 0.006, _TRUCK_KMH, lasting_brake_w=350_000.0),
    Kind.BICYCLE: Vehicle(90.0, 120.0, 0.5, 0.007, _BICYCLE_KMH),
    Kind.E_BIKE: Vehicle(105.0, 100.0, 0.55, 0.007, _BICYCLE_KMH, assisted_w=250.0),
}
"""Usual ones: a family car, a loaded lorry of 40 t with 300 kW at the wheel, a rider of 120 W, and one with a motor."""


class SpeedOptions(NoOptions):
    """Which vehicle, and what is written."""

    vehicle: Kind = Field(Kind.CAR, description="Whose speeds: car, truck, bicycle or e-bike.")
    mass_kg: float | None = Field(None, gt=0, le=200_000, description="Instead of the vehicle's usual mass.")
    power_kw: float | None = Field(None, gt=0, le=2000, description="At the wheel, instead of the usual.")
    drag_area_m2: float | None = Field(None, ge=0, le=20, description="Drag coefficient times frontal area.")
    rolling: float | None = Field(None, ge=0, le=0.2, description="Coefficient of rolling resistance.")
    max_kmh: float | None = Field(None, gt=0, le=200, description="An upper bound on all roads.")
    unmeasured: Unmeasured = Field(
        Unmeasured.DEM,
        description="Of segments without a measured slope: by the elevation model, as if level, or left out.",
    )
    decimals: int = Field(
        0, ge=0, le=2, description="Digits of a speed; old versions of OSRM read whole km/h."
    )

    def chosen(self) -> Vehicle:
        """The vehicle with what is given instead of the usual."""
        usual = VEHICLES[self.vehicle]
        top = math.inf if self.max_kmh is None else self.max_kmh
        return replace(
            usual,
            mass_kg=self.mass_kg or usual.mass_kg,
            power_w=usual.power_w if self.power_kw is None else self.power_kw * 1000,
            drag_area_m2=usual.drag_area_m2 if self.drag_area_m2 is None else self.drag_area_m2,
            rolling=usual.rolling if self.rolling is None else self.rolling,
            class_kmh={name: min(limit, top) for name, limit in usual.class_kmh.items()},
        )


class OsrmSpeeds(Format):
    """A line for each segment and direction that may be driven."""

    name = "osrm-speeds"
    consumer = "OSRM (--segment-speed-file, as of src/updater/csv_source.cpp)"
    suffixes = (".csv",)
    media_type = "text/csv"
    description = f"Speeds of a vehicle on every segment and in each direction, from its slope ({consumer})"
    options = SpeedOptions

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """Write the lines; the format has no place for what is stated, so it is noted."""
        vehicle, lowest = options.chosen(), 10.0**-options.decimals
        count, level = 0, 0
        with path.open("w", encoding="ascii", newline="") as file:
            for segment in source.segments(gaps=True):
                if segment.slope_percent is None and options.unmeasured is Unmeasured.SKIP:
                    continue
                slope = slope_of(segment, options.unmeasured)
                for from_node, to_node, sign in directions(segment):
                    speed = max(vehicle.speed_kmh(sign * (slope or 0.0), segment.highway), lowest)
                    file.write(f"{from_node},{to_node},{speed:.{options.decimals}f}\n")
                    count += 1
                level += slope is None
        if level:
            source.note(say("export.speeds_level", n=level))
        source.note(say("export.osrm_credit", credit=stated.get("attribution", "")))
        return count
