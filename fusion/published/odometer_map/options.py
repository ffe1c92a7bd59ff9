"""Options of the method ``odometer-map``: what the paper states, and one validated choice for what it leaves open."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from fusion.options import Registered
from fusion.published.epochs.terrain import TerrainOptions
from fusion.published.nine_state.options import NineStateOptions
from fusion.terrain.windows import WINDOWS

CHI_SQUARE_3_95 = 7.815
"""95 % of a chi-square with three degrees of freedom lie below."""


class OdometerMapOptions(TerrainOptions, NineStateOptions):
    """Lahrech et al. 2005. Values marked "paper" are printed there; the others were chosen on several drives."""

    policy: Literal["paper", "always"] = "paper"
    """GNSS alone while there is a fix, wheels and map without (paper), or everything at each epoch."""
    discretisation: Literal["thesis", "exact"] = "exact"
    """Position row as printed (1), or with the a dt^2/2 of constant acceleration; wheels measure v_k dt (thesis) or the
    mean velocity of the step."""
    match_gate: float = Field(math.sqrt(CHI_SQUARE_3_95), gt=0)
    """Largest Mahalanobis distance of a map match: 95 % of chi-square with 3 degrees of freedom."""
    doppler: bool = False
    """Use velocity, Doppler or else the fixes' own rate of change; by default with policy always, and not with the
    paper's, which is position only."""
    sigma_vel_mps: float = Field(0.2, gt=0)
    """Process noise of horizontal velocity, m/s per root second."""
    sigma_pos_m: float = Field(0.1, gt=0)
    """Process noise of horizontal position, m per root second."""
    sigma_acc_up_mps2: float = Field(0.005, gt=0)
    """Process noise of vertical acceleration, m/s2 per root second."""
    sigma_vel_up_mps: float = Field(0.3, gt=0)
    """Process noise of vertical velocity, m/s per root second."""
    gnss_correlation_s: float = Field(1.0, ge=0)
    """GNSS altitude errors hang together this long, s: an epoch counts for dt / (dt + 2 tau)."""
    road_grade_sigma: float = Field(0.05, gt=0, le=1)
    """Grade of roads, one sigma, rise over run: bounds the climb where nothing measures height (paper: none)."""
    track_width_m: float = Field(1.5, ge=0.3, le=4)
    """Distance between the rear wheels' contact points, m."""
    wheel_radius_left_m: float = Field(0.3, ge=0.05, le=1.5)
    """Radius that the left rear wheel rolls on, m."""
    wheel_radius_right_m: float = Field(0.3, ge=0.05, le=1.5)
    """Radius that the right rear wheel rolls on, m."""
    wheel_ticks_per_turn: int = Field(96, ge=0, le=100_000)
    """Ticks that a turn of a wheel counts; 0 for readings without steps."""
    wheel_error_share: float = Field(0.1, gt=0, le=1)
    """Error of what both wheels, or a speed signal, measure over an epoch, as a share of it, white (paper: "reliability
    90 %")."""
    wheel_each_error_share: float = Field(0.01, gt=0, le=1)
    """The like that each wheel has for itself, white."""
    calibrate: bool = False
    """Estimate lasting errors of the radii, or of a speed signal, along the drive; by default with policy always, and
    not with the paper's."""
    wheel_scale_sigma: float = Field(0.05, ge=0, le=0.5)
    """Lasting error that both radii or a speed signal may have, a share."""
    wheel_balance_sigma: float = Field(0.005, ge=0, le=0.5)
    """Lasting error that each radius may have for itself, a share."""
    speed_sigma_mps: float = Field(0.1, gt=0, le=10)
    """White noise of a speed signal, m/s."""
    inertial_turns: bool = True
    """Where the log has a speed signal but not two wheels, turns by its gyroscope or yaw (paper: none)."""
    match_within_m: float = Field(50.0, gt=0)
    """No map match where the position's sigma exceeds this, m: any road would do."""
    map_correction: Literal["line", "point"] = "line"
    """What a matched road says: position across it and direction, or the matched point as a whole (paper), along the
    road too."""
    map_step_m: float | None = Field(None, gt=0.1, le=100)
    """Spacing of a map made of points, m (paper: 5); by default exact."""
    dem: Literal["missing", "always", "never"] = "missing"
    """Use the terrain's heights: where the log has no altitude, always, or never (paper)."""
    dem_window: Annotated[str, Registered(WINDOWS)] = "adjacent"
    """Selection of terrain points."""

    @model_validator(mode="before")
    @classmethod
    def _by_policy(cls, given: Any) -> Any:
        """What is not given follows the policy."""
        if not isinstance(given, dict):
            return given
        always = given.get("policy") == "always"
        return {"doppler": always, "calibrate": always, **given}

    @property
    def lasting_sigmas(self) -> tuple[float, float]:
        """Lasting errors to estimate: of both wheels, and of each for itself; zero without calibration."""
        return (self.wheel_scale_sigma, self.wheel_balance_sigma) if self.calibrate else (0.0, 0.0)
