"""What an error model of pseudoranges is: a series of one satellite in, the law of its errors and its moments out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fusion.gnss.error_models.law import ErrorLaw
from fusion.registry import Registry
from fusion.types import Floats, Ints


@dataclass(frozen=True)
class Series:
    """Errors of one satellite's pseudorange or residuals for them (measured minus predicted, m), (n,) each.

    ``time_s`` increases; ``state`` is the reception's (``fusion.gnss.reception``), ``cn0_dbhz`` may be NaN. Raises
    ``ValueError`` for other shapes, errors that are not finite, and a series without any.
    """

    time_s: Floats
    error_m: Floats
    state: Ints
    cn0_dbhz: Floats

    def __post_init__(self) -> None:
        shapes = {np.shape(c) for c in (self.time_s, self.error_m, self.state, self.cn0_dbhz)}
        if len(shapes) != 1 or not len(self.error_m) or not np.isfinite(self.error_m).all():
            raise ValueError(
                "a series of errors must hold at least one, all finite, with a time, state and C/N0 each"
            )

    def __len__(self) -> int:
        return len(self.error_m)

    def begins(self, window_s: float) -> Ints:
        """For each epoch the first that lies within ``window_s`` before it, (n,)."""
        return np.searchsorted(self.time_s, self.time_s - window_s)


class ErrorModel(Protocol):
    """A named model of one satellite's errors."""

    @property
    def name(self) -> str:
        """As in ``ERROR_MODELS``."""
        ...

    @property
    def source(self) -> str:
        """Where it comes from: author, year, equations."""
        ...

    @property
    def description(self) -> str:
        """One sentence for a person who chooses."""
        ...

    def law(self, series: Series, seed: int) -> ErrorLaw:
        """The law of all errors of a series together."""
        ...

    def track(self, series: Series, seed: int) -> tuple[Floats, Floats]:
        """Mean (m) and variance (m2) at each epoch, (n,) each, from what was seen up to it and with it."""
        ...


ERROR_MODELS: Registry[ErrorModel] = Registry("error model")
"""The laws by name; filled by ``fusion.catalogue``."""


def share_within(series: Series, mean_m: Floats, variance_m2: Floats, sigmas: float) -> float:
    """The share of epochs whose error lies within mean +- ``sigmas`` x sigma: Table 3.10's score, 0 to 1."""
    return float(np.mean(np.abs(series.error_m - mean_m) <= sigmas * np.sqrt(variance_m2)))
