"""Speeds for OSRM: the file of ``--segment-speed-file``.

Consumer: OSRM (``osrm-contract``, ``osrm-customize``), ``src/updater/csv_source.cpp`` and
``include/updater/csv_file_parser.hpp``. Grammar: lines without a header,

    from_node "," to_node "," km/h [ "," rate ] [ "," comment ] EOL

with OpenStreetMap's numbers of consecutive nodes of a way, directed. Older versions read speeds as whole numbers, so
whole numbers are the default. Of equal pairs the last line counts; none is written twice here. A line of 0 km/h would
close the road: there is none.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from app.exports.format import Format, NoOptions, Stated
from app.exports.writing.best_slope import Unmeasured, directions, slope_of
from app.exports.writing.vehicles import VEHICLES, Kind, Vehicle
from app.map.segment import Segment

if TYPE_CHECKING:
    from app.exports.source import Source


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
        return Vehicle(
            mass_kg=self.mass_kg or usual.mass_kg,
            power_w=usual.power_w if self.power_kw is None else self.power_kw * 1000,
            drag_area_m2=usual.drag_area_m2 if self.drag_area_m2 is None else self.drag_area_m2,
            rolling=usual.rolling if self.rolling is None else self.rolling,
            class_kmh={name: min(limit, top) for name, limit in usual.class_kmh.items()},
            lasting_brake_w=usual.lasting_brake_w,
            assisted_w=usual.assisted_w,
            assisted_kmh=usual.assisted_kmh,
            lowest_kmh=usual.lowest_kmh,
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
        count, level = 0, 0
        with path.open("w", encoding="ascii", newline="") as file:
            for segment, speeds in _directed(source, options):
                for from_node, to_node, speed in speeds:
                    file.write(f"{from_node},{to_node},{speed:.{options.decimals}f}\n")
                    count += 1
                level += slope_of(segment, options.unmeasured) is None
        if level:
            source.note(f"Of {level} segments no slope is known at all: their speeds are those on the level.")
        source.note(f"OSRM's lines have no place for whose data they are: {stated.get('attribution', '')}.")
        return count


def _directed(
    source: Source, options: SpeedOptions
) -> Iterator[tuple[Segment, list[tuple[int, int, float]]]]:
    vehicle, lowest = options.chosen(), 10.0**-options.decimals
    for segment in source.segments(gaps=True):
        if segment.slope_percent is None and options.unmeasured is Unmeasured.SKIP:
            continue
        slope = slope_of(segment, options.unmeasured) or 0.0
        yield (
            segment,
            [
                (a, b, max(vehicle.speed_kmh(sign * slope, segment.highway), lowest))
                for a, b, sign in directions(segment)
            ],
        )
