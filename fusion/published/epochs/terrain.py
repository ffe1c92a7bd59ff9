"""The elevation model as a sensor of a filter: the options that say how far to trust it, and what a driver must know.

How a filter looks at it, along which road and in which window, is the filter's own.
"""

from __future__ import annotations

from pydantic import Field

from fusion.messages import say
from fusion.methods.base import Options
from fusion.terrain.dem import Dem


class TerrainOptions(Options):
    """The elevation model as a sensor; each method adds its own ``dem_window``."""

    dem_sigma_m: float = Field(6.0, gt=0)
    """Accuracy of the terrain's height, m (thesis: 6 World 30, 12.6 ASTER)."""
    dem_correlation_m: float = Field(300.0, ge=0)
    """Terrain errors hang together this far, m: an epoch counts for dx / (dx + 2 L)."""
    dem_min_quality: int = Field(0, ge=0, le=200)
    """Scenes that an ASTER post needs to count, by its quality layer (..._num.tif); 1 leaves out posts filled from
    other sources, 0 keeps all."""


def quality_warnings(dem: Dem, options: TerrainOptions) -> list[str]:
    """A threshold that some raster knows nothing of."""
    if not options.dem_min_quality or not dem.without_quality:
        return []
    return [say("method.no_quality", names=", ".join(dem.without_quality))]
