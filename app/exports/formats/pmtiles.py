"""PMTiles 3: the vector tiles as the service shows them, in one archive."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field, model_validator

from app.exports.format import Format, NoOptions, Stated
from app.exports.writing.pmtiles_archive import write_pmtiles
from app.map.attribution import OSM_LICENSE
from app.network import ZOOM

if TYPE_CHECKING:
    from app.exports.source import Source


class TileOptions(NoOptions):
    """Which tiles."""

    min_zoom: int = Field(6, ge=0, le=ZOOM, description="The lowest zoom.")
    max_zoom: int = Field(ZOOM, ge=0, le=ZOOM, description="The highest zoom; clients enlarge its tiles.")

    @model_validator(mode="after")
    def _in_order(self) -> TileOptions:
        if self.min_zoom > self.max_zoom:
            raise ValueError("min_zoom must not exceed max_zoom")
        return self


class PmTiles(Format):
    """The vector tiles as the service shows them."""

    name = "pmtiles"
    suffixes = (".pmtiles",)
    media_type = "application/vnd.pmtiles"
    description = "PMTiles 3: the vector tiles in one file, which maps read without any service"
    options = TileOptions
    holds = "tiles"

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """As ``Format``; counts tiles."""
        # It brings what a service stands on: who exports no tiles need not load it.
        from app.map.tiles.documents import SEGMENT_FIELDS, kinds  # noqa: PLC0415
        from app.map.tiles.store import LAYER  # noqa: PLC0415

        zooms = (options.min_zoom, options.max_zoom)
        layer = {"id": LAYER, "fields": kinds(SEGMENT_FIELDS), "minzoom": zooms[0], "maxzoom": zooms[1]}
        metadata = {
            "name": "Versant road slopes",
            "description": "Slopes of road segments, measured by vehicles",
            "type": "overlay",
            "version": "1",
            "license": OSM_LICENSE,
            **stated,
            "vector_layers": [layer],
        }
        return write_pmtiles(
            path, source.tiles(zooms), metadata=metadata, zooms=zooms, bounds_deg=source.extent()
        )

    def companions(self, path: Path, stated: Stated) -> Mapping[Path, str]:
        """None: the archive holds everything."""
        return {}
