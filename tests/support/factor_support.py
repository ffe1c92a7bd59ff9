"""Small road networks, passes over them made up from what they are to say, and a dense reference for the adjustment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from fusion import knots
from fusion import network_adjustment as tuned
from fusion import node_couplings as turns
from fusion.evidence import SegmentEvidence
from fusion.factors import PassFactor
from fusion.frames import LocalProjection
from fusion.knots import grade_rows, height_rows, interval_count, slope_row, smoothness, variable_count
from fusion.roads.table import RoadTable

PLANE = LocalProjection(8.5, 49.0)
ROUGHNESS = 3e-5
Height = Callable[[int, np.ndarray], np.ndarray]
"""Height of a row at distances along it, metres."""


def roads(
    points: Mapping[int, tuple[float, float]], edges: Sequence[tuple[int, int]], **columns: object
) -> RoadTable:
    """A table of the edges between numbered points (metres east, north), in the order given: one way an edge."""
    ends = np.array([[*points[a], *points[b]] for a, b in edges], float).reshape(-1, 4)
    lon0, lat0 = PLANE.to_lonlat(ends[:, 0], ends[:, 1])
    lon1, lat1 = PLANE.to_lonlat(ends[:, 2], ends[:, 3])
    n = len(edges)
    whole = {
        "osm_way_id": np.arange(1, n + 1),
        "from_node": [a for a, _ in edges],
        "to_node": [b for _, b in edges],
        "lon0_deg": lon0,
        "lat0_deg": lat0,
        "lon1_deg": lon1,
        "lat1_deg": lat1,
        "oneway": np.zeros(n),
        "bridge": np.zeros(n, bool),
        "tunnel": np.zeros(n, bool),
        "layer": np.zeros(n),
        "highway": ["residential"] * n,
        "name": [None] * n,
    }
    return RoadTable.from_columns(**(whole | columns))  # type: ignore[arg-type]


def street(*lengths_m: float, **columns: object) -> RoadTable:
    """A straight street eastwards, of segments of these lengths; nodes 0, 1, 2 ..."""
    east = np.concatenate([[0.0], np.cumsum(lengths_m)])
    edges = [(k, k + 1) for k in range(len(lengths_m))]
    return roads({k: (float(x), 0.0) for k, x in enumerate(east)}, edges, **columns)


def block_of_streets(width: int, height: int, side_m: float = 60.0) -> RoadTable:
    """A grid of streets, drawn in either direction by turns."""
    number = {(x, y): x + width * y for x in range(width) for y in range(height)}
    points = {k: (side_m * x, 1.1 * side_m * y) for (x, y), k in number.items()}
    across = [(number[x, y], number[x + 1, y]) for x in range(width - 1) for y in range(height)]
    down = [(number[x, y], number[x, y + 1]) for x in range(width) for y in range(height - 1)]
    edges = [(b, a) if k % 3 == 0 else (a, b) for k, (a, b) in enumerate(across + down)]
    return roads(points, edges)


def lone_slope(length: float, information: np.ndarray, vector: np.ndarray) -> tuple[float, float]:
    """Slope (%) and sigma over the own segment, its variables last, if hardly anything else is known."""
    own = int(variable_count(length))
    total = information + 1e-7 * np.eye(len(vector))
    total[-own:, -own:] += smoothness(length, 1e-3)
    row = np.zeros(len(vector))
    row[-own:] = slope_row(0.0, length, length)
    solved = np.linalg.solve(total, np.column_stack([row, vector]))
    return 100 * float(row @ solved[:, 1]), 100 * float(np.sqrt(row @ solved[:, 0]))


def factor_from(
    table: RoadTable,
    segments: Sequence[int],
    information: np.ndarray,
    vector: np.ndarray,
    *,
    part: tuple[float, float] | None = None,
    roughness: float = ROUGHNESS,
    observations: int = 5,
) -> PassFactor:
    """A pass with this likelihood over the last of ``segments``."""
    length = float(table.length_m[segments[-1]])
    start, end = part or (0.0, length)
    return PassFactor(
        tuple(segments), information, vector, *lone_slope(length, information, vector), start, end, roughness,
        observations, 1.7e9, 1.7e9 + 5.0,
    )  # fmt: skip


def graded(
    table: RoadTable,
    row: int,
    grades: Callable[[np.ndarray], np.ndarray],
    sigma: float,
    rng: np.random.Generator | None = None,
    *,
    part: tuple[float, float] | None = None,
    every_m: float = 8.0,
    **more: float,
) -> PassFactor:
    """A pass that measured the grade (1) every few metres; the noise is drawn from ``rng``, or there is none."""
    length = float(table.length_m[row])
    start, end = part or (0.0, length)
    count = max(2, int((end - start) / every_m))
    at = start + (end - start) * (np.arange(count) + 0.5) / count
    value = grades(at) + (0.0 if rng is None else sigma * rng.normal(size=count))
    rows = grade_rows(at, length)
    return factor_from(
        table,
        (row,),
        rows.T @ rows / sigma**2,
        rows.T @ value / sigma**2,
        part=part,
        observations=count,
        **more,
    )


def steady(
    table: RoadTable, row: int, slope_percent: float, sigma: float = 0.01, **more: float
) -> PassFactor:
    """A pass that measured the same grade everywhere, without noise."""
    return graded(table, row, lambda at: np.full(len(at), slope_percent / 100), sigma, **more)  # type: ignore[arg-type]


def levelled(
    table: RoadTable,
    segments: Sequence[int],
    height: Height,
    sigma_m: float,
    rng: np.random.Generator | None = None,
    every_m: float = 10.0,
) -> PassFactor:
    """A pass that measured heights from an unknown level along ``segments``, in driving order.

    The factor is what its last segment adds to what was measured on those before, as Vecchia's approximation has it.
    """
    parts = []
    for row in segments:
        length = float(table.length_m[row])
        at = np.linspace(0.0, length, max(2, int(length / every_m)))
        noise = 0.0 if rng is None else sigma_m * rng.normal(size=len(at))
        parts.append((height_rows(at, length), height(row, at) + noise))
    whole = _unlevelled(parts, sigma_m)
    before = _unlevelled(parts[:-1], sigma_m) if len(parts) > 1 else (np.zeros((0, 0)), np.zeros(0))
    information, vector = whole[0].copy(), whole[1].copy()
    size = len(before[1])
    information[:size, :size] -= before[0]
    vector[:size] -= before[1]
    return factor_from(table, segments, information, vector)


def _unlevelled(
    parts: Sequence[tuple[np.ndarray, np.ndarray]], sigma_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Information and vector of stacked height measurements whose common level is unknown."""
    size = sum(rows.shape[1] for rows, _ in parts)
    rows, offset = np.zeros((sum(len(v) for _, v in parts), size)), 0
    at = 0
    for block, values in parts:
        rows[at : at + len(values), offset : offset + block.shape[1]] = block
        at, offset = at + len(values), offset + block.shape[1]
    value = np.concatenate([v for _, v in parts])
    rows, value = rows - rows.mean(axis=0), value - value.mean()  # a flat level takes the mean away
    return rows.T @ rows / sigma_m**2, rows.T @ value / sigma_m**2


def evidence_of(factors: Sequence[PassFactor]) -> dict[int, SegmentEvidence]:
    """Evidence by own segment, keys in the order given."""
    passes: dict[int, list[tuple[int, PassFactor]]] = {}
    for key, factor in enumerate(factors):
        passes.setdefault(factor.segments[-1], []).append((key, factor))
    return {row: SegmentEvidence.build(keyed) for row, keyed in passes.items()}


def in_rows(table: RoadTable, factors: Sequence[PassFactor]) -> list[SegmentEvidence | None]:
    """The same as a list over the table's rows."""
    known = evidence_of(factors)
    return [known.get(row) for row in range(len(table))]


def unknown(table: RoadTable) -> np.ndarray:
    """DEM slopes where there is no DEM."""
    return np.full(len(table), np.nan)


class DenseAdjustment:
    """The same model as ``fusion.network_adjustment``, written down equation by equation and solved densely.

    Every rule is restated here from the docstrings, so that a slip there does not repeat itself here; only the numbers
    that are a matter of tuning are the module's.
    """

    def __init__(
        self,
        table: RoadTable,
        evidence: Sequence[SegmentEvidence | None],
        dem_slope_percent: np.ndarray,
        ids: Sequence[int] | None = None,
    ) -> None:
        self.table, self.evidence = table, evidence
        self.length = np.maximum(table.length_m, knots.SHORTEST_M)
        self.nodes = sorted({*table.from_node.tolist(), *table.to_node.tolist()})
        self.first: list[int] = []
        size = len(self.nodes)
        for length in self.length:
            self.first.append(size)
            size += int(variable_count(length))
        self.fixed, self.vector = np.zeros((size, size)), np.zeros(size)
        self._nodes()
        self._grades_go_on()
        self._terrain(dem_slope_percent)
        for row in range(len(table)):
            for at in self._knots(row):
                self._observe({at + 1: 1.0}, 0.0, tuned.STEEPEST)
        row_of = {int(i): row for row, i in enumerate(range(len(table)) if ids is None else ids)}
        for one in evidence:
            for history, (information, vector) in () if one is None else one.groups.items():
                self._factor([row_of.get(i) for i in history], information, vector)
        self._solve()

    def _knots(self, row: int) -> list[int]:
        """Where the heights of the knots stand; the grade is the next."""
        return [self.first[row] + 2 * j for j in range(int(interval_count(self.length[row])) + 1)]

    def _observe(self, weights: Mapping[int, float], value: float, sigma: float) -> None:
        at, w = list(weights), np.array(list(weights.values()))
        self.fixed[np.ix_(at, at)] += np.outer(w, w) / sigma**2
        self.vector[at] += w * value / sigma**2

    def _ends(self) -> list[tuple[int, int, int, float, np.ndarray]]:
        """Each end of each segment: node, row, height unknown, sign of the grade and unit vector away from the node."""
        t, out = self.table, []
        x0, y0 = PLANE.to_xy(t.lon0_deg, t.lat0_deg)
        x1, y1 = PLANE.to_xy(t.lon1_deg, t.lat1_deg)
        for row in range(len(t)):
            along = np.array([x1[row] - x0[row], y1[row] - y0[row]])
            along /= np.hypot(*along)
            heights = self._knots(row)
            out.append((int(t.from_node[row]), row, heights[0], 1.0, along))
            out.append((int(t.to_node[row]), row, heights[-1], -1.0, -along))
        return out

    def _nodes(self) -> None:
        for node, _, height, _, _ in self._ends():
            self._observe({self.nodes.index(node): -1.0, height: 1.0}, 0.0, tuned.NODE_SIGMA_M)

    def _grades_go_on(self) -> None:
        for node in self.nodes:
            ends = [end for end in self._ends() if end[0] == node]
            for k, (_, row_a, height_a, sign_a, away_a) in enumerate(ends):
                for _, row_b, height_b, sign_b, away_b in ends[k + 1 :]:
                    turned = 1 + float(away_a @ away_b)  # 1 minus the cosine of the turn
                    level, turn = turns.PLAIN_SIGMA, turns.TURN_SIGMA
                    if len(ends) > 2:
                        level, turn = turns.JUNCTION_SIGMA, turns.JUNCTION_TURN_SIGMA
                    kinds = {(bool(self.table.bridge[r]), bool(self.table.tunnel[r])) for r in (row_a, row_b)}
                    ramp = turns.STRUCTURE_SIGMA if len(kinds) > 1 else 0.0
                    sigma = float(np.linalg.norm([level, turn * turned, ramp]))
                    # Uphill away from the node on one side is downhill away from it on the other.
                    self._observe({height_a + 1: sign_a, height_b + 1: sign_b}, 0.0, sigma)

    def _terrain(self, slope_percent: np.ndarray) -> None:
        t = self.table
        structure = t.bridge | t.tunnel
        spoilt = {*t.from_node[structure].tolist(), *t.to_node[structure].tolist()}
        for row, length in enumerate(self.length):
            if not np.isfinite(slope_percent[row]) or {int(t.from_node[row]), int(t.to_node[row])} & spoilt:
                continue
            posts = tuned.DEM_LENGTH_M / length
            sigma = tuned.DEM_SIGMA_PERCENT / 100 * (posts if posts < 1 else np.sqrt(posts))
            heights = self._knots(row)
            self._observe({heights[0]: -1 / length, heights[-1]: 1 / length}, slope_percent[row] / 100, sigma)

    def _factor(self, rows: list[int | None], information: np.ndarray, vector: np.ndarray) -> None:
        if rows[-1] is None:
            return
        if None in rows:
            own = int(variable_count(self.length[rows[-1]]))
            gone, kept = slice(0, len(vector) - own), slice(len(vector) - own, None)
            share = information[kept, gone] @ np.linalg.pinv(
                information[gone, gone], rcond=1e-12, hermitian=True
            )
            vector = vector[kept] - share @ vector[gone]
            information = information[kept, kept] - share @ information[gone, kept]
            rows = [rows[-1]]
        at = np.concatenate(
            [self.first[r] + np.arange(int(variable_count(self.length[r]))) for r in rows if r is not None]
        )
        self.fixed[np.ix_(at, at)] += information
        self.vector[at] += vector

    def _smooth(self) -> list[tuple[list[int], np.ndarray, float]]:
        """Each interval's unknowns, its information for q = 1, and the usual q."""
        out = []
        for row, length in enumerate(self.length):
            one = self.evidence[row]
            learned = tuned.DEFAULT_ROUGHNESS if one is None else one.roughness
            usual = tuned.ROUGHNESS_FACTOR * float(np.clip(learned, *tuned.ROUGHNESS_BOUNDS))
            at_knots = self._knots(row)
            d = length / (len(at_knots) - 1)
            walk = np.array([[d**3 / 3, d**2 / 2], [d**2 / 2, d]])
            step = np.array([[-1.0, -d, 1.0, 0.0], [0.0, -1.0, 0.0, 1.0]])
            unit = step.T @ np.linalg.inv(walk) @ step
            out += [([a, a + 1, a + 2, a + 3], unit, usual) for a in at_knots[:-1]]
        return out

    def _solve(self) -> None:
        smooth = self._smooth()
        strength = [tuned.TAIL_START * usual for _, _, usual in smooth]
        for turn in range(tuned.TAIL_ROUNDS + 1):
            whole = self.fixed.copy()
            for (at, unit, _), q in zip(smooth, strength, strict=True):
                whole[np.ix_(at, at)] += unit / q
            # The level: any height will do, and how firmly it is held does not matter to slopes.
            for members in self._parts(whole):
                whole[members[-2], members[-2]] += 1.0
            self.covariance = np.linalg.inv(whole)
            self.solution = self.covariance @ self.vector
            if turn < tuned.TAIL_ROUNDS:
                for k, (at, unit, usual) in enumerate(smooth):
                    x = self.solution[at]
                    change = x @ unit @ x + np.trace(unit @ self.covariance[np.ix_(at, at)])
                    strength[k] = (tuned.TAIL_FREEDOM * usual + change) / (tuned.TAIL_FREEDOM + 2)

    @staticmethod
    def _parts(matrix: np.ndarray) -> list[list[int]]:
        left, parts = set(range(len(matrix))), []
        while left:
            found, fresh = set(), {min(left)}
            while fresh:
                found |= fresh
                fresh = {int(j) for i in fresh for j in np.flatnonzero(matrix[i])} - found
            parts.append(sorted(found))
            left -= found
        return parts

    def slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Slope and sigma of every row, percent."""
        slope, sigma = [], []
        for row, length in enumerate(self.length):
            one = self.evidence[row]
            start, end = (0.0, length) if one is None else (max(0.0, v) for v in one.driven)
            end = min(end, length)
            if end - start < min(1.0, 0.5 * length):
                start, end = 0.0, length
            w = slope_row(start, end, length)
            at = self.first[row] + np.arange(len(w))
            spread = np.sqrt(w @ self.covariance[np.ix_(at, at)] @ w) * (1.0 if one is None else one.scatter)
            slope.append(100 * float(w @ self.solution[at]))
            sigma.append(float(np.hypot(100 * spread, tuned.FLOOR_PERCENT)))
        return np.array(slope), np.array(sigma)
