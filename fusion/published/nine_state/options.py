"""Options of every filter over the nine states, and those of the filters that take acceleration and pitch as well.

Defaults here serve most; a method that needs others overrides the field. What belongs to one method stands with it.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from fusion.methods.base import Options


class NineStateOptions(Options):
    """Motion, GNSS and map. Values marked "thesis" are Al Assaad's (2020); the others were chosen on several drives."""

    period_s: float = Field(0.5, gt=0, le=10)
    """Shortest time between two epochs, s; samples between them are averaged (thesis: 1)."""
    discretisation: Literal["thesis", "exact"] = "thesis"
    """Position row as printed (2.1), or with the a dt^2/2 of constant acceleration."""
    match_gate: float = Field(2.55, gt=0)
    """Largest Mahalanobis distance of a map match (thesis: 2.55)."""
    antenna_height_m: float = Field(1.55, ge=0, le=10)
    """Antenna above the road, m (thesis: 1.55)."""
    doppler: bool = True
    """Use velocity, Doppler or else the fixes' own rate of change; the thesis uses none."""
    min_epochs: int = Field(3, ge=2, le=100)
    """Altitudes that a slope needs (thesis: 3; its experiment 4)."""
    min_speed_mps: float = Field(1.0, ge=0)
    """Below this speed pitch and heading say nothing, m/s."""

    sigma_acc_mps2: float = Field(1.2, gt=0)
    """Process noise of horizontal acceleration, m/s2 per root second."""
    sigma_vel_mps: float = Field(0.5, gt=0)
    """Process noise of horizontal velocity, m/s per root second."""
    sigma_pos_m: float = Field(0.5, gt=0)
    """Process noise of horizontal position, m per root second."""
    sigma_acc_up_mps2: float = Field(0.2, gt=0)
    """Process noise of vertical acceleration, m/s2 per root second."""
    sigma_vel_up_mps: float = Field(0.1, gt=0)
    """Process noise of vertical velocity, m/s per root second."""
    sigma_pos_up_m: float = Field(0.05, gt=0)
    """Process noise of altitude, m per root second."""

    gnss_h_sigma_m: float = Field(2.5, gt=0)
    """Horizontal accuracy (2-D) of a log that states none, m."""
    gnss_v_sigma_m: float = Field(5.0, gt=0)
    """Vertical accuracy of a log that states none, m."""
    gnss_correlation_s: float = Field(2.0, ge=0)
    """GNSS altitude errors hang together this long, s: an epoch counts for dt / (dt + 2 tau)."""
    doppler_sigma_mps: float = Field(0.2, gt=0)
    """Velocity accuracy of a log that states none, m/s."""
    rate_sigma_mps: float = Field(0.5, gt=0)
    """Best accuracy of a velocity taken from the fixes' rate of change, m/s; scatter widens it."""
    start_altitude_sigma_m: float = Field(0.5, gt=0)
    """Spread of altitude in a new state, m: the receiver's own datum is kept, slopes need no other."""
    map_sigma_m: float = Field(4.0, gt=0)
    """Accuracy of the map's position, lane offset included, m."""
    map_sigma_rad: float = Field(0.2, gt=0)
    """Accuracy of the map's direction, rad."""


class InertialOptions(Options):
    """Acceleration and pitch."""

    level_pitch: bool = True
    """Take the pitch sensor's mount off before filtering."""
    acc_sigma_mps2: float = Field(0.3, gt=0)
    """Accuracy of acceleration, m/s2."""
    pitch_sigma_rad: float = Field(0.0095, gt=0)
    """Body motion on the suspension, added to the sensor's accuracy, rad."""
    pitch_correlation_s: float = Field(0.3, ge=0)
    """Body motion hangs together this long, s: an epoch counts for dt / (dt + 2 tau)."""
