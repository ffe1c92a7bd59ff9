"""When a particle filter resamples (Al Assaad 2020, section 1.4.3.4).

A trigger looks at two sums over the weights only, so that a compiled cloud can offer them without handing out weights.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from fusion.registry import Registry


@dataclass(frozen=True)
class Trigger:
    """``due(n_eff, entropy, particles, threshold)`` says whether to resample so many ``particles`` whose weights have
    this ``n_eff`` (1.50) and ``entropy`` (1.49). ``unit`` is that of the threshold.
    """

    name: str
    description: str
    unit: str
    default_threshold: float
    due: Callable[[float, float, int, float], bool]


TRIGGERS: Registry[Trigger] = Registry("resampling trigger")

for _trigger in (
    Trigger(
        "n_eff",
        "Resample when N_eff (1.50) falls below this share of the particles (thesis: 2/3).",
        "share of N",
        2 / 3,
        lambda n_eff, entropy, particles, threshold: n_eff < threshold * particles,
    ),
    Trigger(
        "entropy",
        "Resample when S_w (1.49) rises above this; 0.2 is where log-normal weights have an N_eff of 2/3 N.",
        "nat",
        0.2,
        lambda n_eff, entropy, particles, threshold: entropy > threshold,
    ),
    Trigger(
        "never",
        "Never resample: sequential importance sampling (SIS); no threshold is used.",
        "",
        0.0,
        lambda n_eff, entropy, particles, threshold: False,
    ),
):
    TRIGGERS.add(_trigger.name, _trigger)
