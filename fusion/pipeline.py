"""The network adjustment of ``versant fuse``: all logs with factors solved together, as the service does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, Protocol

import numpy as np
from pydantic import ValidationError

from fusion.defaults import DEFAULT_METHOD
from fusion.errors import BadOptionsError, EmptyLogError, MethodError, NoMatchError
from fusion.frames import LocalProjection
from fusion.methods import METHODS
from fusion.methods.base import DriveResult, Options
from fusion.network.adjust import adjust
from fusion.network.combine import Part
from fusion.network.evidence import SegmentEvidence
from fusion.network.pass_factor import PassFactor
from fusion.network.window import gap_rows
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable
from fusion.terrain.dem import Dem
from fusion.terrain.windows import dem_slopes
from fusion.types import DriveLog, Ints, Progress, Track, no_progress

Passes = Mapping[int, Sequence[tuple[int, PassFactor]]]
"""By row of the road file: key and factor of each pass."""


class Solved(NamedTuple):
    """What logs with factors say together."""

    parts: dict[int, list[Part]]
    """By row of the road file: driven segments and gaps."""
    rejected: list[int]
    """For each log, the segments that it passed and on which it is not heard, for it contradicts the others."""


class Fused(Protocol):
    """A log's result, and the rows of the road file that its segment indices refer to."""

    @property
    def rows(self) -> Ints: ...
    @property
    def result(self) -> DriveResult: ...


def solve_network(roads: RoadTable, dem: Dem | None, logs: Sequence[Fused]) -> Solved:
    """Solve the logs that give factors together; the others have no part in it."""
    rejected = [0] * len(logs)
    # In the order of driving, so that the order in which logs are named changes no digit.
    numbers = sorted((k for k, one in enumerate(logs) if one.result.factors), key=lambda k: _begin(logs[k]))
    if not numbers:
        return Solved({}, rejected)
    passes, log_of = _passes(logs, numbers)
    evidence = {row: SegmentEvidence.build(keyed) for row, keyed in passes.items()}
    heard = {row: {log_of[key] for key in one.keys[one.accepted].tolist()} for row, one in evidence.items()}
    for row, one in evidence.items():
        for number in {log_of[key] for key in one.keys.tolist()} - heard[row]:
            rejected[number] += 1
    return Solved(_parts(roads, dem, surroundings([logs[k] for k in numbers]), evidence, heard), rejected)


def surroundings(logs: Sequence[Fused]) -> Ints:
    """Rows of the road file around the logs: farther than any gap beside a track is long."""
    return np.unique(np.concatenate([one.rows for one in logs]))


def _parts(
    roads: RoadTable,
    dem: Dem | None,
    near: Ints,
    evidence: Mapping[int, SegmentEvidence],
    heard: Mapping[int, set[int]],
) -> dict[int, list[Part]]:
    """The solution over the rows ``near``; ``heard``: the logs heard on each row."""
    table, driven = roads.subset(near), np.isin(near, list(evidence))
    solved = driven | gap_rows(table, driven)
    table, rows = table.subset(solved), near[solved]
    terrain = dem_slopes(dem, table) if dem else np.full(len(table), np.nan)
    result = adjust(table, [evidence.get(row) for row in rows.tolist()], terrain, rows)
    columns = zip(
        rows.tolist(),
        result.slope_percent.tolist(),
        result.slope_sigma_percent.tolist(),
        [len(heard.get(row, ())) for row in rows.tolist()],
        result.observations.tolist(),
        strict=True,
    )
    return {
        row: [Part(slope, sigma, count, observations, network=True)]
        for row, slope, sigma, count, observations in columns
        if np.isfinite(slope) and np.isfinite(sigma)
    }


def _begin(one: Fused) -> float:
    return float(one.result.track.time_s[0])


def _passes(
    logs: Sequence[Fused], numbers: Sequence[int]
) -> tuple[dict[int, list[tuple[int, PassFactor]]], list[int]]:
    """The passes of the logs with these numbers by row of the road file, under running keys; each key's log."""
    passes: dict[int, list[tuple[int, PassFactor]]] = {}
    log_of: list[int] = []
    for number in numbers:
        one = logs[number]
        for factor in one.result.factors:
            stored = replace(factor, segments=tuple(int(one.rows[s]) for s in factor.segments))
            passes.setdefault(stored.segments[-1], []).append((len(log_of), stored))
            log_of.append(number)
    return passes, log_of


ROAD_MARGIN_M = 250.0
MIN_EPOCHS = 4


def parse_options(method: str, options: Mapping[str, Any] | None = None) -> Options:
    """Validate ``options`` for ``method``; raises ``UnknownNameError`` or ``BadOptionsError``."""
    model = METHODS[method].options_model
    try:
        return model(**(options or {}))
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(str(part) for part in first["loc"])
        known = ", ".join(model.model_fields) or "none"
        raise BadOptionsError(
            f"Option {name!r} of method {method!r} is not usable: {first['msg']}. Its options are: {known}.",
            where=name,
        ) from None


def run_drive(
    log: DriveLog,
    roads: RoadTable,
    dem: Dem | None,
    *,
    method: str = DEFAULT_METHOD,
    options: Mapping[str, Any] | Options | None = None,
    progress: Progress = no_progress,
) -> tuple[RoadNetwork, DriveResult]:
    """Estimate the slopes of the segments that one drive went over.

    Takes the roads within ``ROAD_MARGIN_M`` of the log's extent, so a whole country may be handed in. Returns
    the network that the result's segment indices refer to. Raises ``FusionError`` with a sentence for the
    person who supplied the log.
    """
    estimator = METHODS[method]
    chosen = options if isinstance(options, Options) else parse_options(method, options)
    if len(log.fix) < MIN_EPOCHS:
        raise EmptyLogError(
            f"The log holds {len(log.fix)} position(s); at least {MIN_EPOCHS} are needed for a slope. "
            "Record for longer, or check that the receiver had a fix."
        )
    west, _, east, _ = log.bounds_deg()
    if east - west > 180:
        raise MethodError(
            f"The log reaches from {west:.3f} to {east:.3f} degrees east: it crosses the 180th meridian, which is not "
            "supported yet. Split it there into two logs."
        )
    near = roads.near(log.bounds_deg(), ROAD_MARGIN_M)
    if not len(near):
        raise NoMatchError(_far_message(log))
    network = RoadNetwork.project(near, _plane(log))
    result = estimator.estimate(log, network, dem, chosen, progress)
    if not np.any(result.track.segment >= 0):
        raise NoMatchError(_far_message(log))
    progress("filter", 1.0)
    report = _report(log, result, method, chosen, dem)
    return network, replace(result, report=report)


def _plane(log: DriveLog) -> LocalProjection:
    """Metres around the middle of the drive; the median, so that a wild fix can't drag the plane away."""
    return LocalProjection.around(
        np.median(log.fix.lon_deg, keepdims=True), np.median(log.fix.lat_deg, keepdims=True)
    )


def _far_message(log: DriveLog) -> str:
    west, south, east, north = log.bounds_deg()
    return (
        f"The log lies between {south:.5f} and {north:.5f} degrees north and between {west:.5f} and {east:.5f} "
        "degrees east, and no position in it comes near a known road. Import the roads of that area, or check the "
        "log's coordinates (latitude and longitude swapped?)."
    )


def _warnings(result: DriveResult) -> list[str]:
    """Why nothing came out, where nothing did."""
    if result.slopes:
        return []
    track = result.track
    matched = np.mean(track.segment >= 0)
    spacing = float(np.median(np.diff(track.time_s))) if len(track) > 1 else 0.0
    return [
        f"No segment got a slope: {matched:.0%} of the epochs lie on roads, {spacing:.1f} s apart. A slope needs "
        "several epochs with a height on one segment, at more than walking pace: record at 1 Hz or more, and check "
        "that the log or the DEM has heights there and that the roads are those that were driven, in their direction."
    ]


def _report(
    log: DriveLog, result: DriveResult, method: str, options: Options, dem: Dem | None
) -> dict[str, Any]:
    """The method's own report with what is the same for every method."""
    track = result.track
    return {
        "format": log.source_format,
        "method": method,
        "options": options.model_dump(mode="json"),
        "epochs": len(track),
        "duration_s": float(np.ptp(track.time_s)) if len(track) else 0.0,
        "matched_share": result.report.get("matched_share", _matched_share(track)),
        "segments_driven": len(
            {*track.segment[track.segment >= 0].tolist(), *(s.segment for s in result.slopes)}
        ),
        "segments_estimated": len(result.slopes),
        "dem": None if dem is None else dem.description,
        "dem_datum": None if dem is None else dem.datum,
        "geoid": log.geoid,
        "missing": list(log.missing),
        "skipped": dict(log.skipped),
        "repaired": dict(log.repaired),
        "warnings": [*log.warnings, *result.report.get("warnings", ()), *_warnings(result)],
        **{k: v for k, v in result.report.items() if k not in ("matched_share", "warnings")},
    }


def _matched_share(track: Track) -> float:
    return float(np.mean(track.segment >= 0)) if len(track) else 0.0
