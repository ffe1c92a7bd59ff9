"""A GeoTIFF (COG) of the elevation model in which roads have their measured heights, to the millimetre.

Whatever reads rasters by GDAL reads it, Versant's own ``import-dem`` among them. Band 1 is the height, 32 bit floating
point, NaN void; band 2 what became of each post. Posts lie at whole seconds of arc, as those of HGT tiles.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from app.core.text import dumps
from app.exports.format import ALL_FILTERS, Format, Stated, nothing_beside
from app.exports.writing.relief import ArcSecond, ReliefOptions, relief_of

if TYPE_CHECKING:
    from app.exports.source import Source


class GeoTiffOptions(ReliefOptions):
    """Which posts."""

    arc_seconds: ArcSecond = Field(1, description="From post to post: 1 or 3.")


class DemGeoTiff(Format):
    """All posts of the box around the roads that are asked for, and what is beside them."""

    name = "dem-geotiff"
    suffixes = (".tif",)
    media_type = "image/tiff; application=geotiff; profile=cloud-optimized"
    description = (
        "GeoTIFF (COG): elevation model with the measured heights of roads along them; band 2: what changed"
    )
    options = GeoTiffOptions
    holds = "changed posts"
    filters = ALL_FILTERS
    companions = nothing_beside

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """Write the file; the number of posts that were changed. ``RoadsError`` where no height of a road is known."""
        from fusion.terrain.corrected.blocks import Blocks  # noqa: PLC0415 - with it compilers and scipy are loaded
        from fusion.terrain.corrected.files import bounds_of, write_geotiff  # noqa: PLC0415
        from fusion.terrain.corrected.grids import ArcSeconds  # noqa: PLC0415

        tags = {key.upper(): value for key, value in stated.items()} | {
            "OPTIONS": dumps(options.model_dump(mode="json"))
        }
        with relief_of(source, options, whole=False) as relief:
            blocks = Blocks(relief.terrain, ArcSeconds(options.arc_seconds))
            bounds = bounds_of(relief.roads, options.blend_m)
            return write_geotiff(
                path, blocks, bounds, relief.datum, tags, lambda stage, share: source.on_progress(share)
            )
