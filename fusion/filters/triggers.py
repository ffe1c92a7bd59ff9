"""When a particle filter resamples (Al Assaad 2020, section 1.4.3.4).

A trigger looks at two sums over the weights only, so that a compiled cloud can offer them without handing out weights.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from fusion.registry import Registry


class Rule(Protocol):
    """Whether to resample ``particles`` weights of these ``n_eff`` (1.50) and ``entropy`` (1.49)."""

    def __call__(self, n_eff: float, entropy: float, particles: int, threshold: float) -> bool: ...


@dataclass(frozen=True)
class Trigger:
    """``due(n_eff, entropy, particles, threshold)`` is the rule; ``unit`` is that of its threshold."""

    name: str
    description: str
    unit: str
    default_threshold: float
    due: Rule


def _few_count(n_eff: float, entropy: float, particles: int, threshold: float) -> bool:
    return n_eff < threshold * particles


def _far_from_equal(n_eff: float, entropy: float, particles: int, threshold: float) -> bool:
    return entropy > threshold


def _never(n_eff: float, entropy: float, particles: int, threshold: float) -> bool:
    return False


TRIGGERS: Registry[Trigger] = Registry("resampling trigger")

for _trigger in (
    Trigger(
        "n_eff",
        "Resample when N_eff (1.50) falls below this share of the particles (thesis: 2/3).",
        "share of N",
        2 / 3,
        _few_count,
    ),
    Trigger(
        "entropy",
        "Resample when S_w (1.49) rises above this; 0.2 is where log-normal weights have an N_eff of 2/3 N.",
        "nat",
        0.2,
        _far_from_equal,
    ),
    Trigger(
        "never",
        "Never resample: sequential importance sampling (SIS); no threshold is used.",
        "",
        0.0,
        _never,
    ),
):
    TRIGGERS.add(_trigger.name, _trigger)
