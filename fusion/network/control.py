"""Surveyed heights: points whose height is known from elsewhere, read from a file and put onto the roads.

Each is an equation on the knots of the nearest segment. Surveys contradict each other by their datums, their age and
their slips of the pen, so points have heavy tails (Student's t). Drives are not known here.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusion.arrays import ColumnTable
from fusion.errors import ControlError
from fusion.frames import METRES_PER_DEGREE, SHORTEST_DEGREE_M
from fusion.messages import say
from fusion.network.curve import height_variance, height_weights
from fusion.network.equations import Blocks, Solution
from fusion.network.unknowns import RoadUnknowns
from fusion.roads.table import RoadTable
from fusion.types import Bools, Floats, Ints

DEFAULT_SIGMA_M = 0.1
"""Of a point that states none: a benchmark is good to centimetres, and lies on a kerb or a wall, 0.1 m off the lane."""
REACH_M = 20.0
"""A point is a road's that lies no farther from it."""
CONTROL_FREEDOM = 2.0
"""Degrees of freedom of the points' errors, as of the nodes' (``road_beliefs.NODE_FREEDOM``)."""
START_FACTOR = 10.0
"""The first round takes sigmas for so much larger: points that contradict each other are weighed before they tear the
road apart."""
CONTRADICTED_SIGMAS = 4.0
"""Points that miss the solution by more of their sigmas are named to the person who gave them."""

_REQUIRED = ("lat_deg", "lon_deg", "height_m")
_BOUNDS = {
    "lat_deg": (-90.0, 90.0),
    "lon_deg": (-180.0, 180.0),
    "height_m": (-1000.0, 10_000.0),
    "sigma_m": (1e-3, 100.0),
}


@dataclass(frozen=True)
class ControlPoint:
    """A place on WGS 84 whose height is known, above the datum that the drives' altitudes use; one sigma."""

    lon_deg: float
    lat_deg: float
    height_m: float
    sigma_m: float = DEFAULT_SIGMA_M
    name: str = ""
    """Its line in the file that it came from"""

    @property
    def called(self) -> str:
        """How it is named when something is said of it."""
        return self.name or f"at {self.lat_deg:.6f}, {self.lon_deg:.6f}"


def read_control(path: Path) -> list[ControlPoint]:
    """The points of a CSV file with a header: ``lat_deg``, ``lon_deg``, ``height_m``, and ``sigma_m`` if known.

    Other columns are passed over. Raises ``ControlError`` that names the line, ``OSError`` where it cannot be read.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise ControlError(say("control.no_text", file=path.name)) from None
    rows = csv.reader(lines)
    header = [name.strip() for name in next(rows, [])]
    missing = [name for name in _REQUIRED if name not in header]
    if missing:
        raise ControlError(
            say("control.header", file=path.name, missing=", ".join(missing)),
            where="line 1",
        )
    return [
        _point(path, rows.line_num, dict(zip(header, cells, strict=False)))
        for cells in rows
        if any(cell.strip() for cell in cells)
    ]


def _point(path: Path, line: int, cells: dict[str, str]) -> ControlPoint:
    values: dict[str, float] = {}
    for name, (low, high) in _BOUNDS.items():
        text = cells.get(name, "").strip()
        if not text and name == "sigma_m":
            continue
        try:
            values[name] = float(text)
        except ValueError:
            raise ControlError(
                say("control.no_number", line=line, file=path.name, column=name, text=text),
                where=say("place.line", n=line),
            ) from None
        if not low <= values[name] <= high:
            raise ControlError(
                say(
                    "control.out_of_range",
                    line=line,
                    file=path.name,
                    column=name,
                    text=text,
                    low=low,
                    high=high,
                ),
                where=say("place.line", n=line),
            )
    return ControlPoint(**values, name=f"line {line} of {path.name}")


@dataclass(frozen=True, eq=False)
class ControlHeights(ColumnTable):
    """Heights of m places on roads, columns (m,): ``row`` of a road table, ``along_m`` from its from_node."""

    row: Ints
    along_m: Floats
    height_m: Floats
    sigma_m: Floats
    names: NDArray[np.str_]

    def among(self, kept: Bools) -> ControlHeights:
        """Those on rows that are ``kept`` (n,) of their table, for the table of these rows alone."""
        inside = self.take(kept[self.row])
        return replace(inside, row=(np.cumsum(kept) - 1)[inside.row])


def place(points: Sequence[ControlPoint], table: RoadTable) -> tuple[ControlHeights, list[ControlPoint]]:
    """The points on their nearest segments, in their order, and those that have none within ``REACH_M``."""
    placed: list[tuple[int, float, ControlPoint]] = []
    far = []
    for point in points:
        nearest = _nearest(point, table)
        if nearest is None:
            far.append(point)
        else:
            placed.append((*nearest, point))
    heights = ControlHeights(
        np.array([row for row, _, _ in placed], np.int64),
        np.array([along for _, along, _ in placed], float),
        np.array([point.height_m for _, _, point in placed], float),
        np.array([point.sigma_m for _, _, point in placed], float),
        np.array([point.called for _, _, point in placed], np.str_),
    )
    return heights, far


def _nearest(point: ControlPoint, table: RoadTable) -> tuple[int, float] | None:
    """Row and distance along it of the nearest place on a road within reach; of several the first row.

    On a plane that touches the earth at the point: over the reach it is right to a millimetre.
    """
    lon, lat = point.lon_deg, point.lat_deg
    to_m = METRES_PER_DEGREE * np.array([float(np.cos(np.radians(lat))), 1.0])
    near = np.flatnonzero(_reaches(table.lon0_deg, table.lon1_deg, lon, REACH_M / max(to_m[0], 1.0)))
    near = near[_reaches(table.lat0_deg[near], table.lat1_deg[near], lat, REACH_M / SHORTEST_DEGREE_M)]
    if not len(near):
        return None
    start = to_m * np.column_stack([table.lon0_deg[near] - lon, table.lat0_deg[near] - lat])
    step = to_m * np.column_stack([table.lon1_deg - table.lon0_deg, table.lat1_deg - table.lat0_deg])[near]
    share = -np.sum(start * step, axis=1) / np.maximum(np.sum(step**2, axis=1), 1e-12)
    share = np.clip(share, 0.0, 1.0)
    offset = np.linalg.norm(start + share[:, None] * step, axis=1)
    best = int(np.argmin(offset))
    if offset[best] > REACH_M:
        return None
    return int(near[best]), float(share[best] * table.length_m[near[best]])


def _reaches(one_deg: Floats, other_deg: Floats, at_deg: float, margin_deg: float) -> Bools:
    return np.asarray(
        (np.minimum(one_deg, other_deg) <= at_deg + margin_deg)
        & (np.maximum(one_deg, other_deg) >= at_deg - margin_deg),
        np.bool_,
    )


class ControlBeliefs:
    """What the points say of the knots: one equation each, weighed anew in rounds."""

    def __init__(self, unknowns: RoadUnknowns, control: ControlHeights, roughness: Floats) -> None:
        self.control = control
        length = unknowns.length_m[control.row]
        # On segments shorter than their knots assume, a place keeps its share of the length.
        self._first, self._weights = height_weights(control.along_m, length)
        self._variables = (unknowns.first[control.row] + self._first)[:, None] + np.arange(4)
        between = height_variance(control.along_m, length, roughness[control.row])
        self._variance = np.square(control.sigma_m) + between
        self.ties = Blocks.of_rows(self._variables, self._weights, control.height_m, self._variance)
        self.ties.weight = np.full(len(control), START_FACTOR**-2)

    def blocks(self) -> list[Blocks]:
        """All equations."""
        return [self.ties] if len(self.control) else []

    def learn(self, solution: Solution) -> None:
        """Weigh the points by how far the solution is from them; heavy tails tell less than Gaussian errors."""
        spread = np.einsum(
            "mi,mij,mj->m", self._weights, solution.equations.covariance(self._variables), self._weights
        )
        squares = (np.square(self.misfit_m(solution)) + np.maximum(spread, 0.0)) / self._variance
        weight = (CONTROL_FREEDOM + 1) / (CONTROL_FREEDOM + squares)
        self.ties.weight = weight * (CONTROL_FREEDOM + 1) / (CONTROL_FREEDOM + 3)

    def misfit_m(self, solution: Solution) -> Floats:
        """How far the solution lies above the points, (m,)."""
        return np.asarray(np.sum(self._weights * solution.x[self._variables], axis=1) - self.control.height_m)

    def remarks(self, solution: Solution) -> list[str]:
        """A sentence on each point that everything else contradicts."""
        misfit = self.misfit_m(solution)
        wrong = np.abs(misfit) > CONTRADICTED_SIGMAS * np.sqrt(self._variance)
        return [
            say("control.contradicted", name=name, off_m=abs(off), side="below" if off > 0 else "above")
            for name, off, bad in zip(self.control.names, misfit.tolist(), wrong.tolist(), strict=True)
            if bad
        ]
