#!/usr/bin/env python3
"""Our own sparse factorisation (``fusion.filters.sparse_inverse``) beside CHOLMOD, on the same normal equations.

    PYTHONPATH=.:benchmarks python benchmarks/factorisation.py [--roads FILE.osm.pbf] [--drives N] [--repeat N]
                                                               [--json FILE]

The equations are those of ``--drives`` made-up drives of 10 km through the map (``adjustment.py``), in the first round
of the network adjustment. CHOLMOD comes with the package ``cholespy`` (``pip install cholespy``), which nothing else of
Versant needs; without it the benchmark says so and ends. Each time is the median of ``--repeat`` runs, seconds of
processor time, all threads together.

    first       order, analysis, factor and solution of a matrix that was never seen: what CHOLMOD does here each time
    again       factor and solution of further values in the same pattern, as in all rounds but the first (ours alone:
                ``cholespy`` analyses anew)
    covariances the inverse at every pair of unknowns that share an equation. CHOLMOD gives columns of the inverse: its
                time is that of one solution times the number of unknowns, measured on ``COLUMNS`` of them
    apart       the largest difference of the two solutions, in sigmas of the unknowns, and of covariances, as a share
"""

from __future__ import annotations

import json
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import scipy

from accuracy.adjustment_drives import Synthetic
from accuracy.arguments import add_roads, parser_of
from adjustment import ROUTE_M, driven_rows, inside
from fusion.filters.sparse_inverse import Elimination, NormalEquations, fill_reducing_order
from fusion.network.drive_beliefs import DriveBeliefs
from fusion.network.equations import Blocks, right_hand_side
from fusion.network.pass_columns import PassColumns, in_order
from fusion.network.road_beliefs import RoadBeliefs
from fusion.network.subnetwork import gap_rows
from fusion.roads.osm import read_roads
from fusion.types import Floats

try:
    import cholespy
except ImportError:
    cholespy = None

COLUMNS = 20
MOST_APART = 1e-4
"""Sigmas, and share of a variance: rounding alone leaves less by far; farther apart, one of the two is wrong."""

T = TypeVar("T")


def equations(file: Path, count: int) -> tuple[scipy.sparse.csc_matrix, Floats]:
    """Matrix (n, n) and right-hand side (n,) of a network in which so many drives went."""
    roads = read_roads(file)
    synthetic = Synthetic(roads)
    drives = {k: synthetic.drive(synthetic.route(ROUTE_M)) for k in range(count)}
    driven = driven_rows(len(roads), drives)
    use = driven | gap_rows(roads, driven)
    passes = inside(drives, use)
    columns = PassColumns.of(passes)
    road = RoadBeliefs(roads.subset(use), columns)
    beliefs = DriveBeliefs(columns, road.unknowns, in_order(passes)[1])
    blocks = [b for b in (*road.blocks(), *beliefs.blocks()) if len(b.variables)]
    return _matrix(beliefs.size, blocks), right_hand_side(beliefs.size, blocks)


def _matrix(size: int, blocks: Sequence[Blocks]) -> scipy.sparse.csc_matrix:
    values = [(b.weight[:, None, None] * b.information).ravel() for b in blocks]
    rows = [np.broadcast_to(b.variables[:, :, None], b.information.shape).ravel() for b in blocks]
    columns = [np.broadcast_to(b.variables[:, None, :], b.information.shape).ravel() for b in blocks]
    places = np.concatenate(rows), np.concatenate(columns)
    return scipy.sparse.coo_matrix((np.concatenate(values), places), (size, size)).tocsc()


def timed(work: Callable[[], T], repeat: int) -> tuple[T, float]:
    """The result, and the median of seconds of processor time; a run before the first compiles and fills caches."""
    result, seconds = work(), []
    for _ in range(repeat):
        start = time.process_time()
        result = work()
        seconds.append(time.process_time() - start)
    return result, statistics.median(seconds)


def of_cholmod(matrix: scipy.sparse.csc_matrix) -> Callable[[Floats], Floats]:
    """A solver of the matrix by CHOLMOD."""
    start, index = matrix.indptr.astype(np.int32), matrix.indices.astype(np.int32)
    solver = cholespy.CholeskySolverD(len(start) - 1, start, index, matrix.data, cholespy.MatrixType.CSC)

    def solve(vector: Floats) -> Floats:
        out = np.zeros_like(vector)
        solver.solve(vector, out)
        return out

    return solve


def compare(matrix: scipy.sparse.csc_matrix, vector: Floats, repeat: int) -> dict[str, Any]:
    """The figures of both."""
    size = len(vector)
    ours, first_s = timed(lambda: NormalEquations.of(matrix).solve(vector), repeat)
    theirs, cholmod_first_s = timed(lambda: of_cholmod(matrix)(vector), repeat)
    how = Elimination(matrix, fill_reducing_order(matrix))
    _, again_s = timed(lambda: NormalEquations.of(matrix, how).solve(vector), repeat)
    normal = NormalEquations.of(matrix, how)
    _, inverse_s = timed(lambda: normal.set_border_covariance(np.empty((0, 0))), repeat)
    solve = of_cholmod(matrix)
    chosen = np.random.default_rng(1).choice(size, COLUMNS, replace=False)
    columns, columns_s = timed(lambda: [solve(np.eye(1, size, k)[0]) for k in chosen.tolist()], repeat)
    pairs = [(matrix.indices[matrix.indptr[k] : matrix.indptr[k + 1]], k) for k in chosen.tolist()]
    shares = [
        np.abs(
            normal.covariance(np.column_stack([near, np.full(len(near), k)]))[:, 0, 1] - column[near]
        ).max()
        / column[k]
        for (near, k), column in zip(pairs, columns, strict=True)
    ]
    sigma = np.sqrt(normal.covariance(np.arange(size)[:, None])[:, 0, 0])
    return {
        "unknowns": size,
        "entries": int(matrix.nnz),
        "first_s": first_s,
        "cholmod_first_s": cholmod_first_s,
        "again_s": again_s,
        "covariances_s": inverse_s,
        "cholmod_covariances_s": columns_s / COLUMNS * size,
        "apart_sigma": float((np.abs(ours - theirs) / sigma).max()),
        "covariance_apart_share": float(np.max(shares)),
    }


def main() -> int:
    """Print the figures; 1 where the two disagree."""
    parser = parser_of(__doc__)
    add_roads(parser)
    parser.add_argument("--drives", type=int, default=100)
    parser.add_argument("--repeat", type=int, default=5)
    arguments = parser.parse_args()
    if cholespy is None:
        print("CHOLMOD is not installed (pip install cholespy), so there is nothing to compare with.")
        return 0
    f = compare(*equations(arguments.roads, arguments.drives), arguments.repeat)
    print(f"{f['unknowns']:,} unknowns, {f['entries']:,} entries of the matrix")
    for name in ("first", "covariances"):
        mine, other = f[f"{name}_s"], f[f"cholmod_{name}_s"]
        print(f"  {name:11} ours {mine:8.3f} s  CHOLMOD {other:10.3f} s  ratio {other / mine:8.2f}")
    print(f"  again       ours {f['again_s']:8.3f} s")
    print(
        f"  apart       solutions {f['apart_sigma']:.1e} sigma, covariances {f['covariance_apart_share']:.1e} of "
        "the variance"
    )
    if arguments.json:
        arguments.json.write_text(json.dumps(f, indent=1))
    return int(max(f["apart_sigma"], f["covariance_apart_share"]) > MOST_APART)


if __name__ == "__main__":
    raise SystemExit(main())
