"""The elevation model that measured roads correct, out of a database: what all its formats share.

How posts are set is for ``fusion.terrain.corrected``; which segments count, and what is said of it, stands here.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from itertools import islice
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import AfterValidator, Field

from app.core.messages import say
from app.exports.format import NoOptions, Stated
from fusion.errors import RoadsError

if TYPE_CHECKING:
    from app.exports.source import Source
    from app.map.segment import Segment
    from fusion.terrain.corrected.fit import CorrectedTerrain
    from fusion.terrain.corrected.roads import RoadHeights

_AT_ONCE = 10_000
HALF_TURN_DEG = 180.0
_COLUMNS = (
    "length_m",
    "height_from_m",
    "height_to_m",
    "steepest_percent",
    "steepest_from_m",
    "steepest_to_m",
    "slope_sigma_percent",
)


def _one_or_three(value: int) -> int:
    if value not in (1, 3):
        raise ValueError("it is 1 or 3")
    return value


ArcSecond = Annotated[int, AfterValidator(_one_or_three)]
"""From post to post."""


class Crossings(StrEnum):
    """Whose posts they are where roads cross at different levels."""

    SHARED = "shared"
    GROUND = "ground"
    UPPER = "upper"


class ReliefOptions(NoOptions):
    """How the elevation model is corrected."""

    blend_m: float = Field(
        120, ge=30, le=1000, description="So far beside roads the correction is blended out."
    )
    crossings: Crossings | None = Field(
        None,
        description="Whose height counts where roads cross at different levels: shared, ground or upper; "
        "by default upper for Valhalla, else shared.",
    )
    most_sigma_m: float = Field(
        5, gt=0, le=100, description="Only roads whose height is known to so many metres (one sigma)."
    )

    @property
    def levels(self) -> Crossings:
        """What is asked for, or best for the consumer."""
        return self.crossings or Crossings.SHARED


@dataclass(frozen=True)
class Relief:
    """The model, the roads that correct it in their own datum, and the datum of the model, where it has one."""

    terrain: CorrectedTerrain
    roads: RoadHeights
    datum: str | None


@contextmanager
def relief_of(
    source: Source, options: ReliefOptions, *, whole: bool, one_post: bool = False
) -> Iterator[Relief]:
    """The corrected model for as long as its rasters are open; ``RoadsError`` where no height of a road is known.

    ``whole``: posts are whole metres; ``one_post``: for who takes one post for a place.
    """
    from fusion.terrain.corrected.fit import CorrectedTerrain, Levels, Rule  # noqa: PLC0415 - compilers and scipy

    roads = _roads(source, options.most_sigma_m)
    if not len(roads):
        raise RoadsError(say("export.no_road_heights", most_m=options.most_sigma_m))
    rule = Rule(options.blend_m, Levels(options.levels), one_post, whole)
    with source.ground() as dem:
        terrain = CorrectedTerrain(dem, roads, rule)
        datum = source.ground_datum()
        if dem is None:
            source.note(say("export.no_ground"))
        else:
            source.note(say("export.corrected", n=len(roads), datum=datum, offset_m=terrain.offset_m))
        yield Relief(terrain, roads, datum)


def _roads(source: Source, most_sigma_m: float) -> RoadHeights:
    from fusion.terrain.corrected.roads import RoadHeights  # noqa: PLC0415 - as above

    segments = (one for one in source.asked_segments() if _is_known(one, most_sigma_m))
    tables = []
    while part := list(islice(segments, _AT_ONCE)):
        tables.append(_table(RoadHeights, part))
    return RoadHeights.empty().joined(*tables)


def _is_known(segment: Segment, most_sigma_m: float) -> bool:
    heights = (segment.height_from_m, segment.height_to_m, segment.slope_sigma_percent)
    sigma, (west, east) = segment.height_sigma_m, (segment.coordinates[0][0], segment.coordinates[-1][0])
    on_one_side = abs(east - west) < HALF_TURN_DEG  # tiles end at the antimeridian
    return on_one_side and all(map(_is_number, heights)) and sigma is not None and sigma <= most_sigma_m


def _is_number(value: float | None) -> bool:
    return value is not None and bool(np.isfinite(value))


def _table(kind: type[RoadHeights], part: Iterable[Segment]) -> RoadHeights:
    part = list(part)
    ends = np.array([(*one.coordinates[0], *one.coordinates[-1]) for one in part])
    columns = {
        name: np.array([getattr(one, name) for one in part], float)  # None becomes NaN
        for name in _COLUMNS
    }
    columns |= dict(zip(("lon0_deg", "lat0_deg", "lon1_deg", "lat1_deg"), ends.T, strict=True))
    structure = np.array([one.bridge or one.tunnel for one in part], bool)
    way = np.array([one.osm_way_id for one in part], np.int64)
    return kind(**columns, structure=structure, way=way)


def about(stated: Stated, relief: Relief, options: ReliefOptions) -> str:
    """What stands beside tiles that have no place for it."""
    from fusion.terrain.corrected.files import CHANGES  # noqa: PLC0415 - rasterio

    return (
        "An elevation model in which posts along roads have the height of the road, measured by vehicles.\n\n"
        f"Attribution: {stated.get('attribution', '')}\n"
        f"Heights: metres above {relief.datum or stated.get('height_datum', 'an unknown datum')}\n"
        f"Corrected: within {options.blend_m:g} m of measured roads; where roads cross at different levels: "
        f"{options.levels.value}\n"
        f"changed/: what became of each post: {CHANGES}\n"
        f"{_rasters(stated)}"
        f"Data of {stated.get('changed_at', 'unknown')}\n\n{stated.get('provenance', '')}\n"
    )


def _rasters(stated: Stated) -> str:
    """Whose elevations these are, a line a raster."""
    elevation = json.loads(stated.get("provenance", "{}")).get("elevation") or {}
    said_not = "not stated"
    rasters: list[Mapping[str, str | None]] = elevation.get("rasters", [])
    return "".join(
        f"Elevation: {one['name']}, source: {one['source'] or said_not}, licence: {one['licence'] or said_not}\n"
        for one in rasters
    )
