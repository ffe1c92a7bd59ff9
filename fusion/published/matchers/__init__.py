"""The map matchers of the survey in Al Assaad 2020, 1.3.1, by name: baselines for the matcher of whole drives."""

from __future__ import annotations

from fusion.published.matchers.base import PointMatcher
from fusion.published.matchers.curve import CurveToCurve
from fusion.published.matchers.geometric import PointToPoint, PointToSegment, SegmentDirection
from fusion.published.matchers.mahalanobis import Mahalanobis
from fusion.published.matchers.topological import Topological
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
