"""What a smoother could reach at best on the logs that Versant gets: the bound of the tool ``bound.py``, by road.

That smoother is told true places and speeds, and the receiver's noise levels. Unknown stay the heights, the slow error
of altitudes, the body's movement on its springs and the constant errors. See the tool for what it leaves out.
"""

from __future__ import annotations

from collections.abc import Sequence as Several
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from accuracy.sequences import Sequence, road_file
from accuracy.truth import SAME_PERCENT, Key
from fusion.types import Floats

ALL_SENSORS = ("alt", "dop", "pitch", "force")
"""The tool's names of altitude, vertical Doppler, pitch and forward specific force."""
AS_FITTED = "q"
"""The tool's name of the roughness that it fits to the road; it tries a quarter and four times that as well."""


@dataclass(frozen=True, eq=False)
class RoadBound:
    """One road as the tool reads it: done once, for all drives."""

    tool: ModuleType
    reference: Any
    """The tool's own, an instance of its ``Reference``."""
    keys: list[Key]
    """In the order of the truth."""
    rows: Floats
    """Turns heights along the reference into slopes in percent, one row for each of ``keys``."""
    springs: tuple[float, float]
    roughness_per_m: float

    @classmethod
    def of(cls, tool: ModuleType, sequence: Sequence) -> RoadBound:
        """The road of a precise track; ValueError where the tool's slopes are others than those of the truth."""
        if sequence.reference is None:
            raise ValueError(f"{sequence.name} has no precise track")
        reference = tool.Reference(str(sequence.reference))
        roads = road_file(sequence.reference.parent, sequence.name)
        named, rows = tool.segment_rows(reference, str(roads))
        keys = [(int(way), int(start), int(end)) for way, start, end in named]
        true = {key: true.slope_percent for key, true in sequence.truth.items()}
        mine = dict(zip(keys, (rows @ reference.z).tolist(), strict=True))
        if list(mine) != list(true) or any(abs(mine[k] - true[k]) > SAME_PERCENT for k in true):
            raise ValueError(f"{sequence.name}: the bound is of other slopes than the truth has")
        return cls(tool, reference, keys, rows, tool.suspension(reference), tool.roughness(reference))

    def drive(self, log: Path, receiver: str, seed: int, sensors: Several[str] = ALL_SENSORS) -> Any:
        """What the tool makes of one log of ``make_log``, whole and at 1 Hz, for ``errors``."""
        return self.tool.equations(self.reference, str(log), receiver, seed, self.springs, list(sensors))

    def errors(self, drives: Several[Any]) -> dict[str, Floats]:
        """Errors in percent of the slopes of ``keys`` from drives together, by roughness; its sigmas as ``sigma``."""
        found = self.tool.errors(self.reference, self.rows, list(drives), self.roughness_per_m)
        return {str(name): np.asarray(values, float) for name, values in found.items()}
