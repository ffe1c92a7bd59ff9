# mypy: disable-error-code="arg-type"
"""Small road networks, and passes over them made up from what they are to say, with honest errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fusion.frames import LocalProjection
from fusion.network.curve import grade_rows, height_rows, knot_length, variable_count
from fusion.network.pass_factor import BIAS, EAST, ENTRY, EXIT, LAG, MOUNT, NORTH, NUISANCES, PassFactor
from fusion.roads.table import RoadTable

PLANE = LocalProjection(8.5, 49.0)
ROUGHNESS = 3e-5
Profile = Callable[[int, np.ndarray], np.ndarray]
"""Height (m) or grade (1) of a row at distances along it, metres from from_node."""
START_S = 1.7e9
SPEED_MPS = 10.0
POSITION_SIGMA_M = 3.0


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
    return RoadTable.from_columns(**(whole | columns))


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


def pass_of(
    table: RoadTable, row: int, information: np.ndarray, vector: np.ndarray, square: float, **more: object
) -> PassFactor:
    """A pass over the whole of a row with this likelihood; ``more`` are fields that are not an ordinary pass's."""
    length = float(knot_length(table.length_m[row]))
    said: dict[str, object] = {
        "segment": row, "sequence": 0, "mount": 0, "rows": 5, "walk_m2_per_s": (0.1, 0.01), "start_m": 0.0,
        "end_m": length, "roughness": ROUGHNESS, "observations": 5, "first_time_s": START_S,
        "last_time_s": START_S + length / SPEED_MPS,
    }  # fmt: skip
    return PassFactor(information=information, vector=vector, square=square, **(said | more))


def graded(
    table: RoadTable,
    row: int,
    grades: Callable[[np.ndarray], np.ndarray],
    sigma: float,
    rng: np.random.Generator | None = None,
    *,
    part: tuple[float, float] | None = None,
    every_m: float = 8.0,
    **more: object,
) -> PassFactor:
    """A pass that measured the grade (1) every few metres; the noise is drawn from ``rng``, or there is none.

    Nothing that the drive carries along is in it.
    """
    length = float(knot_length(table.length_m[row]))
    start, end = part or (0.0, length)
    count = max(2, int((end - start) / every_m))
    at = start + (end - start) * (np.arange(count) + 0.5) / count
    value = grades(at) + (0.0 if rng is None else sigma * rng.normal(size=count))
    design = np.hstack([grade_rows(at, length), np.zeros((count, NUISANCES))])
    likelihood = integrated(design, value, np.full(count, sigma), design.shape[1])
    said = {"start_m": start, "end_m": end, "rows": count, "observations": count}
    return pass_of(table, row, *likelihood, **(said | more))


def steady(
    table: RoadTable, row: int, slope_percent: float, sigma: float = 0.01, **more: object
) -> PassFactor:
    """A pass that measured the same grade everywhere, without noise."""
    return graded(table, row, lambda at: np.full(len(at), slope_percent / 100), sigma, **more)


@dataclass(frozen=True)
class Sensors:
    """What a vehicle of ``driven`` carries: one sigma of each error (NaN: it has no such sensor), and what it hides.

    ``doppler``, ``pitch``, ``force``: grades; ``altitude_m``, ``pressure_m``: white errors of heights, which walk
    besides by ``walk_m2_per_s``. ``mount``, ``bias``: of every pitch and every force; ``lag_s``: of the altitudes;
    ``farther_m``: of all positions, to the east, where every street leads (0: they are known to be right).
    """

    doppler: float = 0.02
    pitch: float = np.nan
    force: float = np.nan
    altitude_m: float = np.nan
    pressure_m: float = np.nan
    walk_m2_per_s: tuple[float, float] = (0.1, 0.01)
    mount: float = 0.0
    bias: float = 0.0
    lag_s: float = np.nan
    farther_m: float = 0.0
    speed_mps: float = SPEED_MPS
    every_m: float = 8.0


def driven(
    table: RoadTable,
    rows: Sequence[int],
    height: Profile,
    sensors: Sensors,
    rng: np.random.Generator,
    begin_s: float = START_S,
) -> list[PassFactor]:
    """The passes of one drive over ``rows`` of a table, from_node to to_node, as its likelihood has it.

    Within a pass the errors of heights walk from the entry over the measurements to the exit, and what they were in
    between is integrated out; from pass to pass they walk for a second more.
    """
    error = np.array([20.0, 80.0]) * rng.normal(size=2)
    out, time = [], begin_s
    for number, row in enumerate(rows):
        length = float(knot_length(table.length_m[row]))
        count = max(2, int(length / sensors.every_m))
        at = length * (np.arange(count) + 0.5) / count
        slopes = _slopes(row, at, length, height, sensors, rng)
        heights, error = _heights(row, at, length, height, sensors, error, rng)
        parts = [*slopes, *heights]
        design, value, sigma = (np.concatenate(column) for column in zip(*parts, strict=True))
        end = time + length / sensors.speed_mps
        out.append(
            pass_of(
                table, row, *integrated(design, value, sigma, design.shape[1] - 2 * count),
                rows=(len(slopes) + len(heights) // 2) * count, observations=count, sequence=number,
                walk_m2_per_s=sensors.walk_m2_per_s, first_time_s=time, last_time_s=end,
            )
        )  # fmt: skip
        error = error + np.sqrt(sensors.walk_m2_per_s) * rng.normal(size=2)
        time = end
    return out


Rows = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Design, values and sigmas of measurements; behind knots and nuisances stand each height sensor's errors at ``at``."""


def _slopes(
    row: int, at: np.ndarray, length: float, height: Profile, sensors: Sensors, rng: np.random.Generator
) -> list[Rows]:
    out: list[Rows] = []
    count, knots = len(at), int(variable_count(length))
    for level, hidden, constant in (
        (sensors.doppler, 0.0, None),
        (sensors.pitch, sensors.mount, MOUNT),
        (sensors.force, sensors.bias, BIAS),
    ):
        if np.isfinite(level):
            design = np.zeros((count, knots + NUISANCES + 2 * count))
            design[:, :knots] = grade_rows(at, length)
            if constant is not None:
                design[:, knots + constant] = 1.0
            value = true_grade(height, row, at) + hidden + level * rng.normal(size=count)
            design[:, knots + EAST] = POSITION_SIGMA_M * true_bend(height, row, at) * bool(sensors.farther_m)
            value = value + design[:, knots + EAST] * sensors.farther_m / POSITION_SIGMA_M
            out.append((design, value, np.full(count, level)))
    return out


def _heights(
    row: int,
    at: np.ndarray,
    length: float,
    height: Profile,
    sensors: Sensors,
    error: np.ndarray,
    rng: np.random.Generator,
) -> tuple[list[Rows], np.ndarray]:
    """Measurements, then the steps of the error, for each sensor; and the errors at the exit."""
    out: list[Rows] = []
    count, knots, leave = len(at), int(variable_count(length)), error.copy()
    apart_s = np.diff(np.concatenate([[0.0], at, [length]])) / sensors.speed_mps
    for s, level in enumerate((sensors.altitude_m, sensors.pressure_m)):
        if not np.isfinite(level):
            continue
        spread = np.sqrt(sensors.walk_m2_per_s[s] * apart_s)
        walk = error[s] + np.cumsum(spread * rng.normal(size=count + 1))
        leave[s] = walk[-1]
        mine = knots + NUISANCES + s * count + np.arange(count)
        design = np.zeros((count, knots + NUISANCES + 2 * count))
        design[:, :knots] = height_rows(at, length)
        design[np.arange(count), mine] = 1.0
        value = height(row, at) + walk[:-1] + level * rng.normal(size=count)
        if s == 0 and np.isfinite(sensors.lag_s):
            design[:, knots + LAG] = -true_grade(height, row, at) * sensors.speed_mps
            value = value + design[:, knots + LAG] * sensors.lag_s
        design[:, knots + EAST] = POSITION_SIGMA_M * true_grade(height, row, at) * bool(sensors.farther_m)
        value = value + design[:, knots + EAST] * sensors.farther_m / POSITION_SIGMA_M
        chain = np.concatenate([[knots + ENTRY.start + s], mine, [knots + EXIT.start + s]])
        steps = np.zeros((count + 1, design.shape[1]))
        steps[np.arange(count + 1), chain[:-1]] -= 1.0
        steps[np.arange(count + 1), chain[1:]] += 1.0
        out += [(design, value, np.full(count, level)), (steps, np.zeros(count + 1), spread)]
    return out, leave


def true_grade(height: Profile, row: int, at: np.ndarray, step_m: float = 0.01) -> np.ndarray:
    """The derivative of a profile."""
    return (height(row, at + step_m) - height(row, at - step_m)) / (2 * step_m)


def true_bend(height: Profile, row: int, at: np.ndarray, step_m: float = 0.1) -> np.ndarray:
    """The derivative of its grade, 1/m."""
    bend: np.ndarray = (height(row, at + step_m) + height(row, at - step_m) - 2 * height(row, at)) / step_m**2
    return bend


def integrated(
    design: np.ndarray, value: np.ndarray, sigma: np.ndarray, kept: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """Information, vector and square over the first ``kept`` unknowns, the others integrated out (flat priors).

    Of those, the ones that nothing speaks of are left alone.
    """
    scaled = design / sigma[:, None]
    whole, right = scaled.T @ scaled, scaled.T @ (value / sigma)
    square = float(np.sum(np.square(value / sigma)))
    gone = kept + np.flatnonzero(np.diagonal(whole)[kept:])
    inner = np.linalg.inv(whole[np.ix_(gone, gone)])
    share = whole[:kept, gone] @ inner
    return (
        whole[:kept, :kept] - share @ whole[gone, :kept],
        right[:kept] - share @ right[gone],
        square - float(right[gone] @ inner @ right[gone]),
    )


def without_place(one: PassFactor) -> PassFactor:
    """The pass as if its positions were known to be right: their errors are 0."""
    at = len(one.vector) - NUISANCES + np.array([EAST, NORTH])
    information, vector = one.information.copy(), one.vector.copy()
    information[at] = 0.0
    information[:, at] = 0.0
    vector[at] = 0.0
    return replace(one, information=information, vector=vector)
