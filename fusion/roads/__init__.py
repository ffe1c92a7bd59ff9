"""Roads: OSM files to node-pair segments, segments on a metric plane, positions matched to them."""

from fusion.roads.matching import PointMatch, PointMatches, match_points, nearest_mahalanobis
from fusion.roads.network import RoadNetwork
from fusion.roads.osm import read_roads
from fusion.roads.table import RoadTable

__all__ = [
    "PointMatch",
    "PointMatches",
    "RoadNetwork",
    "RoadTable",
    "match_points",
    "nearest_mahalanobis",
    "read_roads",
]
