"""Options of the particle method: what the thesis states, and one validated choice for what it leaves open."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from fusion.filters.resampling import RESAMPLERS
from fusion.methods.epoch_options import EpochOptions, InertialOptions, TerrainOptions, registered
from fusion.terrain.windows import WINDOWS


class ParticleOptions(TerrainOptions, InertialOptions, EpochOptions):
    """Al Assaad 2020. Values marked "thesis" are printed there; the others were chosen on several drives."""

    variant: Literal["ch2", "ch3"] = Field(
        "ch3",
        description="Chapter 2: GNSS, acceleration, map, terrain by triangles. Chapter 3: pitch and windows as well.",
    )
    particles: int = Field(
        100_000, ge=100, le=10_000_000, description="Number of particles (thesis: 100,000)."
    )
    seed: int = Field(
        0, ge=0, le=2**31 - 1, description="Seed of the random draws; the same seed gives the same result."
    )
    proposal: Literal["optimal", "transition"] = Field(
        "optimal",
        description="Importance density: the optimal one for the linear sensors, or the dynamics alone (thesis).",
    )
    resampling: Annotated[str, registered(RESAMPLERS)] = Field(
        "multinomial", description="Resampling scheme (thesis: multinomial)."
    )
    n_eff_threshold: float = Field(
        2 / 3,
        gt=0,
        le=1,
        description="Resample when N_eff falls below this share of the particles (thesis: 2/3).",
    )
    dem_window: Annotated[str | None, registered(WINDOWS)] = Field(
        None, description="Selection of terrain points; by default the variant's: ch2 tin, ch3 adjacent."
    )
