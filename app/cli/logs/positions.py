"""The files of ``versant track``: the positions of logs as CSV or GeoJSON. Knows no roads and no slopes."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from app.core.text import COORDINATE_DIGITS, rounded
from app.drives.outputs.track import time_text
from fusion.gnss.positioning import Positioned, SolvedEpochs
from fusion.types import DriveLog, Floats

PLACE = ("time_s", "lat_deg", "lon_deg")
FIGURES = ("height_ell_m", "alt_msl_m", "h_acc_m", "v_acc_m")
COVARIANCES = ("cov_ee_m2", "cov_en_m2", "cov_eu_m2", "cov_nn_m2", "cov_nu_m2", "cov_uu_m2")
"""Parts of the covariance of a solver's position, m^2: east, north, up."""
SOLVED_COLUMNS = (*COVARIANCES, "predicted", "reflected")
_DIGITS = {"lat_deg": 9, "lon_deg": 9}  # degrees: a tenth of a millimetre
_OTHER_DIGITS = 3  # milliseconds, millimetres
GAP_S = 10.0
"""Positions further apart in time are not joined by a line."""


@dataclass(frozen=True)
class Positions:
    """The positions of the log called ``name``."""

    name: str
    positioned: Positioned

    @property
    def log(self) -> DriveLog:
        """The log with these positions."""
        return self.positioned.log

    @cached_property
    def solved(self) -> SolvedEpochs | None:
        """What a solver of raw measurements knows of each."""
        return self.positioned.solved_epochs()

    def columns(self, names: Sequence[str]) -> dict[str, Floats]:
        """Columns of the fix, and those of ``COVARIANCES`` where a solver made it."""
        columns: dict[str, Floats] = {name: getattr(self.log.fix, name) for name in names}
        if self.solved is not None:
            upper = self.solved.covariance[:, *np.triu_indices(3)]
            columns |= zip(COVARIANCES, upper.T, strict=True)
        return columns


def write_csv(tracks: Sequence[Positions], path: Path) -> None:
    """One row per position, an empty cell for unknown; with several logs a last column ``log``.

    Where a solver computed positions: its covariances, whether an epoch is predicted, and the probability of having
    been reflected by satellite (``G07=0.12 G21=0.95``).
    """
    several = len(tracks) > 1
    computed = any(one.solved for one in tracks)
    names = [*PLACE, *FIGURES, *(SOLVED_COLUMNS if computed else ())]
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow([*names, "log"] if several else names)
        for one in tracks:
            cells = _cells(one)
            unknown = [""] * len(one.log.fix)
            for row in zip(*(cells.get(name, unknown) for name in names), strict=True):
                table.writerow([*row, one.name] if several else row)


def write_geojson(tracks: Sequence[Positions], path: Path) -> None:
    """A FeatureCollection: each log's path, interrupted at gaps, then its positions as points.

    Heights are properties: RFC 7946 wants those in coordinates above the ellipsoid, and few logs have such.
    """
    features = [feature for one in tracks for feature in (_path(one), *_points(one))]
    document = {"type": "FeatureCollection", "features": features}
    path.write_text(json.dumps(document, allow_nan=False, separators=(",", ":")) + "\n", encoding="utf-8")


TRACK_WRITERS: dict[str, Callable[[Sequence[Positions], Path], None]] = {
    ".csv": write_csv,
    ".geojson": write_geojson,
}
"""Suffix -> writer."""


def _cells(one: Positions) -> dict[str, list[str]]:
    """The columns of a CSV as text."""
    cells = {
        name: [f"{v:.{_DIGITS.get(name, _OTHER_DIGITS)}f}" if np.isfinite(v) else "" for v in values]
        for name, values in one.columns(PLACE + FIGURES).items()
    }
    if one.solved is not None:
        cells["predicted"] = ["1" if flag else "0" for flag in one.solved.predicted]
        cells["reflected"] = [
            " ".join(f"{name}={share:.2f}" for name, share in by_satellite.items() if np.isfinite(share))
            for by_satellite in one.solved.reflected
        ]
    return cells


def _path(one: Positions) -> dict[str, Any]:
    fix = one.log.fix
    broken = np.diff(fix.time_s) > GAP_S
    # A gap is named by the time at which the next piece begins.
    outages = np.searchsorted(fix.time_s, one.log.outages_s)
    cuts = np.union1d(np.flatnonzero(broken) + 1, outages[(outages > 0) & (outages < len(fix))])
    points = np.round(np.column_stack([fix.lon_deg, fix.lat_deg]), COORDINATE_DIGITS)
    lines = [piece.tolist() for piece in np.split(points, cuts) if len(piece) > 1]
    geometry = {"type": "MultiLineString", "coordinates": lines} if lines else None
    properties = {"log": one.name, "positions": len(fix), "geoid": one.log.geoid}
    return _feature(geometry, properties)


def _points(one: Positions) -> list[dict[str, Any]]:
    features, fix, columns = [], one.log.fix, one.columns(FIGURES)
    for k in range(len(fix)):
        place = [round(float(degrees[k]), COORDINATE_DIGITS) for degrees in (fix.lon_deg, fix.lat_deg)]
        properties: dict[str, Any] = {"log": one.name, "time": time_text(float(fix.time_s[k]))}
        properties |= {name: rounded(float(values[k]), _OTHER_DIGITS) for name, values in columns.items()}
        if one.solved is not None:
            properties["predicted"] = bool(one.solved.predicted[k])
            properties["reflected"] = {
                name: rounded(share, 2) for name, share in one.solved.reflected[k].items()
            }
        features.append(_feature({"type": "Point", "coordinates": place}, properties))
    return features


def _feature(geometry: Mapping[str, Any] | None, properties: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}
