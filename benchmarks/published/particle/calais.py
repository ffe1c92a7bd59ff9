"""Al Assaad's experiment (thesis of 2020, 2.4 and 3.5) on simulated drives of the same shape.

Each seed is a scene of its own (``make_interchange``: motorways, ramps, embankments, rasters of both kinds) and a drive
of 549 s at 1 Hz through it. The receiver is ``m8u`` (its docstring says where its noises come from); one row repeats
chapter 3 with ``m8``, the harsher profile that the other benchmarks use.

Errors are taken against the simulation's truth. The thesis had none: its reference is a filter over the GNSS data
alone, which shares every slow GNSS error with the filter under test. The rows "beside GNSS alone" repeat that
comparison: the same model over positions (and velocity, where the filter under test uses it), without map, terrain and
inertial sensors.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fusion.types import Progress
from published.particle.calais_measure import (
    Figures,
    Scene,
    against_truth,
    beside,
    best_altitude_std_m,
    estimate,
    gnss_alone,
)
from published.particle.calais_published import (
    CASE_2,
    CASE_3,
    CASE_3_DOPPLER,
    CASE_UKF,
    CHAPTER_2,
    CHAPTER_3,
    NOTES,
    UNSCENTED,
)
from published.rows import Row

PARTICLES = 100_000
RECEIVER, HARSH_RECEIVER = "m8u", "m8"
_FEW_PARTICLES = 10_000
_THESIS = {"particles": PARTICLES, "period_s": 1.0, "min_epochs": 4, "discretisation": "thesis"}


@dataclass(frozen=True)
class Case:
    """One configuration of a method, and the quantities to be shown with what the thesis prints for each."""

    name: str
    method: str
    raster: str
    options: Mapping[str, Any]
    velocity: bool
    """Whether the method uses Doppler velocity; so does the reference over GNSS alone, then."""
    quantities: Sequence[tuple[str, str, str]]


CASES = (
    Case(
        CASE_2,
        "particle",
        "aster",
        {**_THESIS, "variant": "ch2", "doppler": False, "dem_sigma_m": 12.6},
        False,
        CHAPTER_2,
    ),
    Case(
        CASE_3,
        "particle",
        "world30",
        {**_THESIS, "variant": "ch3", "doppler": False, "dem_sigma_m": 6.0},
        False,
        CHAPTER_3,
    ),
    Case(
        CASE_3_DOPPLER,
        "particle",
        "world30",
        {**_THESIS, "variant": "ch3", "doppler": True, "dem_sigma_m": 6.0},
        True,
        CHAPTER_3,
    ),
    Case(
        CASE_UKF,
        "ukf-dem",
        "aster",
        {"period_s": 1.0, "min_epochs": 4, "dem_sigma_m": 12.6},
        False,
        UNSCENTED,
    ),
)


def run(seeds: int, progress: Progress) -> list[Row]:
    """Every case on ``seeds`` drives; 100,000 particles take some 10 s a case and drive on two free cores."""
    figures: dict[str, list[Figures]] = {case.name: [] for case in CASES}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(1, seeds + 1):
            scene = Scene.make(seed, RECEIVER, Path(folder))
            for k, case in enumerate(CASES):
                progress("calais", (seed - 1 + k / len(CASES)) / seeds)
                figures[case.name].append(measure(scene, case))
            harsh = Scene.make(seed, HARSH_RECEIVER, Path(folder))
            figures[CASES[2].name][-1] |= _harsh(harsh, CASES[2], seed)
            figures[CASES[0].name][-1]["epochs resampled, threshold 0.1"] = _resampled_at_a_tenth(scene)
    return [row for case in CASES for row in _rows(case, figures[case.name])]


def measure(scene: Scene, case: Case) -> Figures:
    """Errors of one run, and its differences from GNSS alone."""
    estimated = estimate(scene, case.method, case.options, case.raster)
    best = best_altitude_std_m(scene.drive.receiver, scene.drive.seed)
    alone = beside(estimated, gnss_alone(scene, case.velocity))
    return {**against_truth(scene, estimated), **alone, "altitude, best possible std": best}


def _harsh(scene: Scene, case: Case, seed: int) -> Figures:
    """Altitude with the harsher receiver."""
    measured, name = measure(scene, case), f"position U, std, receiver {HARSH_RECEIVER}"
    return {
        name: measured["position U, std"],
        f"{name}, beside GNSS alone": measured["position U, std, beside GNSS alone"],
        f"altitude, best possible std, receiver {HARSH_RECEIVER}": best_altitude_std_m(HARSH_RECEIVER, seed),
    }


def _resampled_at_a_tenth(scene: Scene) -> float:
    """Share of the epochs, percent, with the threshold that the thesis calls 0.1; it hardly depends on the number."""
    options = {**CASES[0].options, "particles": _FEW_PARTICLES, "trigger_threshold": 0.1}
    return 100 * estimate(scene, "particle", options, CASES[0].raster).resampled


def _rows(case: Case, figures: Sequence[Figures]) -> list[Row]:
    return [
        Row(case.name, quantity, unit, published, [f[quantity] for f in figures], _note(case, quantity))
        for quantity, unit, published in case.quantities
        if all(quantity in f for f in figures)
    ]


def _note(case: Case, quantity: str) -> str:
    return NOTES.get((case.name, quantity), "")
