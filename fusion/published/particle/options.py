"""Options of the particle method: what the thesis states, and one validated choice for what it leaves open."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from fusion.filters.resampling import RESAMPLERS
from fusion.filters.triggers import TRIGGERS
from fusion.options import Registered
from fusion.published.epochs.terrain import TerrainOptions
from fusion.published.nine_state.options import InertialOptions, NineStateOptions
from fusion.registry import RequestMost
from fusion.terrain.windows import WINDOWS


class ParticleOptions(TerrainOptions, InertialOptions, NineStateOptions):
    """Al Assaad 2020. Values marked "thesis" are printed there; the others were chosen on several drives."""

    variant: Literal["ch2", "ch3"] = "ch3"
    """Chapter 2: GNSS, acceleration, map, terrain by triangles. Chapter 3: pitch and windows as well."""
    filter: Literal["sir", "ekf", "kf"] = "sir"
    """Particles (thesis), its extended Kalman filter, which gives the same slopes in a fraction of the time, or its
    Kalman filter, which can use neither pitch nor the direction of roads."""
    particles: Annotated[int, RequestMost(500_000)] = Field(100_000, ge=100, le=10_000_000)
    """Number of particles (thesis: 100,000)."""
    seed: int = Field(0, ge=0, le=2**31 - 1)
    """Seed of the random draws; the same seed gives the same result."""
    proposal: Literal["optimal", "transition"] = "optimal"
    """Importance density: the optimal one for the linear sensors, or the dynamics alone (thesis)."""
    resampling: Annotated[str, Registered(RESAMPLERS)] = "multinomial"
    """Resampling scheme (thesis: multinomial)."""
    resampling_trigger: Annotated[str, Registered(TRIGGERS)] = "n_eff"
    """What makes the filter resample: n_eff, entropy, or never, which is SIS (thesis: n_eff)."""
    trigger_threshold: float | None = Field(None, gt=0)
    """Threshold of the trigger; by default n_eff 2/3 of the particles (thesis), entropy 0.2 nat."""
    dem_window: Annotated[str, Registered(WINDOWS)] | None = None
    """Selection of terrain points; by default the variant's: ch2 tin, ch3 adjacent."""
