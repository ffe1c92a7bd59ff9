"""The constants of the network's model, each with another value to try, and how one is tried.

A constant is changed in every module that looks its name up when it runs: the one that defines it and those that
import it. Nothing is changed silently: a name that no function looks up is refused.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import CodeType, FunctionType, ModuleType
from typing import Any

ROOMS = ("fusion.network.", "fusion.profile.")
"""Where constants of the network's model are looked up."""
_MODEL = "fusion.network."
_PROFILE = "fusion.profile."


def times(factor: float) -> Callable[[Any], Any]:
    """A number, or each of several, multiplied."""
    return lambda v: type(v)(factor * x for x in v) if isinstance(v, tuple) else factor * v


def set_to(value: Any) -> Callable[[Any], Any]:
    """Another value, whatever it was."""
    return lambda _: value


@dataclass(frozen=True)
class Change:
    """A constant, what is done to it, and the value that comes of it; ``factors`` whether drives hold it already."""

    module: str
    name: str
    what: str
    value: Callable[[Any], Any]

    @property
    def factors(self) -> bool:
        """Whether it is in the factors, which are then made anew."""
        return self.module.startswith(_PROFILE)

    @property
    def label(self) -> str:
        """How a table names it."""
        return f"{self.name} {self.what}"


def _both(module: str, name: str) -> tuple[Change, Change]:
    return Change(module, name, "halved", times(0.5)), Change(module, name, "doubled", times(2.0))


_ROAD, _DRIVE = _MODEL + "road_beliefs", _MODEL + "drive_beliefs"
_SHOWN, _DEM = _MODEL + "segment_slopes", _MODEL + "terrain"
_FACTORS = _PROFILE + "factors"
_METHOD = _PROFILE + "method"
_LEVELS, _NOISE, _LINEAR = _PROFILE + "levels", _PROFILE + "noise", _PROFILE + "model"
_PRIOR = _PROFILE + "prior"
CHANGES: tuple[Change, ...] = (
    Change(_ROAD, "ROUGHNESS_FREEDOM", "off: Gauss", set_to(1e6)),
    Change(_ROAD, "ROUGHNESS_FREEDOM", "doubled", times(2.0)),
    Change(_ROAD, "UNSEEN_VARIANCE", "off: 1", set_to(1.0)),
    *_both(_ROAD, "ROUGHNESS_PRIOR_COUNT"),
    *_both(_ROAD, "FAR_SHARE"),
    *_both(_ROAD, "PLACE_M"),
    *_both(_ROAD, "LEVEL_SIGMA_M"),
    *_both(_ROAD, "NODE_SIGMA_M"),
    Change(_ROAD, "NODE_FREEDOM", "off: Gauss", set_to(1e6)),
    *_both(_ROAD, "GRADE_SIGMA"),
    Change(_DRIVE, "PASS_FREEDOM", "off: Gauss", set_to(1e6)),
    *_both(_DRIVE, "PASS_FREEDOM"),
    Change(_DRIVE, "REJECT_SIGMAS", "off: never", set_to(1e6)),
    Change(_DRIVE, "REJECT_SIGMAS", "halved", times(0.5)),
    Change(_DRIVE, "WALK_FREEDOM", "off: Gauss", set_to(1e6)),
    Change(_DRIVE, "WALK_FREEDOM", "doubled", times(2.0)),
    Change(_DRIVE, "WALK_PRIOR_COUNT", "off: never learned", set_to(1e9)),
    Change(_DRIVE, "WALK_PRIOR_COUNT", "halved", times(0.5)),
    Change(_DRIVE, "SCALE_PRIOR_COUNT", "off: never learned", set_to(1e9)),
    *_both(_DRIVE, "SCALE_PRIOR_COUNT"),
    *_both(_DRIVE, "START_SIGMA_M"),
    Change(_DRIVE, "LAG_MEAN_S", "off: 0 +- 1 s", set_to((0.0, 1.0))),
    *_both(_DRIVE, "LAG_SIGMA_S"),
    *_both(_MODEL + "pass_factor", "CONSTANT_SIGMA"),
    Change(_SHOWN, "PLACE_SIGMA_M", "off: 0", set_to(0.0)),
    *_both(_SHOWN, "PLACE_SIGMA_M"),
    Change(_SHOWN, "LANE_SIGMA_M", "off: 0", set_to(0.0)),
    *_both(_SHOWN, "LANE_SIGMA_M"),
    *_both(_SHOWN, "LANE_LENGTH_M"),
    *_both(_DEM, "DEFAULT_SIGMA_M"),
    *_both(_DEM, "DEFAULT_LENGTH_M"),
    *_both(_DEM, "LONG_LAG_M"),
    Change(_DEM, "PRIOR_PAIRS", "off: 0", set_to(0.0)),
    Change(_DEM, "PRIOR_PAIRS", "doubled", times(2.0)),
    Change(_DEM, "SOUND_GRADE", "off: any", set_to(1e6)),
    *_both(_DEM, "SOUND_GRADE"),
    Change(_DEM, "STEP_FREEDOM", "off: Gauss", set_to(1e6)),
    Change(_PRIOR, "LOG_WANDER", "off: none", set_to((-12.0, 0.01))),
    Change(_PRIOR, "LOG_WANDER", "as free as others", set_to((-5.3, 1.5))),
    *_both(_LINEAR, "WANDER_TAU_S"),
    Change(_FACTORS, "PLACE_BOUND_M", "off: any", set_to(1e6)),
    Change(_FACTORS, "PLACE_BOUND_M", "off: no place of its own", set_to(1e-6)),
    Change(_LEVELS, "ROBUST_INFORMATION_LOSS", "off: 1", set_to(1.0)),
    Change(_PRIOR, "LOG_GRADE_LENGTH", "off: a random walk", set_to((20.7, 0.01))),
    Change(_PRIOR, "LOG_GRADE_LENGTH", "mean five times more", set_to((5.7, 1.0))),
    *_both(_PRIOR, "GUST_MPS"),
    Change(_NOISE, "FREEDOMS", "off: 5 for all", set_to((5.0,))),
    Change(_PRIOR, "LOG_ROUGHNESS", "mean ten times less", set_to((-12.7, 1.5))),
    *_both(_PRIOR, "LOG_SPREAD"),
    *_both(_PRIOR, "LOG_RATE_SPREAD"),
    Change(_LEVELS, "LEAST_HEIGHT_M", "off: 0", set_to(1e-4)),
    Change(_LEVELS, "LEAST_PRESSURE_HEIGHT_M", "off: 0", set_to(1e-4)),
    Change(_NOISE, "FILTERED", "off: never", set_to(0.0)),
    *_both(_NOISE, "FILTERED"),
    *_both(_NOISE, "HEIGHTS_APART_S"),
    Change(_METHOD, "_USUAL_DRIFT", "off: learned", set_to((None, None))),
    Change(_NOISE, "SHARED_START", "off: 0", set_to(0.0)),
    Change(_NOISE, "TAIL_SIGMAS", "off: never", set_to(1e6)),
    Change(_NOISE, "OUTLIER_SIGMAS", "off: never", set_to(1e6)),
    Change(_NOISE, "JUMP_SCORE", "off: never", set_to(1e6)),
    Change(_NOISE, "CORRELATED_WITHIN_S", "off: 0", set_to(0.0)),
    *_both(_LINEAR, "DRIFT_TAU_S"),
    *_both(_FACTORS, "PLACE_TAU_S"),
    *_both(_FACTORS, "PLACE_PART_S"),
    Change(_LINEAR, "MISALIGNMENT_SIGMA", "off: 0", set_to(0.0)),
    Change(_LINEAR, "SLOW_MPS", "off: 0", set_to(0.0)),
)
"""Halved, doubled or switched off: what could be missed without it, or tuned by it."""

LEFT_OUT = {
    "KNOWN_SIGMA_M": "what is said of heights, not what they are",
    "DEFAULT_ROUGHNESS": "of networks without any drive",
    "ROUGHNESS_BOUNDS": "what roads can be at all",
    "SIGMA_BOUNDS_M": "what elevation models can be at all",
    "METRES_PER_DEGREE": "the size of the Earth",
    "DISPLACED_M": "when reports warn of an elevation model; no slope follows from it",
    "DISPLACED_SIGMAS": "as DISPLACED_M",
}
"""Constants that are not tried, with the reason."""


def module_of(change: Change) -> ModuleType:
    """The module that defines a constant; every other of ``ROOMS`` that is there is loaded with it."""
    importlib.import_module("fusion.pipeline")
    return importlib.import_module(change.module)


def places(change: Change) -> list[ModuleType]:
    """The modules whose functions look the constant up. Raises ``LookupError`` where none does."""
    home = module_of(change)
    if not hasattr(home, change.name):
        raise LookupError(f"{change.module} has no constant {change.name}")
    value = getattr(home, change.name)
    loaded = [m for name, m in sorted(sys.modules.items()) if name.startswith(ROOMS)]
    modules = [m for m in loaded if getattr(m, change.name, None) is value and _looks_up(m, change.name)]
    if not modules:
        raise LookupError(f"no function looks up {change.name} of {change.module}: changing it does nothing")
    return modules


def _looks_up(module: ModuleType, name: str) -> bool:
    return any(name in code.co_names for code in _code_of(module))


def _code_of(module: ModuleType) -> Iterator[CodeType]:
    """The code of all functions and methods of a module, and of those within them."""
    waiting: list[CodeType] = []
    for value in vars(module).values():
        members = vars(value).values() if isinstance(value, type) else [value]
        for member in members:
            inner = getattr(member, "fget", None) or getattr(member, "__func__", None) or member
            if isinstance(inner, FunctionType) and inner.__module__ == module.__name__:
                waiting.append(inner.__code__)
    while waiting:
        code = waiting.pop()
        yield code
        waiting += [c for c in code.co_consts if isinstance(c, CodeType)]


@contextmanager
def changed(change: Change | None) -> Iterator[None]:
    """The library with one constant changed; as it is with None."""
    if change is None:
        yield
        return
    modules, before = places(change), getattr(module_of(change), change.name)
    for module in modules:
        setattr(module, change.name, change.value(before))
    try:
        yield
    finally:
        for module in modules:
            setattr(module, change.name, before)
