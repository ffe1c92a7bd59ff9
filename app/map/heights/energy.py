"""``POST /v1/energy``: what a vehicle takes for a path over the roads, with the sigma that their slopes give it.

The balance of forces and how errors add up along a path stand in ``fusion.roads.energy``.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, Literal

import numpy as np
from fastapi import APIRouter
from pydantic import BaseModel, Field
from sqlalchemy.orm import Session

from app.core.errors import BadRequestError
from app.core.http import OfTheMap, ServiceDep, problems
from app.core.messages import say
from app.core.standby.use import MapRoute
from app.map.heights import places as reading
from app.map.heights.grades import HALF_M, Grades, grades_of, moved
from app.map.heights.road_heights import (
    MEASURED,
    OnRoad,
    along_line,
    heights_of,
    model_height,
    unit,
)
from app.map.heights.routes import MOST_RADIUS_M, RADIUS_M
from app.map.heights.store import RoadHere, roads_near, roads_of
from app.map.segment import attribution
from app.terrain.coverage import names_over
from app.terrain.store import current_dem
from fusion.roads.energy import VEHICLES, Energy, Pieces, Vehicle, energy_along
from fusion.types import Bools, Floats

STEP_M = 10.0
"""Pieces of a path are at most so long, unless there were more than ``MOST_PLACES`` then."""

USUAL_SLOPE_PERCENT = 4.0
"""How steep roads are, about."""

Kind = Literal["electric-car", "electric-van", "electric-truck", "e-bike", "car", "truck"]
_LINE = {"type": "LineString", "coordinates": [[8.4812, 48.9912], [8.4815, 48.9915]]}


class LineString(BaseModel, extra="ignore"):
    """A line, as GeoJSON has it."""

    type: Literal["LineString"]
    coordinates: list[list[float]] = Field(min_length=2, description="Longitude and latitude, degrees.")


class VehicleAsked(BaseModel, extra="forbid"):
    """A usual vehicle, and what is known better of yours."""

    kind: Kind = "electric-car"
    mass_kg: float | None = Field(None, gt=0, le=200_000)
    drag_area_m2: float | None = Field(None, ge=0, le=20, description="Drag coefficient times frontal area.")
    rolling: float | None = Field(None, ge=0, le=0.2, description="Coefficient of rolling resistance.")
    efficiency: float | None = Field(None, gt=0, le=1, description="Share at the wheels of what is taken.")
    regeneration: float | None = Field(
        None,
        ge=0,
        le=1,
        description="Share of what brakes would take that goes back, through the same losses.",
    )
    auxiliary_w: float | None = Field(None, ge=0, le=100_000, description="Heating, lights and the like.")
    speed_kmh: float | None = Field(None, gt=0, le=200, description="Constant on all of the path.")

    def vehicle(self) -> Vehicle:
        """With the usual numbers for what is not given."""
        given = self.model_dump(exclude={"kind"}, exclude_none=True)
        return Vehicle(**(asdict(VEHICLES[self.kind]) | given))


_REQUEST_EXAMPLE: dict[str, Any] = {"path": _LINE, "vehicle": {"kind": "electric-truck", "mass_kg": 32_000}}


class EnergyRequest(BaseModel, extra="forbid", json_schema_extra={"examples": [_REQUEST_EXAMPLE]}):
    """Which path, and which vehicle."""

    path: LineString | None = None
    segments: list[int] | None = Field(
        None,
        min_length=1,
        max_length=reading.MOST_PLACES,
        description="Instead of path: ids of segments that follow each other. One alone is gone from its from_node.",
    )
    vehicle: VehicleAsked = VehicleAsked()
    radius_m: float = Field(
        RADIUS_M, gt=0, le=MOST_RADIUS_M, description="How far off a road the path may lie."
    )


class EnergyOf(BaseModel):
    """What the path takes."""

    energy_kwh: float = Field(description="Negative where it gives more back.")
    sigma_kwh: float = Field(description="One standard deviation, by the errors of slopes alone.")


class EnergyByModel(BaseModel):
    """What it would seem to take by an elevation model that is read along the path, as most programs do."""

    energy_kwh: float
    known_share: float = Field(description="Share of the length of which the model has heights.")


_EXAMPLE: dict[str, Any] = {
    "energy_kwh": 0.0712,
    "sigma_kwh": 0.0031,
    "level_kwh": 0.0405,
    "elevation_model": {"energy_kwh": 0.0893, "known_share": 1.0},
    "length_m": 40.0,
    "measured_share": 1.0,
    "known_share": 1.0,
    "vehicle": asdict(VEHICLES["electric-truck"]) | {"mass_kg": 32_000.0},
    "attribution": attribution(),
}


class EnergyAnswer(OfTheMap, EnergyOf, json_schema_extra={"examples": [_EXAMPLE]}):
    """What the path takes at constant speed. What is unknown of it counts as level: see `known_share`."""

    level_kwh: float = Field(description="What it would take without any slope.")
    elevation_model: EnergyByModel
    length_m: float
    measured_share: float = Field(description="Share of the length on roads that were measured, 0..1.")
    known_share: float = Field(description="Share of the length on roads whose slope is known at all, 0..1.")
    vehicle: dict[str, float] = Field(description="The numbers that counted.")
    attribution: str


router = APIRouter(tags=["heights"], route_class=MapRoute)


@router.post(
    "/v1/energy",
    summary="Energy for a path, with its sigma",
    response_model_exclude_unset=True,
    responses=problems(422, 503),
)
def post_energy(service: ServiceDep, asked: EnergyRequest) -> EnergyAnswer:
    """What a vehicle takes from its battery or tank for a path at constant speed, and how sure the slopes make that.

    A line counts as on the roads that it most likely follows, as with `/height`. `sigma_kwh` is of the slopes' errors
    and how they hang together along the path; what is not known of vehicle, wind and traffic is not in it.
    `elevation_model` is the same by the imported elevation model alone, which knows no bridges.
    """
    if (asked.path is None) == (asked.segments is None):
        raise BadRequestError(say("energy.give_path"), field="path")
    vehicle = asked.vehicle.vehicle()
    with service.reading() as session:
        if asked.path is not None:
            places, on, ways, length_m = _of_line(session, asked.path, asked.radius_m)
        else:
            places, on, ways, length_m = _of_segments(session, asked.segments or [])
        before, after = moved(on, -HALF_M), moved(on, HALF_M)
        heights = heights_of(session, [*before, *after])
        low, high = heights[: len(on)], heights[len(on) :]
        west, south = places.min(axis=0).tolist()
        east, north = places.max(axis=0).tolist()
        rasters = names_over(current_dem(session, service.settings.dem_dir), [(west, south, east, north)])
        note = service.edition_note(session)
    measured = np.array([one is not None and one.source == MEASURED for one in low], bool)
    segment = np.array([-1 if one is None else one.road.id for one in on], np.int64)

    grades = grades_of(places, before, low, after, high, ways)
    slope, sigma = _likely(grades, measured)
    low, high = (
        [None if one is None else model_height(one.road, one.share) for one in side]
        for side in (before, after)
    )
    of_model = grades_of(places, before, low, after, high, ways).slope_percent / 100
    none = np.zeros(len(on))
    whole = Pieces(length_m, slope, sigma, segment, measured)
    model, level = (Pieces(length_m, one, none, segment, measured) for one in (of_model, none))
    return EnergyAnswer(
        **_rounded(energy_along(vehicle, whole)),
        level_kwh=round(energy_along(vehicle, level).kwh, 5),
        elevation_model=EnergyByModel(
            energy_kwh=round(energy_along(vehicle, model).kwh, 5),
            known_share=_share(model, np.isfinite(model.slope)),
        ),
        length_m=round(float(length_m.sum()), 1),
        measured_share=_share(whole, measured & np.isfinite(whole.slope)),
        known_share=_share(whole, np.isfinite(whole.slope)),
        vehicle=asdict(vehicle),
        attribution=attribution(rasters),
        **note,
    )


def _likely(grades: Grades, measured: Bools) -> tuple[Floats, Floats]:
    """Slopes, ratios, and their sigmas (n,): those that nobody measured are drawn towards the level, the more the
    less is known of them, since there are more level roads than steep ones.
    """
    error = np.where(measured, 0.0, grades.sigma_percent)
    share = USUAL_SLOPE_PERCENT**2 / (USUAL_SLOPE_PERCENT**2 + error**2)
    return grades.slope_percent * share / 100, grades.sigma_percent * np.sqrt(share) / 100


def _rounded(energy: Energy) -> dict[str, float]:
    return {"energy_kwh": round(energy.kwh, 5), "sigma_kwh": round(energy.sigma_kwh, 5)}


def _share(pieces: Pieces, which: Any) -> float:
    return round(float(pieces.length_m[which].sum()) / (float(pieces.length_m.sum()) or 1.0), 3)


Path = tuple[Floats, list[OnRoad | None], Floats | None, Floats]
"""Middles of pieces (n, 2), the roads there, the path's directions there (None: as the places go), lengths (n,)."""


def _of_line(session: Session, line: LineString, radius_m: float) -> Path:
    reading.check_number(len(line.coordinates), "path", reading.MOST_PLACES)
    if any(len(one) < 2 for one in line.coordinates):
        raise BadRequestError.about("path", say("energy.positions"))
    through = reading.from_pairs([(one[1], one[0]) for one in line.coordinates], "path")
    total_m = float(reading.distances_along_m(through)[-1])
    count = int(np.clip(np.ceil(total_m / STEP_M), 1, reading.MOST_PLACES))
    places = reading.spread(through, 2 * count + 1)[1::2]
    on = along_line(places, roads_near(session, places, radius_m), radius_m)
    # A single piece has no neighbours to tell its direction by.
    ways = None if count > 1 else _direction(through[0], through[-1])[None, :]
    return places, on, ways, np.full(count, total_m / count)


def _direction(start: Floats, end: Floats) -> Floats:
    step = (end - start) * np.array([np.cos(np.radians(start[1])), 1.0])
    return np.asarray(step / max(float(np.hypot(*step)), 1e-12))


def _of_segments(session: Session, ids: list[int]) -> Path:
    known = roads_of(session, ids)
    if missing := [one for one in ids if one not in known]:
        raise BadRequestError.about("segments", say("energy.no_segment", id=missing[0]))
    roads = [known[one] for one in ids]
    signs = _signs(roads)
    parts = [max(1, int(np.ceil(road.length_m / STEP_M))) for road in roads]
    reading.check_number(sum(parts), "segments", reading.MOST_PLACES)
    on: list[OnRoad | None] = []
    ways, places = [], []
    for road, sign, count in zip(roads, signs, parts, strict=True):
        shares = (np.arange(count) + 0.5) / count
        for share in (shares if sign > 0 else shares[::-1]).tolist():
            on.append(OnRoad(road, share, 0.0))
            east, north = unit(road)
            ways.append((sign * east, sign * north))
            lon = road.lon0_deg + share * (road.lon1_deg - road.lon0_deg)
            places.append((lon, road.lat0_deg + share * (road.lat1_deg - road.lat0_deg)))
    length_m = np.repeat([road.length_m / n for road, n in zip(roads, parts, strict=True)], parts)
    return np.array(places), on, np.array(ways), length_m


def _signs(roads: list[RoadHere]) -> list[int]:
    """1 where the path goes from the first node of a segment to the second, -1 the other way."""
    if len(roads) == 1:
        return [1]
    shared = {*roads[0].nodes} & {*roads[1].nodes}
    here = roads[0].from_node if roads[0].to_node in shared else roads[0].to_node
    signs = []
    for number, road in enumerate(roads):
        if here not in road.nodes:
            raise BadRequestError.about("segments", say("energy.no_path", n=number + 1, id=road.id))
        signs.append(1 if here == road.from_node else -1)
        here = road.to_node if here == road.from_node else road.from_node
    return signs
