"""A dense reference for the network adjustment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from factor_support import PLANE
from fusion.network import adjust as tuned
from fusion.network import curve as knots
from fusion.network import joints as turns
from fusion.network.curve import interval_count, slope_row, variable_count
from fusion.network.evidence import SegmentEvidence
from fusion.roads.table import RoadTable


class DenseAdjustment:
    """The same model as ``fusion.network.adjust``, written down equation by equation and solved densely.

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
                self._observe({at + 1: 1.0}, 0.0, tuned.GRADE_PRIOR_SIGMA)
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
            if self.table.bridge[row] or self.table.tunnel[row]:
                usual *= tuned.STRUCTURE_FACTOR
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
            spread = np.sqrt(w @ self.covariance[np.ix_(at, at)] @ w) * (
                1.0 if one is None else one.birge_ratio
            )
            slope.append(100 * float(w @ self.solution[at]))
            sigma.append(float(np.hypot(100 * spread, tuned.SIGMA_FLOOR_PERCENT)))
        return np.array(slope), np.array(sigma)
