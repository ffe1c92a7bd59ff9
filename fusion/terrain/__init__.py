"""Terrain: elevation rasters as one surface, triangulated or as planes fitted around road segments."""

from fusion.terrain.dem import Dem
from fusion.terrain.patch import DemPatch
from fusion.terrain.plane import PlaneModel, fit_plane
from fusion.terrain.raster import refuse_void
from fusion.terrain.windows import WINDOWS, DemWindow, HeightModel, TinModel, dem_slopes

__all__ = [
    "WINDOWS",
    "Dem",
    "DemPatch",
    "DemWindow",
    "HeightModel",
    "PlaneModel",
    "TinModel",
    "dem_slopes",
    "fit_plane",
    "refuse_void",
]
