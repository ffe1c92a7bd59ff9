"""A dense reference for the usual roughness of roads, place by place."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fusion.frames import METRES_PER_DEGREE
from fusion.network import road_beliefs as roads
from fusion.network.pass_factor import PassFactor
from fusion.network.road_beliefs import PLACE_M
from fusion.roads.table import RoadTable

Place = tuple[int | str, ...]


class DenseUsual:
    """``at`` is the usual roughness about each row: first what drives learned of themselves, then what they say."""

    def __init__(self, table: RoadTable, passes: Sequence[PassFactor]) -> None:
        self.around = [_places(table, row) for row in range(len(table))]
        self.of_class = [
            {(*place, str(kind)): share for place, share in shares.items()}
            for shares, kind in zip(self.around, table.highway, strict=True)
        ]
        logs = [(self.around[p.segment], math.log(p.roughness)) for p in passes]
        everywhere = float(np.mean([v for _, v in logs] or [math.log(roads.DEFAULT_ROUGHNESS)]))
        self.begin: dict[Place, float] = {}
        for place in {c for shares in self.around for c in shares}:
            near = [(shares.get(place, 0.0), v) for shares, v in logs]
            total = sum(share * v for share, v in near) + roads.FAR_SHARE * everywhere
            usual = math.exp(total / (sum(share for share, _ in near) + roads.FAR_SHARE))
            self.begin[place] = float(np.clip(usual, *roads.ROUGHNESS_BOUNDS))
        self.at = _at_rows(self.around, self.begin)

    def learn(self, rows: Sequence[int], change: Sequence[float]) -> None:
        """From the squared driven intervals on ``rows``, each of two changes of grade."""
        free, count = roads.ROUGHNESS_FREEDOM, roads.ROUGHNESS_PRIOR_COUNT
        for _ in range(5):
            change2 = [c * (free + 2) / (free + c / self.at[r]) for r, c in zip(rows, change, strict=True)]
            place = _at_rows(self.around, _means(self.around, rows, change2, self.begin, count))
            ratio = [s / place[r] for r, s in zip(rows, change2, strict=True)]
            as_others = {c: 1.0 for shares in self.of_class for c in shares}
            more = _at_rows(self.of_class, _means(self.of_class, rows, ratio, as_others, count))
            self.at = [p * m for p, m in zip(place, more, strict=True)]


def _means(
    around: list[dict[Place, float]],
    rows: Sequence[int],
    values: Sequence[float],
    begin: dict[Place, float],
    count: float,
) -> dict[Place, float]:
    """For each place, of ``count`` imaginary changes as they begin and two for each of the values about it."""
    total = {c: count * v for c, v in begin.items()}
    number = dict.fromkeys(begin, count)
    for row, value in zip(rows, values, strict=True):
        for place, share in around[row].items():
            total[place] += share * value
            number[place] += 2 * share
    return {c: total[c] / number[c] for c in total}


def _at_rows(around: list[dict[Place, float]], of_place: dict[Place, float]) -> list[float]:
    return [sum(share * of_place[c] for c, share in shares.items()) for shares in around]


def _places(table: RoadTable, row: int) -> dict[Place, float]:
    """The four places around the middle of a segment, and its share in each."""
    lat = (table.lat0_deg[row] + table.lat1_deg[row]) / 2
    lon = (table.lon0_deg[row] + table.lon1_deg[row]) / 2
    north = lat * METRES_PER_DEGREE / PLACE_M
    east = lon * METRES_PER_DEGREE / PLACE_M * math.cos(math.radians(round(lat)))
    return {
        (round(lat), i, j): (1 - abs(north - i)) * (1 - abs(east - j))
        for i in (math.floor(north), math.floor(north) + 1)
        for j in (math.floor(east), math.floor(east) + 1)
    }
