"""From a drive log to slopes: one drive through all of the library.

``run_drive`` is what a worker of the service and the command line do with a log. Nothing here knows files, people or
where a result goes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from fusion.catalogue import METHODS, POSITIONINGS
from fusion.errors import EmptyLogError, MethodError, MissingSensorError, NoMatchError
from fusion.frames import LocalProjection
from fusion.gnss.positioning import Positioned, options_of, positioned, validated
from fusion.messages import joined, message_of, say
from fusion.methods.base import DriveResult, Options
from fusion.methods.computed_positions import (
    above_ellipsoid,
    heights_under,
    knows_grade,
    places_alone,
    without_heights,
)
from fusion.registry import DEFAULT_METHOD
from fusion.report import Ground, advice_of, drive_report, ground_under, without_placeholders
from fusion.roads.network import RoadNetwork
from fusion.roads.table import RoadTable, boxes_along
from fusion.terrain.dem import Dem
from fusion.terrain.geoid import taken_above_ellipsoid
from fusion.types import DriveLog, Floats, Progress, no_progress

ROAD_MARGIN_M = 250.0
"""Roads this far around a log's positions are loaded: farther than a method looks for a road, or a gap is long."""
MIN_FIXES = 4
"""Positions without which no log has a slope."""


def parse_options(method: str, options: Mapping[str, Any] | None = None) -> Options:
    """Validate ``options`` for ``method``; raises ``UnknownNameError`` or ``BadOptionsError``."""
    chosen = validated(METHODS[method].options_model, options, f"method {method!r}")
    options_of(POSITIONINGS[chosen.gnss], chosen.gnss_options)
    return chosen


def run_drive(
    log: DriveLog | Positioned,
    roads: RoadTable,
    dem: Dem | None,
    *,
    method: str = DEFAULT_METHOD,
    options: Mapping[str, Any] | Options | None = None,
    progress: Progress = no_progress,
) -> tuple[RoadNetwork, DriveResult]:
    """Estimate the slopes of the segments that one drive went over.

    Positions are computed first, as the options say, unless the log comes with them (``positions_of``); where a
    solver made them and there is an elevation model, the heights of the matched road help to compute them again.
    Takes the roads along the log (``road_boxes``), so a whole country may be handed in. Returns
    the network that the result's segment indices refer to. Raises ``FusionError`` with a sentence for the
    person who supplied the log.
    """
    estimator = METHODS[method]
    chosen = options if isinstance(options, Options) else parse_options(method, options)
    positioned = log if isinstance(log, Positioned) else positions_of(log, chosen, progress)
    positioned = replace(positioned, log=without_placeholders(positioned.log))
    if chosen.heights == "ellipsoid" and positioned.solution is None:
        positioned = replace(positioned, log=taken_above_ellipsoid(positioned.log))
    log = positioned.log
    if len(log.fix) < MIN_FIXES:
        raise EmptyLogError(say("log.too_few_positions", n=len(log.fix), least=MIN_FIXES))
    west, _, east, _ = log.bounds_deg()
    if east - west > 180:
        raise MethodError(say("log.meridian", west=west, east=east))
    near = roads.along(road_boxes(log))
    if not len(near):
        raise NoMatchError(_far_message(log))
    network = RoadNetwork.project(near, _plane(log))
    if dem:
        positioned = _helped(positioned, network, dem)
    ground = ground_under(positioned.log, dem)
    log, graded = _for_slopes(positioned, ground)
    try:
        result = estimator.estimate(log, network, dem, chosen, progress)
    except MissingSensorError as error:
        advice = advice_of(positioned.log, estimator.cues, dem, ground)
        raise MissingSensorError(joined([message_of(error), advice]), where=error.where) from error
    result = result if graded else places_alone(result)
    if not np.any(result.track.segment >= 0):
        raise NoMatchError(_far_message(log))
    progress("slopes", 1.0)
    report = drive_report(
        log, result, estimator, chosen, dem, ground, computed=positioned.solution is not None, graded=graded
    )
    return network, replace(result, report=report | {"gnss": positioned.report})


def positions_of(log: DriveLog, options: Options, progress: Progress = no_progress) -> Positioned:
    """The log with positions computed as the options of a method say; raises ``FusionError``."""
    return positioned(log, options.gnss, options.gnss_options, progress)


def _helped(positioned: Positioned, network: RoadNetwork, dem: Dem) -> Positioned:
    """The positions again, helped by the heights of the road that they lead along, where they do."""
    if positioned.with_heights is None:
        return positioned
    height = above_ellipsoid(heights_under(positioned.log, network, dem), positioned.height_ell_m)
    return positioned.with_heights(height) if np.isfinite(height).any() else positioned


def _for_slopes(positioned: Positioned, ground: Ground | None) -> tuple[DriveLog, bool]:
    """The log as methods take it, and whether slopes may be made of it."""
    if positioned.solution is None:
        return positioned.log, True
    graded = (ground is not None and ground.share > 0) or knows_grade(positioned.log)
    return (without_heights(positioned.log) if graded else positioned.log), graded


def road_boxes(log: DriveLog) -> Floats:
    """Boxes (m, 4: west, south, east, north; degrees) whose roads a drive is matched to: within ``ROAD_MARGIN_M``."""
    return boxes_along(log.fix.lon_deg, log.fix.lat_deg, ROAD_MARGIN_M)


def _plane(log: DriveLog) -> LocalProjection:
    """Metres around the middle of the drive; the median, so that a wild fix can't drag the plane away."""
    return LocalProjection.around(
        np.median(log.fix.lon_deg, keepdims=True), np.median(log.fix.lat_deg, keepdims=True)
    )


def _far_message(log: DriveLog) -> str:
    west, south, east, north = log.bounds_deg()
    return say("drive.no_road_near", south=south, north=north, west=west, east=east)
