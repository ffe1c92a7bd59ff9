"""The files of ``versant track``: the positions of logs as CSV or GeoJSON. Knows no roads and no slopes."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from app.core.text import COORDINATE_DIGITS, rounded
from app.drives.outputs.track import time_text
from fusion.gnss.positioning import SolvedEpochs
from fusion.types import Floats, GnssFix

COLUMNS = ("time_s", "lat_deg", "lon_deg", "height_ell_m", "alt_msl_m", "h_acc_m", "v_acc_m")
COVARIANCES = (("e", "e"), ("e", "n"), ("e", "u"), ("n", "n"), ("n", "u"), ("u", "u"))
"""Parts of the covariance of a solver's position, m^2: east, north, up."""
SOLVED_COLUMNS = (*(f"cov_{a}{b}_m2" for a, b in COVARIANCES), "predicted", "reflected")
_DIGITS = {"lat_deg": 9, "lon_deg": 9}  # degrees: a tenth of a millimetre
_OTHER_DIGITS = 3  # milliseconds, millimetres
GAP_S = 10.0
"""Positions further apart in time are not joined by a line."""


@dataclass(frozen=True)
class Positions:
    """The positions of one log; ``outages_s`` are known interruptions, ``geoid`` what ``alt_msl_m`` is above.

    ``report`` says how they were computed, ``solved`` what a solver of raw measurements knows of each, ``warnings``
    what a person should know of the log.
    """

    log: str
    fix: GnssFix
    outages_s: Floats
    geoid: str
    report: Mapping[str, Any] = field(default_factory=dict)
    solved: SolvedEpochs | None = None
    warnings: Sequence[str] = ()


def write_csv(tracks: Sequence[Positions], path: Path) -> None:
    """One row per position, an empty cell for unknown; with several logs a last column ``log``.

    Where a solver computed positions: its covariances, whether an epoch is predicted, and the probability of having
    been reflected by satellite (``G07=0.12 G21=0.95``).
    """
    several = len(tracks) > 1
    computed = any(one.solved for one in tracks)
    columns = [*COLUMNS, *(SOLVED_COLUMNS if computed else ()), *(["log"] if several else ())]
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(columns)
        for one in tracks:
            cells = [_cells(getattr(one.fix, name), _DIGITS.get(name, _OTHER_DIGITS)) for name in COLUMNS]
            cells += _solved_cells(one) if computed else []
            for row in zip(*cells, strict=True):
                table.writerow([*row, one.log] if several else row)


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


def _cells(values: Floats, digits: int) -> list[str]:
    return ["" if not np.isfinite(v) else f"{v:.{digits}f}" for v in values]


def _solved_cells(one: Positions) -> list[list[str]]:
    if one.solved is None:
        return [[""] * len(one.fix) for _ in SOLVED_COLUMNS]
    covariances = [_cells(values, _OTHER_DIGITS) for values in _covariances(one.solved)]
    predicted = ["1" if flag else "0" for flag in one.solved.predicted]
    reflected = [
        " ".join(f"{name}={share:.2f}" for name, share in by_satellite.items() if np.isfinite(share))
        for by_satellite in one.solved.reflected
    ]
    return [*covariances, predicted, reflected]


def _covariances(solved: SolvedEpochs) -> list[Floats]:
    axis = {"e": 0, "n": 1, "u": 2}
    return [solved.covariance[:, axis[a], axis[b]] for a, b in COVARIANCES]


def _path(one: Positions) -> dict[str, Any]:
    time_s = one.fix.time_s
    broken = np.diff(time_s) > GAP_S
    # A gap is named by the time at which the next piece begins.
    outages = np.searchsorted(time_s, one.outages_s)
    cuts = np.union1d(np.flatnonzero(broken) + 1, outages[(outages > 0) & (outages < len(time_s))])
    points = np.round(np.column_stack([one.fix.lon_deg, one.fix.lat_deg]), COORDINATE_DIGITS)
    lines = [piece.tolist() for piece in np.split(points, cuts) if len(piece) > 1]
    geometry = {"type": "MultiLineString", "coordinates": lines} if lines else None
    properties = {"log": one.log, "positions": len(one.fix), "geoid": one.geoid}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _points(one: Positions) -> list[dict[str, Any]]:
    out = []
    covariances = _covariances(one.solved) if one.solved else []
    for k in range(len(one.fix)):
        place = [
            round(float(getattr(one.fix, name)[k]), COORDINATE_DIGITS) for name in ("lon_deg", "lat_deg")
        ]
        properties: dict[str, Any] = {"log": one.log, "time": time_text(float(one.fix.time_s[k]))}
        for name in COLUMNS[3:]:
            properties[name] = rounded(float(getattr(one.fix, name)[k]), _OTHER_DIGITS)
        if one.solved is not None:
            properties |= {
                f"cov_{a}{b}_m2": rounded(float(values[k]), _OTHER_DIGITS)
                for (a, b), values in zip(COVARIANCES, covariances, strict=True)
            }
            properties["predicted"] = bool(one.solved.predicted[k])
            properties["reflected"] = {
                name: rounded(share, 2) for name, share in one.solved.reflected[k].items()
            }
        geometry = {"type": "Point", "coordinates": place}
        out.append({"type": "Feature", "geometry": geometry, "properties": properties})
    return out
