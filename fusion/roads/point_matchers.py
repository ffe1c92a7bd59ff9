"""The map matchers of the survey in Al Assaad 2020, 1.3.1, by name: baselines for the matcher of whole drives."""

from __future__ import annotations

from fusion.registry import Registry
from fusion.roads.point_matchers_base import Matching, PointMatcher
from fusion.roads.point_matchers_curve import CurveToCurve
from fusion.roads.point_matchers_geometric import (
    Mahalanobis,
    PointToPoint,
    PointToSegment,
    SegmentDirection,
)
from fusion.roads.point_matchers_topological import Topological

__all__ = [
    "MATCHERS",
    "CurveToCurve",
    "Mahalanobis",
    "Matching",
    "PointMatcher",
    "PointToPoint",
    "PointToSegment",
    "SegmentDirection",
    "Topological",
]

MATCHERS: Registry[PointMatcher] = Registry("point matcher")
for _matcher in (
    PointToPoint(),
    PointToSegment(),
    SegmentDirection(),
    CurveToCurve(),
    Topological(),
    Mahalanobis(),
):
    MATCHERS.add(_matcher.name, _matcher)
