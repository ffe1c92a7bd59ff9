"""Options of the three GPS/INS filters: what the thesis states, and one validated choice for what it leaves open."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from fusion.published.epochs.terrain import TerrainOptions

HeadingPolicy = Literal["command", "overwrite", "measurement"]


class GpsInsOptions(TerrainOptions):
    """Saadaoui 2011, chapter 4. Values marked "thesis" are printed there; the others were chosen on several drives."""

    period_s: float = Field(0.5, gt=0, le=10)
    """Shortest time between two epochs, s; samples between them are averaged (thesis: 1)."""
    command_at: Literal["midpoint", "start"] = "midpoint"
    """Speed and heading of a step: mean of its two ends, or those at its start (thesis)."""
    gnss_sigma_m: float = Field(12.5, gt=0, le=1000)
    """Accuracy of a position per axis where the log states none, m (thesis: 10 to 15)."""
    fix_correlation_s: float = Field(5.0, ge=0, le=1000)
    """GNSS position errors hang together this long, s: a fix counts for dt / (dt + 2 tau) (thesis: 0)."""
    process_sigma_m: float = Field(0.5, gt=0, le=100)
    """Process noise of position per axis, m per root second (thesis: 0.5)."""
    drift_share: float = Field(0.01, ge=0, le=1)
    """Spread that dead reckoning adds in an outage, as a share of the way since the last fix (thesis: 0)."""
    heading_sigma_rad: float = Field(0.05, gt=0, le=3.2)
    """Accuracy of the heading where the log states none, rad."""
    align_heading: bool = True
    """Turn the yaw sensor to the course over the whole drive before filtering."""
    hold_s: float = Field(5.0, ge=0, le=60)
    """How long the last speed and heading stand in for missing ones, s; widened with their age."""
    gate_probability: float = Field(0.999, gt=0, le=1)
    """Share of good fixes that the innovation gate lets pass (chi-square); 1 takes every fix (thesis)."""
    restart_after: int = Field(3, ge=1, le=1000)
    """Fixes rejected in a row after which the filter starts anew at the last."""
    min_speed_mps: float = Field(1.0, ge=0, le=20)
    """Below this speed pitch and course say nothing, m/s."""
    match_gate: float = Field(2.55, gt=0)
    """Largest Mahalanobis distance of a map match."""
    map_sigma_m: float = Field(4.0, gt=0)
    """Accuracy of the map's position, lane offset included, m."""
    map_sigma_rad: float = Field(0.3, gt=0)
    """Accuracy of the map's direction, rad."""
    min_epochs: int = Field(3, ge=2, le=100)
    """Altitudes that a slope needs."""

    height: Literal["gnss", "dem"] = "gnss"
    """What measures the height: GNSS altitude (the DEM where the log has none), or the DEM."""
    climb: Literal["all", "pitch", "doppler", "none"] = "all"
    """Command of the height: pitch times speed and vertical Doppler velocity, one of them, or none."""
    level_pitch: bool = True
    """Take the pitch sensor's mount off before filtering."""
    pitch_sigma_rad: float = Field(0.012, gt=0)
    """Body motion on the suspension, added to the sensor's accuracy, rad."""
    doppler_sigma_mps: float = Field(0.2, gt=0)
    """Velocity accuracy of a log that states none, m/s."""
    gnss_v_sigma_m: float = Field(5.0, gt=0)
    """Vertical accuracy of a log that states none, m."""
    altitude_correlation_s: float = Field(60.0, ge=0)
    """GNSS altitude errors hang together this long, s: an epoch counts for dt / (dt + 2 tau)."""


class KalmanOptions(GpsInsOptions):
    """Algorithm 1: two states."""

    heading: Literal["command"] = "command"
    """What the INS heading is: a command, for two states do not hold it."""
    command_form: Literal["components", "printed"] = "components"
    """The command B u: of u = [v cos, v sin], or of u = [v, heading] as printed, which runs away."""


class HeadingOptions(GpsInsOptions):
    """What the filters with the heading as third state share."""

    heading: HeadingPolicy = "measurement"
    """What the INS heading is: a measurement of the third state, a value that overwrites it, or a command (two
    states)."""
    heading_reset: bool = True
    """Overwriting the heading resets its variance and covariances; without, as the thesis may mean it."""
    heading_walk_rad: float = Field(0.3, gt=0, le=10)
    """Process noise of the heading while moving, rad per root second."""


class ExtendedOptions(HeadingOptions):
    """Algorithm 2."""

    innovation: Literal["residual", "printed"] = "residual"
    """What the gain multiplies: Z - h(x), or h(x) as printed, which diverges."""
    jacobian: Literal["derivative", "printed"] = "derivative"
    """Heading column of the Jacobian: the derivative, or sine and cosine exchanged and without dt as printed."""


class UnscentedOptions(HeadingOptions):
    """Algorithm 3."""

    alpha: float = Field(1e-3, ge=1e-4, le=1e3)
    """Spread of the sigma points (thesis: 1e-4 to 1; printed: 1e3)."""
    beta: float = Field(2.0, ge=0, le=10)
    """Weight of the centre in the covariance (thesis: 2)."""
    kappa: float = Field(-1.0, gt=-2, le=10)
    """Second spread, added to the number of states (thesis: -1)."""
    redraw: bool = True
    """Draw new sigma points after the process noise is added; without, as printed, it is added last."""
