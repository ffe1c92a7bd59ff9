"""Estimated slopes against the simulated truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from fusion.types import Floats

SegmentKey = tuple[int, int, int]
"""(osm_way_id, from_node, to_node)."""
NORMAL_95 = 1.96


@dataclass(frozen=True)
class Truth:
    """A segment that was driven: its true slope, percent, and what kind of road it is."""

    slope_percent: float
    highway: str
    bridge: bool
    tunnel: bool


@dataclass(frozen=True)
class Estimate:
    """Slope and sigma, percent; sigma NaN where a baseline states none."""

    slope_percent: float
    sigma_percent: float


@dataclass(frozen=True)
class Score:
    """How good a set of estimates is. Figures are NaN where there is nothing to compute them from."""

    segments: int
    """Driven segments with a true slope."""
    estimated: int
    rmse_percent: float
    p90_percent: float
    """90 % of the errors are no larger."""
    within_95: float
    """Share of errors within 1.96 sigma; 0.95 is right."""
    wrong_sign: float
    """Share with the wrong sign, among slopes steeper than 1 %."""
    coverage: float
    """Share of the driven segments that have an estimate."""


def score(truth: Mapping[SegmentKey, Truth], estimates: Mapping[SegmentKey, Estimate]) -> Score:
    """Compare the estimates of the segments that the truth knows; others don't count."""
    both = [key for key in truth if key in estimates]
    true = np.array([truth[key].slope_percent for key in both])
    slope = np.array([estimates[key].slope_percent for key in both])
    sigma = np.array([estimates[key].sigma_percent for key in both])
    error = slope - true
    steep = np.abs(true) > 1
    return Score(
        segments=len(truth),
        estimated=len(both),
        rmse_percent=float(np.sqrt(np.mean(error**2))) if both else float("nan"),
        p90_percent=float(np.quantile(np.abs(error), 0.9)) if both else float("nan"),
        within_95=_share(np.abs(error) <= NORMAL_95 * sigma, np.isfinite(sigma)),
        wrong_sign=_share(np.sign(slope) != np.sign(true), steep),
        coverage=len(both) / len(truth) if truth else float("nan"),
    )


def by_kind(truth: Mapping[SegmentKey, Truth], estimates: Mapping[SegmentKey, Estimate]) -> dict[str, Score]:
    """A score for each road class, bridges and tunnels among them."""
    classes = sorted({road.highway for road in truth.values()})
    parts = {name: {k: t for k, t in truth.items() if t.highway == name} for name in classes}
    return {name: score(part, estimates) for name, part in parts.items()}


def by_structure(
    truth: Mapping[SegmentKey, Truth], estimates: Mapping[SegmentKey, Estimate]
) -> dict[str, Score]:
    """A score for the open road, for bridges and for tunnels; kinds that were not driven are missing."""
    kinds: dict[str, Callable[[Truth], bool]] = {
        "open road": lambda road: not (road.bridge or road.tunnel),
        "bridges": lambda road: road.bridge,
        "tunnels": lambda road: road.tunnel,
    }
    parts = {name: {k: t for k, t in truth.items() if is_of_kind(t)} for name, is_of_kind in kinds.items()}
    return {name: score(part, estimates) for name, part in parts.items() if part}


def examples(truth: Mapping[SegmentKey, Truth], count: int) -> list[SegmentKey]:
    """About ``count`` segments to show: bridges and tunnels first, then evenly from steepest down to up.

    Chosen by the truth alone, so that no estimate decides whether it is shown.
    """
    structures = [key for key, road in truth.items() if road.bridge or road.tunnel][: count // 2]
    others = sorted((k for k in truth if k not in set(structures)), key=lambda k: truth[k].slope_percent)
    most = min(count - len(structures), len(others))
    picks = np.unique(np.linspace(0, max(len(others) - 1, 0), max(most, 0)).round().astype(int))
    return structures + [others[k] for k in picks.tolist()]


def _share(hits: np.ndarray[tuple[int], np.dtype[np.bool_]], among: Floats) -> float:
    return float(np.mean(hits[among])) if np.any(among) else float("nan")
