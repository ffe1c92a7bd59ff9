"""The map matchers of the survey in Al Assaad 2020, 1.3.1, by name: baselines for the matcher of whole drives."""

from __future__ import annotations

from fusion.matching.points.base import PointMatcher
from fusion.matching.points.curve import CurveToCurve
from fusion.matching.points.geometric import PointToPoint, PointToSegment, SegmentDirection
from fusion.matching.points.mahalanobis import Mahalanobis
from fusion.matching.points.topological import Topological
from fusion.registry import Registry

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

__all__ = ["MATCHERS"]
