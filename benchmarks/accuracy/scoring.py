"""Figures of slopes whose truth is known: errors, shares within sigma, by length of segment; and tables of figures."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from accuracy.sequences import Slopes
from accuracy.truth import Truth
from fusion.types import Bools, Floats

Row = dict[str, Any]
"""One line of a table: names as text, figures as numbers, None where there is none."""
LENGTH_CLASSES_M = (15.0, 40.0, 100.0)
"""Where one class of length ends and the next begins."""
WHOLE_SHARE = 0.9
"""A truth that was measured over a smaller share of its segment is that of a part."""
TWO_SIDED_95 = 1.96


@dataclass(frozen=True, eq=False)
class Errors:
    """Slopes beside their truth, one row a segment that has both; ``wanted`` counts the segments of the truth."""

    error_percent: Floats
    sigma_percent: Floats
    true_percent: Floats
    length_m: Floats
    driven_share: Floats
    passes: Floats
    truth_sigma_percent: Floats
    wanted: int

    @classmethod
    def of(cls, truth: Truth, estimates: Slopes) -> Errors:
        """What slopes are wrong by."""
        both = [key for key in truth if key in estimates]
        true = np.array([truth[key] for key in both], float).reshape(-1, 5)
        values = np.array([estimates[key] for key in both], float).reshape(-1, 2)
        return cls(
            error_percent=values[:, 0] - true[:, 0],
            sigma_percent=values[:, 1],
            true_percent=true[:, 0],
            length_m=true[:, 2],
            driven_share=true[:, 1] / true[:, 2],
            passes=true[:, 3],
            truth_sigma_percent=true[:, 4],
            wanted=len(truth),
        )

    @classmethod
    def pooled(cls, parts: Sequence[Errors]) -> Errors:
        """The errors of several logs or roads in one."""
        columns = [f.name for f in fields(cls) if f.name != "wanted"]
        joined = {c: np.concatenate([np.empty(0), *(getattr(p, c) for p in parts)]) for c in columns}
        return cls(**joined, wanted=sum(p.wanted for p in parts))

    def take(self, keep: Bools) -> Errors:
        """Some of the rows, which are then all that is wanted."""
        columns = {f.name: getattr(self, f.name)[keep] for f in fields(self) if f.name != "wanted"}
        return Errors(**columns, wanted=int(np.count_nonzero(keep)))

    def __len__(self) -> int:
        return len(self.error_percent)

    @property
    def rmse(self) -> float:
        """Root mean square error, percent of slope."""
        return rms(self.error_percent)

    @property
    def weighted_rmse(self) -> float:
        """The same with each segment weighted by its length: what a metre of road is wrong by."""
        return float(np.sqrt(np.average(self.error_percent**2, weights=self.length_m)))

    @property
    def p90(self) -> float:
        """90th percentile of the absolute error."""
        return float(np.quantile(np.abs(self.error_percent), 0.9))

    @property
    def coverage(self) -> float:
        """Share of the segments wanted that have a slope."""
        return len(self) / self.wanted

    @property
    def within_95(self) -> float:
        """Share of errors within 1.96 sigma of estimate and truth together: 0.95 where sigmas are true."""
        return float(np.mean(np.abs(self.z) <= TWO_SIDED_95))

    @property
    def z_rms(self) -> float:
        """Root mean square of error over that sigma: 1 where sigmas are true, more where they are too small."""
        return rms(self.z)

    @property
    def z(self) -> Floats:
        """Errors over the sigma of estimate and truth together."""
        return self.error_percent / np.hypot(self.sigma_percent, self.truth_sigma_percent)

    @property
    def whole(self) -> Errors:
        """Those whose truth is simple: of one pass, over all of the segment but ends."""
        return self.take((self.passes == 1) & (self.driven_share >= WHOLE_SHARE))

    @property
    def wrong_sign(self) -> float:
        """Share of slopes with the wrong sign where the true one is steeper than 1 %."""
        slope = self.error_percent + self.true_percent
        return float(
            np.mean((np.sign(slope) != np.sign(self.true_percent)) & (np.abs(self.true_percent) > 1))
        )


def rms(values: Floats) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def figures(runs: Sequence[Sequence[Errors]]) -> Row | None:
    """Figures of logs (outer) of several roads (inner): RMSE and the like are means over the roads and then the logs.

    Shares within sigma and z are of all errors pooled, since a mean of small shares says little; ``whole_...`` are of
    segments that the reference passed once and as a whole. None where no log gave a slope.
    """
    counted = [[e for e in run if len(e)] for run in runs]
    counted = [run for run in counted if run]
    if not counted:
        return None

    def by_log(name: str) -> list[float]:
        return [float(np.mean([getattr(e, name) for e in run])) for run in counted]

    pooled = Errors.pooled([e for run in counted for e in run])
    whole = pooled.whole
    return {
        "rmse_percent": float(np.mean(by_log("rmse"))),
        "rmse_spread": float(np.std(by_log("rmse"))),
        "weighted_rmse_percent": float(np.mean(by_log("weighted_rmse"))),
        "p90_percent": float(np.mean(by_log("p90"))),
        "coverage": float(np.mean([e.coverage for run in runs for e in run])),
        "within_95": pooled.within_95,
        "z_rms": pooled.z_rms,
        "wrong_sign": float(np.mean(by_log("wrong_sign"))),
        "segments": len(pooled),
        "whole_rmse_percent": whole.rmse if len(whole) else None,
        "whole_within_95": whole.within_95 if len(whole) else None,
        "whole_z_rms": whole.z_rms if len(whole) else None,
        "whole_segments": len(whole),
    }


def length_classes(length_m: Floats) -> list[tuple[str, Bools]]:
    """The classes of length by name, each with the rows that it holds; a border belongs to the class above it."""
    low, high = (-math.inf, *LENGTH_CLASSES_M), (*LENGTH_CLASSES_M, math.inf)
    names = [
        f"below {high[0]:g} m",
        *(f"{a:g} to {b:g} m" for a, b in zip(low[1:], high[1:-1], strict=False)),
    ]
    names.append(f"above {low[-1]:g} m")
    inside = [(length_m >= a) & (length_m < b) for a, b in zip(low, high, strict=True)]
    return list(zip(names, inside, strict=True))


def by_length(errors: Errors, noise_free: Errors | None = None) -> list[Row]:
    """Figures of pooled errors by class of length, then of segments of which the truth knows a part only.

    ``noise_free``: errors of logs without noise, the RMSE of which stands beside each.
    """
    clean_parts = _parts(noise_free or Errors.pooled([]))
    return [
        {
            "length": name,
            "segments": len(part),
            "rmse_percent": part.rmse,
            "sigma_rms_percent": rms(part.sigma_percent),
            "within_95": part.within_95,
            "z_rms": part.z_rms,
            "noise_free_rmse_percent": clean_parts[name].rmse if len(clean_parts[name]) else None,
        }
        for name, part in _parts(errors).items()
        if len(part)
    ]


def _parts(errors: Errors) -> dict[str, Errors]:
    classes = length_classes(errors.length_m)
    classes.append(("driven in part", errors.driven_share < WHOLE_SHARE))
    return {name: errors.take(inside) for name, inside in classes}


LENGTH_COLUMNS = {
    "length": ("length", ""),
    "segments": ("slopes", "d"),
    "rmse_percent": ("RMSE %", ".3f"),
    "sigma_rms_percent": ("sigma %", ".3f"),
    "within_95": ("in 1.96s", ".1%"),
    "z_rms": ("z-rms", ".2f"),
    "noise_free_rmse_percent": ("noise-free RMSE %", ".3f"),
}
"""Title and format of each column of ``by_length``."""


def text_table(rows: Sequence[Mapping[str, Any]], columns: Mapping[str, tuple[str, str]]) -> str:
    """Rows as aligned text; ``columns`` names the keys to show, each with its title and format. Unknown is a dash."""
    cells = [[title for title, _ in columns.values()]]
    cells += [[_cell(row.get(key), spec) for key, (_, spec) in columns.items()] for row in rows]
    return "\n".join(aligned(cells, [spec == "" for _, spec in columns.values()]))


def aligned(cells: Sequence[Sequence[str]], left: Sequence[bool]) -> list[str]:
    """Lines of cells, one column below the other; those of a column to the ``left`` or to the right."""
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        "  ".join(
            c.ljust(w) if le else c.rjust(w) for c, w, le in zip(line, widths, left, strict=True)
        ).rstrip()
        for line in cells
    ]


def _cell(value: Any, spec: str) -> str:
    unknown = value is None or (isinstance(value, float) and not math.isfinite(value))
    return "-" if unknown else format(value, spec)


def show_progress(text: str) -> None:
    """A line on standard error, rewritten on a terminal; nothing elsewhere. An empty text wipes it."""
    if sys.stderr.isatty():
        print(f"\r{text:60}" if text else f"\r{'':60}\r", end="", file=sys.stderr, flush=True)


def write_json(path: Path | None, data: object) -> None:
    """The figures as a file, where one is asked for."""
    if path:
        path.write_text(json.dumps(data, indent=1) + "\n")
