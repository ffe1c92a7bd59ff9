"""An owner's zones over HTTP, as GeoJSON: points with a radius. What lies in them goes into no edition of the map."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from fastapi import APIRouter, Response
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field

from app.access.documents import Name
from app.access.store import own_id
from app.access.zone_store import Zone, set_zones, zones_of
from app.core.http import UNREADABLE_BODY, ServiceDep, problems
from app.core.telemetry import audit
from app.core.telemetry.audit import Origin
from app.core.text import GEO_JSON

router = APIRouter(prefix="/v1/owner", tags=["access"])

MOST_ZONES = 50
LEAST_RADIUS_M, MOST_RADIUS_M = 50.0, 5000.0

_EXAMPLE: dict[str, Any] = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": [8.6724, 49.4102]},
            "properties": {"name": "home", "radius_m": 300},
        }
    ],
}

Lon = Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)]
Lat = Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)]


class ZonePoint(BaseModel, extra="forbid"):
    """Where a zone's middle is."""

    type: Literal["Point"]
    coordinates: tuple[Lon, Lat] = Field(description="Longitude and latitude, degrees.")


class ZoneProperties(BaseModel, extra="forbid"):
    """What a zone is called, and how large it is."""

    name: Name = Field(description="For its owner alone.")
    radius_m: float = Field(ge=LEAST_RADIUS_M, le=MOST_RADIUS_M, description="Metres.")


class ZoneFeature(BaseModel, extra="forbid"):
    """A zone."""

    type: Literal["Feature"]
    geometry: ZonePoint
    properties: ZoneProperties


class Zones(BaseModel, extra="forbid", json_schema_extra={"examples": [_EXAMPLE]}):
    """The zones of an owner."""

    type: Literal["FeatureCollection"]
    features: list[ZoneFeature] = Field(max_length=MOST_ZONES)

    @classmethod
    def of(cls, zones: list[Zone]) -> Self:
        """The document of these zones."""
        features = [
            ZoneFeature(
                type="Feature",
                geometry=ZonePoint(type="Point", coordinates=(zone.lon_deg, zone.lat_deg)),
                properties=ZoneProperties(name=zone.name, radius_m=zone.radius_m),
            )
            for zone in zones
        ]
        return cls(type="FeatureCollection", features=features)

    def rows(self) -> list[Zone]:
        """The zones as they are kept."""
        return [
            Zone(one.properties.name, *one.geometry.coordinates, one.properties.radius_m)
            for one in self.features
        ]


class GeoJsonAnswer(JSONResponse):
    """Its media type."""

    media_type = GEO_JSON


@router.get("/zones", summary="The owner's zones", response_class=GeoJsonAnswer, responses=problems(401, 403))
def get_zones(service: ServiceDep) -> Zones:
    """Places of which no edition of the public map tells anything that the owner drove. Nobody else sees them."""
    with service.reading() as session:
        return Zones.of(zones_of(session, own_id()))


@router.put(
    "/zones",
    summary="Set the owner's zones",
    status_code=204,
    responses={**UNREADABLE_BODY, **problems(401, 403, 422)},
)
def put_zones(zones: Zones, service: ServiceDep, origin: Origin) -> Response:
    """Replace all of them, from the next edition on; what an edition has told already is told."""
    with service.sessions.begin() as session:
        set_zones(session, own_id(), zones.rows())
        audit.note(session, origin, "zones changed", f"owner {own_id()}", zones=len(zones.features))
    return Response(status_code=204)
