"""How good positions are: errors beside a truth, and whether stated ellipses hold it."""

from __future__ import annotations

import statistics
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fusion.frames import local_axes
from fusion.gnss.measurements import Aids, Measurements, Solution, Solver
from fusion.types import Floats, no_progress

CHI2_95_2D = 5.991
TIMED_RUNS = 3


@dataclass(frozen=True)
class Scene:
    """A log with its truth: ``truth_m`` (m, 3) in ECEF at the epochs of ``measured``, NaN where unknown."""

    measured: Measurements
    aids: Aids
    truth_m: Floats


def errors(scene: Scene, solution: Solution) -> tuple[Floats, Floats, Floats]:
    """East, north and up errors (m, 3), squared normalised horizontal ones (m,), and stated radial sigmas (m,)."""
    axes = local_axes(scene.measured.rough_m[None])[0]
    off = (solution.position_m - scene.truth_m) @ axes.T
    covariance = (axes @ solution.covariance[:, :3, :3] @ axes.T)[:, :2, :2]
    normal = np.full(len(off), np.nan)
    has_sigma = np.isfinite(covariance).all(axis=(1, 2)) & np.isfinite(off).all(axis=1)
    solved = np.linalg.solve(covariance[has_sigma], off[has_sigma, :2, None])[..., 0]
    normal[has_sigma] = np.sum(off[has_sigma, :2] * solved, axis=1)
    return off, normal, np.sqrt(np.trace(covariance, axis1=1, axis2=2))


def figures(scene: Scene, solution: Solution) -> dict[str, float]:
    """One row of the table; epochs with truth but without position are counted, not scored."""
    off, normal, sigma = errors(scene, solution)
    true = np.isfinite(scene.truth_m).all(axis=1)
    solved = true & np.isfinite(off).all(axis=1)
    if not solved.any():
        return {"epochs": 0.0}
    flat = np.hypot(off[solved, 0], off[solved, 1])
    stated = normal[np.isfinite(normal)]
    return {
        "mean_m": float(flat.mean()),
        "median_m": float(np.median(flat)),
        "p95_m": float(np.percentile(flat, 95)),
        "mean_3d_m": float(np.linalg.norm(off[solved], axis=1).mean()),
        "up_m": float(off[solved, 2].mean()),
        "within_95": float((stated < CHI2_95_2D).mean()) if len(stated) else float("nan"),
        "sigma_m": float(np.nanmedian(sigma[solved])) if len(stated) else float("nan"),
        "epochs": float(solved.sum()),
        "missing": float((true & ~solved).sum()),
    }


def row(scene: Scene, solver: Solver, options: Mapping[str, Any], seeds: int) -> dict[str, float]:
    """Means over seeds, the spread of the mean errors, and milliseconds an epoch, once compiled."""
    chosen = solver.options_model(**options)
    runs, times = [], []
    for seed in range(seeds + 1):
        began = time.process_time()
        solution = solver.solve(scene.measured, scene.aids, chosen, max(seed - 1, 0), no_progress)
        if seed:  # the run before compiled
            times.append(time.process_time() - began)
            runs.append(figures(scene, solution))
    for _ in range(TIMED_RUNS - len(times)):
        began = time.process_time()
        solver.solve(scene.measured, scene.aids, chosen, 0, no_progress)
        times.append(time.process_time() - began)
    runs = [run for run in runs if run["epochs"]]
    if not runs:
        return {"epochs": 0.0}
    total = {key: statistics.fmean(run[key] for run in runs) for key in runs[0]}
    means = [run["mean_m"] for run in runs]
    total["spread_m"] = statistics.stdev(means) if len(means) > 1 else 0.0
    total["ms_per_epoch"] = 1e3 * statistics.median(times) / len(scene.measured)
    return total
