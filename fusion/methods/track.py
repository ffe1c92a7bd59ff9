"""Collecting a filter's epochs into a track."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from fusion.frames import LocalProjection
from fusion.methods.epoch_filter import Estimate
from fusion.methods.epochs import Epochs
from fusion.methods.kinematics import VX, VY, X, Y, Z
from fusion.types import Track


class Matched(Protocol):
    """The part of a map match that a track keeps."""

    @property
    def segment(self) -> int:
        """Index of the segment in the network."""
        ...


class TrackBuilder:
    """Columns of a track, filled row by row; rows that were never put are left out."""

    def __init__(self, rows: int) -> None:
        self._columns = {
            name: np.full(rows, np.nan)
            for name in (
                "time_s", "x", "y", "alt_m", "h_sigma_m", "alt_sigma_m", "speed_mps", "heading_rad", "pitch_rad",
                "pitch_sigma_rad", "distance_m",
            )
        }  # fmt: skip
        self._segment = np.full(rows, -1, np.int64)
        self._has_gnss = np.zeros(rows, bool)
        self._starts = np.zeros(rows, bool)

    def put(
        self,
        row: int,
        epochs: Epochs,
        estimate: Estimate,
        match: Matched | None,
        distance_m: float,
        lift_m: float,
    ) -> None:
        """Record an epoch; ``lift_m`` is the antenna's height above the road."""
        s = estimate.state
        values = {
            "time_s": epochs.time_s[row],
            "x": s[X],
            "y": s[Y],
            "alt_m": s[Z] - lift_m,
            "h_sigma_m": estimate.h_sigma_m,
            "alt_sigma_m": estimate.z_sigma_m,
            "speed_mps": np.hypot(s[VX], s[VY]),
            "heading_rad": np.mod(np.pi / 2 - estimate.heading_rad, 2 * np.pi),
            "pitch_rad": estimate.pitch_rad,
            "pitch_sigma_rad": estimate.pitch_sigma_rad,
            "distance_m": distance_m,
        }
        for name, value in values.items():
            self._columns[name][row] = value
        self._segment[row] = -1 if match is None else match.segment
        self._has_gnss[row] = epochs.has_gnss[row]

    def mark_start(self, row: int) -> None:
        """Say that the estimate begins anew at this row."""
        self._starts[row] = True

    def build(self, projection: LocalProjection) -> Track:
        """The track in degrees."""
        rows = np.isfinite(self._columns["time_s"])
        columns = {name: column[rows] for name, column in self._columns.items()}
        lon, lat = projection.to_lonlat(columns.pop("x"), columns.pop("y"))
        return Track(
            lat_deg=lat,
            lon_deg=lon,
            segment=self._segment[rows],
            has_gnss=self._has_gnss[rows],
            starts=self._starts[rows],
            **columns,
        )
