"""Routes to heights of the road: ``/height`` as Valhalla's service has it, ``/v1/elevation`` as Google's."""

from __future__ import annotations

import json
from math import isfinite
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field, ValidationError

from app.core.errors import BadRequestError
from app.core.http import OfTheMap, Service, ServiceDep, problems
from app.core.messages import say
from app.core.standby.use import MapRoute
from app.map.heights import places as reading
from app.map.heights.grades import Climb, Grades, climb_of, heights_and_grades
from app.map.heights.road_heights import OnRoad, RoadHeight, along_line, heights_of, nearest
from app.map.heights.store import roads_near
from app.map.segment import HEIGHT_DATUM, attribution
from app.terrain.coverage import names_over
from app.terrain.store import current_dem
from fusion.types import Floats

RADIUS_M = 25.0
"""Half the width of the widest roads and what a phone is off."""
MOST_RADIUS_M = 100.0
MOST_LOCATIONS = 512
"""Google's limit of one request; clients ask in parts of so many."""

HEIGHTS_EXAMPLE: dict[str, Any] = {
    "shape": [{"lat": 48.9912, "lon": 8.4812}, {"lat": 48.9915, "lon": 8.4815}],
    "range_height": [[0.0, 151.2], [40.0, 153.86]],
    "sigma": [2.41, 2.43],
    "source": ["measured", "measured"],
    "units": "meters",
    "datum": HEIGHT_DATUM,
    "attribution": attribution(),
}
ELEVATIONS_EXAMPLE: dict[str, Any] = {
    "results": [
        {
            "elevation": 151.2,
            "location": {"lat": 48.9912, "lng": 8.4812},
            "resolution": 41.4,
            "sigma": 2.41,
            "source": "measured",
        }
    ],
    "status": "OK",
    "datum": HEIGHT_DATUM,
    "attribution": attribution(),
}

RadiusQuery = Annotated[
    float, Query(gt=0, le=MOST_RADIUS_M, description="How far off a road a place may lie, metres.")
]


class Place(BaseModel, extra="ignore"):
    """A place, degrees."""

    lat: float = Field(ge=-90, le=90)
    lon: float = Field(ge=-180, le=180)


_REQUEST_EXAMPLE: dict[str, Any] = {"shape": HEIGHTS_EXAMPLE["shape"], "range": True}


class HeightRequest(BaseModel, extra="ignore", json_schema_extra={"examples": [_REQUEST_EXAMPLE]}):
    """What Valhalla's service takes; what is not known here is ignored, as there."""

    shape: list[Place] | None = None
    encoded_polyline: str | None = Field(None, description="Instead of shape.")
    shape_format: Literal["polyline6", "polyline5"] = "polyline6"
    range: bool = Field(False, description="Give range_height: pairs of metres along the line, and height.")
    resample_distance: float | None = Field(
        None, ge=1, description="Metres between places that are put along the line instead of those sent."
    )
    height_precision: int = Field(2, ge=0, le=2, description="Decimals of heights.")
    radius_m: float = Field(
        RADIUS_M, gt=0, le=MOST_RADIUS_M, description="How far off a road a place may lie."
    )
    slope: bool = Field(
        False,
        description="Give slope_percent, slope_sigma_percent and climb as well; Valhalla has none of them.",
    )
    id: str | None = Field(None, description="Comes back with the answer.")


class Heights(OfTheMap, json_schema_extra={"examples": [HEIGHTS_EXAMPLE]}):
    """Heights in the order of the places; null where no road with a known height is near."""

    id: str | None = None
    shape: list[Place] | None = None
    encoded_polyline: str | None = None
    height: list[float | None] | None = None
    range_height: list[tuple[float, float | None]] | None = Field(
        None, description="Metres from the first place along the line, and the height there."
    )
    sigma: list[float | None] = Field(description="One standard deviation of each height, metres.")
    source: list[str | None] = Field(description="What each height rests on.")
    slope_percent: list[float | None] | None = Field(
        None, description="Of the road at each place, positive where the line goes up."
    )
    slope_sigma_percent: list[float | None] | None = Field(
        None, description="One standard deviation of each slope."
    )
    climb: Climb | None = None
    units: Literal["meters"] = "meters"
    datum: str
    attribution: str


class Location(BaseModel):
    """As Google writes places."""

    lat: float
    lng: float


class Elevation(BaseModel):
    """One place's height."""

    elevation: float | None = Field(description="Metres; null where no road with a known height is near.")
    location: Location
    resolution: float | None = Field(
        description="Metres between the places on the road whose heights are known, here the segment's length."
    )
    sigma: float | None = Field(description="One standard deviation, metres.")
    source: str | None = Field(description="What the height rests on.")


class Elevations(OfTheMap, json_schema_extra={"examples": [ELEVATIONS_EXAMPLE]}):
    """The Google Elevation API's answer, with what else is known of each height."""

    results: list[Elevation]
    status: Literal["OK"] = "OK"
    datum: str
    attribution: str


router = APIRouter(tags=["heights"], route_class=MapRoute)


_HEIGHTS_ROUTE: dict[str, Any] = {
    "summary": "Heights along a line",
    "response_model": Heights,
    "response_model_exclude_none": True,
    "responses": problems(422, 503),
}


@router.get("/height", **_HEIGHTS_ROUTE)
def get_height(
    service: ServiceDep,
    json_: Annotated[
        str,
        Query(alias="json", description="The request that POST takes as a body, as JSON.", max_length=65536),
    ],
) -> dict[str, Any]:
    """As POST."""
    try:
        request = HeightRequest.model_validate(json.loads(json_))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise BadRequestError.about("json", f"{where}: {first['msg']}.") from None
    except (ValueError, RecursionError):
        raise BadRequestError.about("json", say("heights.no_object")) from None
    return _answer(service, request)


@router.post("/height", **_HEIGHTS_ROUTE)
def post_height(service: ServiceDep, asked: HeightRequest) -> dict[str, Any]:
    """Height of the **road** at each place of a line, in the shape of Valhalla's `/height`.

    Each place counts as on the road that the line most likely follows there, of those within `radius_m`: a line over a
    bridge has the deck's heights. Where nobody drove, heights are those of the elevation model along the road, and on
    bridges and in tunnels they go evenly between those of its ends. `sigma` and `source` tell them apart. Differences
    of heights of two sources say little: their datums may differ by metres. With `slope` each place has the slope of
    its road in the line's direction, and `climb` tells what the line goes up and down.
    """
    return _answer(service, asked)


@router.get(
    "/v1/elevation",
    summary="Heights of places",
    response_model_exclude_unset=True,
    responses=problems(422, 503),
)
def elevation(
    service: ServiceDep,
    locations: Annotated[
        str | None,
        Query(
            description="lat,lng|lat,lng ..., or enc: and an encoded polyline.",
            examples=["48.9912,8.4812|48.9915,8.4815"],
        ),
    ] = None,
    path: Annotated[str | None, Query(description="A line, written like locations; with samples.")] = None,
    samples: Annotated[
        int | None, Query(ge=2, le=MOST_LOCATIONS, description="How many places along path.")
    ] = None,
    radius_m: RadiusQuery = RADIUS_M,
    key: Annotated[
        str | None, Query(description="Taken, since clients of Google's send one; not used.")
    ] = None,
) -> Elevations:
    """Height of the **road** nearest to each place, in the shape of the Google Elevation API, which osmnx asks for.

    With `path` the places are `samples` ones along that line, and belong to the road that it most likely follows, as
    with `/height`.
    """
    del key
    if (locations is None) == (path is None):
        raise BadRequestError(say("heights.give_locations"), field="locations")
    if path is not None:
        if samples is None:
            raise BadRequestError.about("samples", say("heights.samples"))
        line = reading.from_text(path, "path", MOST_LOCATIONS)
        if len(line) < 2:
            raise BadRequestError.about("path", say("heights.line"))
        places = reading.spread(line, samples)
    else:
        places = reading.from_text(locations or "", "locations", MOST_LOCATIONS)
    on, heights, said, _ = _heights(service, places, radius_m, line=path is not None)
    results = [
        Elevation(
            elevation=None if height is None else round(height.height_m, 2),
            location=Location(lat=round(lat, 7), lng=round(lon, 7)),
            resolution=None if height is None or where is None else round(where.road.length_m, 1),
            sigma=None if height is None else round(height.sigma_m, 2),
            source=None if height is None else height.source,
        )
        for (lon, lat), where, height in zip(places.tolist(), on, heights, strict=True)
    ]
    return Elevations(results=results, status="OK", **said)


def _answer(service: Service, request: HeightRequest) -> dict[str, Any]:
    places = _places(request)
    along_m = reading.distances_along_m(places)
    if request.resample_distance is not None and len(places) > 1:
        count = max(2, round(float(along_m[-1]) / request.resample_distance) + 1)
        reading.check_number(count, "resample_distance", reading.MOST_PLACES)
        places = reading.spread(places, count)
        along_m = reading.distances_along_m(places)
    on, heights, said, grades = _heights(
        service, places, request.radius_m, line=True, slope=request.slope and len(places) > 1
    )
    digits = request.height_precision
    height_m = [None if one is None else round(one.height_m, digits) for one in heights]
    answer: dict[str, Any] = {} if request.id is None else {"id": request.id}
    if request.encoded_polyline is not None and request.resample_distance is None:
        answer["encoded_polyline"] = request.encoded_polyline
    else:
        answer["shape"] = [{"lat": round(lat, 7), "lon": round(lon, 7)} for lon, lat in places.tolist()]
    if request.range:
        answer["range_height"] = [
            (round(metres, 1), height) for metres, height in zip(along_m.tolist(), height_m, strict=True)
        ]
    else:
        answer["height"] = height_m
    return answer | {
        "sigma": [None if one is None else round(one.sigma_m, 2) for one in heights],
        "source": [None if one is None else one.source for one in heights],
        **({} if grades is None else _slopes(grades, climb_of(places, on, heights, grades))),
        "units": "meters",
        **said,
    }


def _slopes(grades: Grades, climb: Climb) -> dict[str, Any]:
    columns = {"slope_percent": grades.slope_percent, "slope_sigma_percent": grades.sigma_percent}
    return {
        **{
            name: [round(one, 2) if isfinite(one) else None for one in column.tolist()]
            for name, column in columns.items()
        },
        "climb": {name: round(value, 3) for name, value in climb.model_dump().items()},
    }


def _places(request: HeightRequest) -> Floats:
    if (request.shape is None) == (request.encoded_polyline is None):
        raise BadRequestError(say("heights.give_shape"), field="shape")
    if request.shape is not None:
        reading.check_number(len(request.shape), "shape", reading.MOST_PLACES)
        return reading.from_pairs([(one.lat, one.lon) for one in request.shape], "shape")
    digits = 6 if request.shape_format == "polyline6" else 5
    return reading.from_polyline(
        request.encoded_polyline or "", digits, "encoded_polyline", reading.MOST_PLACES
    )


def _heights(
    service: Service, places: Floats, radius_m: float, *, line: bool, slope: bool = False
) -> tuple[list[OnRoad | None], list[RoadHeight | None], dict[str, Any], Grades | None]:
    """The roads, the heights there, what is said of all of them, and their slopes along the line."""
    with service.reading() as session:
        near = roads_near(session, places, radius_m)
        if line and len(places) > 1:
            on = along_line(places, near, radius_m)
        else:
            on = [nearest(place, roads, radius_m) for place, roads in zip(places, near, strict=True)]
        heights, grades = (
            heights_and_grades(session, places, on) if slope else (heights_of(session, on), None)
        )
        west, south = places.min(axis=0).tolist()
        east, north = places.max(axis=0).tolist()
        rasters = names_over(current_dem(session, service.settings.dem_dir), [(west, south, east, north)])
        note = service.edition_note(session)
    return on, heights, {"datum": HEIGHT_DATUM, "attribution": attribution(rasters), **note}, grades
