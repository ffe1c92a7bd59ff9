"""Several drives solved together, and what they yielded as tables with geometries: for scripts and notebooks.

``solve`` is what ``versant fuse`` does with its logs: the network adjustment for methods that contribute factors,
inverse variance for those that yield slopes only. The frames are geopandas', which is loaded when one is made.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from fusion.methods.base import OF_TERRAIN, DriveResult
from fusion.network.combine import HEIGHTS, STEEPEST, CombinedSlope, SlopePart, published_slope
from fusion.network.control import ControlPoint
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable, rows_of
from fusion.terrain.dem import Dem
from fusion.terrain.windows import dem_slopes
from fusion.together import FusedDrive, SolvedNetwork, network_datum, solve_network
from fusion.types import Floats

if TYPE_CHECKING:
    from geopandas import GeoDataFrame

WGS84 = "EPSG:4326"


@dataclass(frozen=True, eq=False)
class Solution:
    """What drives say together: the k segments that have a slope, in the order of the road file, and remarks.

    ``slopes`` has one entry a segment, slopes positive uphill from from_node to to_node, sigma one standard deviation;
    ``dem_slope_percent`` (k,) is what the elevation model alone says, NaN where it says nothing. ``rejected`` counts
    for each drive the segments on which it contradicts the others and is rejected; ``duplicates`` names drives that
    another log is of too, each with that one; ``remarks`` are sentences on control points and the elevation model;
    ``height_datum`` says what heights refer to, None where there are none.
    """

    roads: RoadTable
    slopes: tuple[CombinedSlope, ...]
    dem_slope_percent: Floats
    rejected: list[int]
    duplicates: dict[int, int]
    remarks: list[str]
    height_datum: str | None

    def __len__(self) -> int:
        return len(self.slopes)


def solve(
    drives: Iterable[tuple[RoadNetwork, DriveResult]],
    roads: RoadTable,
    dem: Dem | None = None,
    *,
    control: Sequence[ControlPoint] = (),
    gaps: bool = False,
) -> Solution:
    """The slopes that several drives give together; ``drives`` are what ``run_drive`` returned for each.

    ``roads`` and ``dem`` must be those that the drives were run on: ``KeyError`` for a drive over other roads.
    ``control`` are surveyed heights; with ``gaps`` short undriven segments between driven ones get a slope too, with
    its own sigma and 0 drives. The order of the drives changes nothing, and a duplicate drive counts once.
    """
    nothing = np.empty(0)
    fused = [FusedDrive(rows_of(roads, network.table), result, nothing) for network, result in drives]
    return solve_fused(fused, roads, dem, control=control, gaps=gaps)


def solve_fused(
    drives: Sequence[FusedDrive],
    roads: RoadTable,
    dem: Dem | None,
    *,
    control: Sequence[ControlPoint] = (),
    gaps: bool = False,
) -> Solution:
    """As ``solve``, for drives that know their rows of the road file and the times of their positions."""
    slopes = [() if one.result.factors else alone(one) for one in drives]
    datum = network_datum(dem, [one.result.report for one in drives if one.result.factors], control)
    return solution_of(roads, dem, solve_network(roads, dem, drives, control), slopes, datum, gaps=gaps)


def alone(one: FusedDrive) -> list[tuple[int, SlopePart]]:
    """What a drive that gives no factors says of segments, by rows of the road file."""
    of_terrain = one.result.report.get("method") in OF_TERRAIN
    return [
        (
            int(one.rows[s.segment]),
            SlopePart(s.slope_percent, s.slope_sigma_percent, 1, s.observations, of_terrain=of_terrain),
        )
        for s in one.result.slopes
    ]


def solution_of(
    roads: RoadTable,
    dem: Dem | None,
    solved: SolvedNetwork,
    slopes: Iterable[Iterable[tuple[int, SlopePart]]],
    height_datum: str | None,
    *,
    gaps: bool = False,
) -> Solution:
    """The network's slopes and those of drives without factors as one; ``slopes``: of each drive, as ``alone`` has
    them, nothing of a drive with factors."""
    parts = solved.parts
    for k, of_drive in enumerate(slopes):
        for row, said in () if k in solved.duplicates else of_drive:
            parts.setdefault(row, []).append(said)
    shown = sorted(row for row, of_row in parts.items() if gaps or any(part.drives for part in of_row))
    table = roads.subset(np.array(shown, np.int64))
    return Solution(
        roads=table,
        slopes=tuple(published_slope(parts[row]) for row in shown),
        dem_slope_percent=dem_slopes(dem, table) if dem else np.full(len(table), np.nan),
        rejected=solved.rejected,
        duplicates=solved.duplicates,
        remarks=solved.remarks,
        height_datum=height_datum,
    )


def segments_frame(solution: Solution) -> GeoDataFrame:
    """The segments of a solution as a GeoDataFrame on WGS 84: one line a segment, from_node first.

    Columns as in every file of Versant but ``id`` and ``updated_at``; unknown is NaN, or None among the names.
    ``attrs["height_datum"]`` says what heights refer to.
    """
    import geopandas  # noqa: PLC0415 - here alone it is needed, and takes half a second
    import shapely  # noqa: PLC0415 - as above

    roads = solution.roads
    own = {field.name: [getattr(s, field.name) for s in solution.slopes] for field in fields(CombinedSlope)}
    names = (
        "osm_way_id",
        "from_node",
        "to_node",
        "length_m",
        "highway",
        "name",
        "oneway",
        "bridge",
        "tunnel",
    )
    columns: dict[str, Any] = {name: getattr(roads, name) for name in names}
    columns |= {name: _floats(own[name]) for name in ("slope_percent", "slope_sigma_percent")}
    columns |= {name: np.array(own[name], np.int64) for name in ("drives", "observations")}
    columns["dem_slope_percent"] = solution.dem_slope_percent
    columns |= {name: _floats(own[name]) for name in (*HEIGHTS, *STEEPEST, "driven_share")}
    columns["steepness_percent"] = np.abs(columns["slope_percent"])
    starts = np.column_stack([roads.lon0_deg, roads.lat0_deg])
    ends = np.column_stack([roads.lon1_deg, roads.lat1_deg])
    lines = shapely.linestrings(np.stack([starts, ends], axis=1))
    frame = geopandas.GeoDataFrame(columns, geometry=lines, crs=WGS84)
    frame.attrs["height_datum"] = solution.height_datum
    return frame


def track_frame(result: DriveResult, network: RoadNetwork) -> GeoDataFrame:
    """The estimated track of one drive as a GeoDataFrame on WGS 84: one point an epoch, None where none is known.

    Takes what ``run_drive`` returned. ``time`` is UTC; ``alt_m`` the height of the road, above what
    ``attrs["height_datum"]`` says; ``grade_percent`` the grade at the very place in the direction of travel;
    ``heading_deg`` clockwise from north; ``osm_way_id``, ``from_node`` and ``to_node`` name the segment, missing off
    all roads, and ``distance_m`` is measured along it from its from_node. Sigmas are one standard deviation.
    """
    import geopandas  # noqa: PLC0415 - as above
    import pandas as pd  # noqa: PLC0415 - as above
    import shapely  # noqa: PLC0415 - as above

    track, table = result.track, network.table
    matched = track.segment >= 0
    grade = np.tan(track.pitch_rad)
    columns: dict[str, Any] = {
        "time": pd.to_datetime(np.round(1000 * track.time_s), unit="ms", utc=True),
        "alt_m": track.alt_m,
        "alt_sigma_m": track.alt_sigma_m,
        "h_sigma_m": track.h_sigma_m,
        "speed_mps": track.speed_mps,
        "heading_deg": np.degrees(track.heading_rad) % 360,
        "grade_percent": 100 * grade,
        "grade_sigma_percent": 100 * track.pitch_sigma_rad * (1 + grade**2),
    }
    for name in ("osm_way_id", "from_node", "to_node"):
        numbers = np.zeros(len(track), np.int64)
        numbers[matched] = getattr(table, name)[track.segment[matched]]
        columns[name] = pd.array(numbers, dtype="Int64")
        columns[name][~matched] = pd.NA
    columns |= {
        "distance_m": np.where(matched, track.distance_m, np.nan),
        "has_gnss": track.has_gnss,
        "after_outage": track.after_outage,
        "after_gap": track.after_outage,  # deprecated name of the column before
    }
    known = np.isfinite(track.lon_deg) & np.isfinite(track.lat_deg)
    points = np.full(len(track), None, object)
    points[known] = shapely.points(track.lon_deg[known], track.lat_deg[known])
    frame = geopandas.GeoDataFrame(columns, geometry=points, crs=WGS84)
    frame.attrs["height_datum"] = result.report.get("height_datum")
    return frame


def _floats(values: Iterable[float | None]) -> Floats:
    return np.array([np.nan if value is None else value for value in values], float)
