"""An elevation model that has the heights of measured roads along their lines, and its own away from them.

Who reads an elevation model along a road samples it between the posts. So posts on both sides of a road are set
together: of all surfaces those whose bilinear interpolation has the road's height along its line, and of these the one
whose correction c of the model changes least from post to post:

    sum over places along roads  ((interpolated - road) / (sigma (1 + sigma of the grade in percent)))^2
      + sum over posts near a road  ((c - that of the nearest place on it) / NEAREST_SIGMA_M)^2
      + sum over neighbouring posts  ((c_i - c_j) / STEP_SIGMA_M)^2  ->  least

over the posts within ``Rule.blend_m`` of a road; c is 0 at all others, which stay as they are. The second sum is for
who takes the nearest post without interpolation. Where the model is void its correction has no meaning: there heights
instead of corrections differ little.

**Roads at different levels** (``LEVEL_M``) that cross need other heights of the same posts (``Levels``). Routers take
bridges and tunnels by the ends of their ways and sample roads on the ground along their lines. So by ``ground`` a
bridge or tunnel has no say within a posting of another road on the ground, or of a higher bridge, but where its way
ends; elsewhere its deck lies over the valley. By ``shared`` it has as much of a say there as a place between nodes: it
gives way to a junction below it and shares with a street. By ``upper`` the upper road has the posts. Roads on the
ground share them, but by the last.

Posts are solved in blocks, each with a margin; seams agree to a centimetre, since roads pin the surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree

from fusion.terrain.corrected.grids import ArcSeconds, PostGrid, posting_m
from fusion.terrain.corrected.roads import (
    Places,
    RoadHeights,
    in_datum_of,
    places_along,
    structures_that_lose,
)
from fusion.terrain.corrected.whole import whole_metres
from fusion.terrain.dem import Dem
from fusion.types import Bools, Floats, Ints

PLACES_A_POSTING = 4
NODE_SIGMA_M, PLACE_SIGMA_M = 0.03, 0.2
"""How near the interpolated surface comes to a road whose grade is known for sure, at its nodes and between them: most
routers sample nodes, and between them the road is not known as well. With a grade known to 1 % it is twice as much."""
NEAREST_SIGMA_M = 1.0
ONE_POST_SIGMA_M = 0.1
NEAREST_POSTINGS = 0.75
"""Posts so near a road are corrected as it is."""
STEP_SIGMA_M = 3.0


class Change(IntEnum):
    """What became of a post."""

    NONE = 0
    BLENDED = 1
    ROAD = 2
    STRUCTURE = 3
    """A bridge's deck or a road in a tunnel."""


class Levels(StrEnum):
    """Whose the posts are where roads cross at different levels."""

    SHARED = "shared"
    GROUND = "ground"
    UPPER = "upper"


@dataclass(frozen=True)
class Rule:
    """How a model is corrected."""

    blend_m: float = 120.0
    """So far beside roads the correction is blended out."""
    levels: Levels = Levels.SHARED
    one_post: bool = False
    """For GraphHopper without interpolation: the post that it takes for a node of a road has the node's height."""
    whole: bool = False
    """Posts are whole metres, chosen together so that roads keep their slopes as far as that goes."""


@dataclass(frozen=True, eq=False)
class Block:
    """Posts of some rows and columns: heights (rows, columns), m, NaN void; what became of each (``Change``)."""

    height_m: NDArray[np.floating]
    change: NDArray[np.integer]


class CorrectedTerrain:
    """A model and the roads that correct it, asked for block after block. Memory: the roads, and one block."""

    def __init__(self, dem: Dem | None, roads: RoadHeights, rule: Rule = Rule()) -> None:
        """``roads`` have heights in their own datum. Without a model all is void but roads and what is beside them."""
        self._dem = dem
        self.rule = rule
        self.roads, self.offset_m = in_datum_of(dem, roads)

    def block(self, grid: PostGrid, columns: range, rows: range) -> Block:
        """The posts of these columns and rows, whose steps are 1."""
        apart = posting_m(grid, columns[len(columns) // 2], rows[len(rows) // 2])
        margin = int(np.ceil(2 * self.rule.blend_m / min(apart)))
        wide = range(columns.start - margin, columns.stop + margin)
        high = range(rows.start - margin, rows.stop + margin)
        inner = slice(margin, margin + len(rows)), slice(margin, margin + len(columns))
        roads = self.roads.take(self.roads.in_box(*_box(grid, wide, high)))
        if not len(roads):
            z = self._model(grid, columns, rows)
            return Block(_rounded(z) if self.rule.whole else z, np.zeros(z.shape, np.int64))
        window = _Window(grid, wide, high, apart)
        posts = window.solved(self._model(grid, wide, high), roads, self.rule)
        return Block(posts.height_m[inner], posts.change[inner])

    def _model(self, grid: PostGrid, columns: range, rows: range) -> Floats:
        if self._dem is None:
            return np.full((len(rows), len(columns)), np.nan)
        lon, lat = grid.axes(np.array(columns, float), np.array(rows, float))
        return self._dem.heights(lon[None, :], lat[:, None])


def _box(grid: PostGrid, columns: range, rows: range) -> tuple[float, float, float, float]:
    (west, east), (north, south) = grid.axes(
        np.array([columns[0], columns[-1]], float), np.array([rows[0], rows[-1]], float)
    )
    return float(west), float(south), float(east), float(north)


def _rounded(z: Floats) -> Floats:
    return np.asarray(np.floor(z + 0.5))


@dataclass(frozen=True, eq=False)
class _Samples:
    """m places whose four posts are in the window: posts (m, 4) by number, their weights, where, and what is wanted."""

    post: Ints
    weight: Floats
    x_m: Floats
    y_m: Floats
    places: Places
    shares: Bools
    """Who would have no say by the rule ``ground``."""

    def beside(self, model_m: Floats, post: Ints, nearest: Ints) -> Floats:
        """Heights (k,) of posts beside their nearest places: corrected as there; where the model is void the road's."""
        road = self.places.height_m[nearest]
        correction = road - (self.weight * model_m[self.post]).sum(axis=1)[nearest]
        moved = model_m[post] + correction
        return np.where(np.isfinite(moved), moved, road)


@dataclass(frozen=True)
class _Window:
    grid: PostGrid
    columns: range
    rows: range
    apart_m: tuple[float, float]

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.rows), len(self.columns)

    def solved(self, model: Floats, roads: RoadHeights, rule: Rule) -> Block:
        """All posts of the window."""
        samples = self._samples(roads, rule)
        change = np.zeros(model.size, np.int64)
        start = model.ravel().copy()
        if not len(samples.post):
            return Block(_rounded(model) if rule.whole else model, change.reshape(self.shape))
        distance, nearest = self._nearest(samples, rule.blend_m)
        band = np.flatnonzero(np.isfinite(distance))
        change[band] = Change.BLENDED
        deck = samples.places.structure
        change[samples.post[~deck]] = Change.ROAD
        change[samples.post[deck]] = Change.STRUCTURE
        outside = _rounded(start) if rule.whole else start
        system = _System(self.shape, start, outside, band)
        sure = samples.places.node & ~samples.shares
        sigma = np.where(sure, NODE_SIGMA_M, PLACE_SIGMA_M) * (1 + 100 * samples.places.sigma)
        system.add(samples.post, samples.weight, samples.places.height_m, sigma)
        if rule.one_post and isinstance(self.grid, ArcSeconds):
            post, road = self._one_posts(self.grid, samples.places)
            taken = system.knows(post)
            sigma = np.full(int(taken.sum()), ONE_POST_SIGMA_M)
            system.add(post[taken, None], np.ones((len(sigma), 1)), road[taken], sigma)
        near = band[distance[band] <= NEAREST_POSTINGS * max(self.apart_m)]
        wanted = samples.beside(start, near, nearest[near])
        system.add(near[:, None], np.ones((len(near), 1)), wanted, np.full(len(near), NEAREST_SIGMA_M))
        height = outside.copy()
        height[band] = system.solution(samples.post if rule.whole else None)
        return Block(height.reshape(self.shape), change.reshape(self.shape))

    def _one_posts(self, grid: ArcSeconds, places: Places) -> tuple[Ints, Floats]:
        """Posts (k,) by number that stand for nodes of roads, and the heights of these nodes."""
        nodes = places.take(places.node)
        u, v = grid.one_post(nodes.lon_deg, nodes.lat_deg)
        column, row = (u - self.columns.start).astype(np.int64), (v - self.rows.start).astype(np.int64)
        inside = (column >= 0) & (row >= 0) & (column < self.shape[1]) & (row < self.shape[0])
        return (row * self.shape[1] + column)[inside], nodes.height_m[inside]

    def _samples(self, roads: RoadHeights, rule: Rule) -> _Samples:
        places = places_along(roads, min(self.apart_m) / PLACES_A_POSTING)
        u, v = self.grid.coordinates(places.lon_deg, places.lat_deg)
        u, v = u - self.columns.start, v - self.rows.start
        rows, columns = self.shape
        inside = (u >= 0) & (v >= 0) & (u < columns - 1) & (v < rows - 1)
        places, u, v = places.take(inside), u[inside], v[inside]
        x, y = u * self.apart_m[0], v * self.apart_m[1]
        upper, shared = rule.levels is Levels.UPPER, rule.levels is Levels.SHARED
        loses = structures_that_lose(places, x, y, max(self.apart_m), upper=upper)
        keep = ~loses | shared
        places, u, v, x, y, shares = places.take(keep), u[keep], v[keep], x[keep], y[keep], loses[keep]
        left, top = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
        a, b = u - left, v - top
        first = top * columns + left
        post = first[:, None] + np.array([0, 1, columns, columns + 1])
        weight = np.column_stack([(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b])
        return _Samples(post, weight, x, y, places, shares)

    def _nearest(self, samples: _Samples, within_m: float) -> tuple[Floats, Ints]:
        """For each post (n,) how far the nearest place is, infinite beyond ``within_m``, and its number."""
        rows, columns = self.shape
        y, x = np.divmod(np.arange(rows * columns), columns)
        tree = KDTree(np.column_stack([samples.x_m, samples.y_m]))
        # A place's own posts are always among them, however short the distance is.
        reach = max(within_m, 1.01 * float(np.hypot(*self.apart_m)))
        posts = np.column_stack([x * self.apart_m[0], y * self.apart_m[1]])
        distance, nearest = tree.query(posts, distance_upper_bound=reach)
        return np.asarray(distance), np.asarray(nearest)


class _System:
    """Normal equations of the corrections of the posts in the band; what is added to them are heights."""

    def __init__(self, shape: tuple[int, int], start_m: Floats, outside_m: Floats, band: Ints) -> None:
        void = np.isnan(start_m)
        self._base = np.where(void, 0.0, start_m)
        self._base_of_band = self._base[band]
        self._row = np.full(len(start_m), -1)
        self._row[band] = np.arange(len(band))
        self._matrix = sparse.csr_matrix((len(band), len(band)))
        self._right = np.zeros(len(band))
        for i, j in _neighbours(shape):
            self._add_steps(i, j, void, outside_m)

    def add(self, post: Ints, weight: Floats, height_m: Floats, sigma_m: Floats) -> None:
        """Weighted sums of posts (m, k) are ``height_m``, within ``sigma_m`` (m,)."""
        m, k = post.shape
        row = np.repeat(np.arange(m), k)
        values = (weight / sigma_m[:, None]).ravel()
        a = sparse.csr_matrix((values, (row, self._row[post].ravel())), shape=(m, len(self._right)))
        misfit = (height_m - (weight * self._base[post]).sum(axis=1)) / sigma_m
        self._matrix = self._matrix + a.T @ a
        self._right += a.T @ misfit

    def knows(self, post: Ints) -> Bools:
        """Whether posts (m,) are in the band."""
        return np.asarray(self._row[post] >= 0)

    def solution(self, cells: Ints | None) -> Floats:
        """Heights of the posts in the band; whole ones where ``cells``, four posts each, are given."""
        options = {"SymmetricMode": True}
        factor = splu(
            self._matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options
        )
        found = factor.solve(self._right)
        if cells is not None:
            found = whole_metres(self._matrix, self._right, found, self._base_of_band, self._row[cells])
        return np.asarray(self._base_of_band + found)

    def _add_steps(self, i: Ints, j: Ints, void: Bools, outside_m: Floats) -> None:
        """Corrections of neighbours (m,) differ little; heights do where one of them is a void of the model."""
        a, b = self._row[i], self._row[j]
        void_step = void[i] | void[j]
        known = ~((a < 0) & void[i]) & ~((b < 0) & void[j]) & ((a >= 0) | (b >= 0))
        i, j, a, b, void_step = i[known], j[known], a[known], b[known], void_step[known]
        # c_i - c_j = wanted, where c of a post outside of the band is what rounding did to it
        wanted = np.where(void_step, self._base[j] - self._base[i], 0.0)
        wanted -= np.where(a < 0, np.nan_to_num(outside_m[i]) - self._base[i], 0.0)
        wanted += np.where(b < 0, np.nan_to_num(outside_m[j]) - self._base[j], 0.0)
        n, w = len(self._right), STEP_SIGMA_M**-2
        for one, other, sign in ((a, b, 1.0), (b, a, -1.0)):
            mine = one >= 0
            self._right += np.bincount(one[mine], w * sign * wanted[mine], n)
            self._matrix = self._matrix + sparse.diags(np.bincount(one[mine], minlength=n) * w, format="csr")
            both = mine & (other >= 0)
            pairs = (np.full(int(both.sum()), -w), (one[both], other[both]))
            self._matrix = self._matrix + sparse.csr_matrix(pairs, shape=(n, n))


def _neighbours(shape: tuple[int, int]) -> tuple[tuple[Ints, Ints], tuple[Ints, Ints]]:
    """Posts beside each other, and one above the other, by number."""
    number = np.arange(shape[0] * shape[1]).reshape(shape)
    return (
        (number[:, :-1].ravel(), number[:, 1:].ravel()),
        (number[:-1].ravel(), number[1:].ravel()),
    )
