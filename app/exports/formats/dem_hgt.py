"""HGT tiles in which roads have their measured heights, for routers that differentiate an elevation model.

Consumers, each by its sources. Valhalla (``src/skadi/sample.cc``): ``N49/N49E008.hgt`` of 3601 x 3601 posts below
``additional_data.elevation``, sampled bilinearly; edges below 180 m and bridges at their ends alone, others every 60 m
(``src/mjolnir/elevationbuilder.cc``). GraphHopper (``HGTProvider``, ``HeightTile``): ``N49E008.hgt.zip`` in the folder
of ``graph.elevation.provider: hgt``, sampled at nodes, bilinearly where ``graph.elevation.interpolate: bilinear`` is
set. BRouter (``PosUnifier``, ``ElevationRaster``): ``N49E008.hgt`` in the folder of elevations, of 3601 or 1201 posts,
sampled at nodes bilinearly and kept as quarters of a metre. Grammar of a tile: big-endian signed 16 bit whole metres,
row after row from the north-west corner; -32768 is void.
"""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from app.core.messages import say
from app.exports.format import ALL_FILTERS, Format, Stated, nothing_beside
from app.exports.writing.relief import ArcSecond, Crossings, ReliefOptions, about, relief_of

if TYPE_CHECKING:
    from app.exports.source import Source


class Router(StrEnum):
    """Whose folders and names."""

    VALHALLA = "valhalla"
    GRAPHHOPPER = "graphhopper"
    BROUTER = "brouter"


class HgtOptions(ReliefOptions):
    """Which tiles for whom."""

    router: Router = Field(
        Router.VALHALLA,
        description="valhalla: N49/N49E008.hgt; graphhopper: N49E008.hgt.zip; brouter: N49E008.hgt.",
    )
    arc_seconds: ArcSecond = Field(
        1,
        description="1: 3601 posts a side, 3: 1201, which Valhalla does not read.",
    )

    @property
    def levels(self) -> Crossings:
        """Valhalla samples along roads, where decks are at stake; the others at nodes alone."""
        usual = Crossings.UPPER if self.router is Router.VALHALLA else Crossings.SHARED
        return self.crossings or usual


class DemHgt(Format):
    """Whole tiles of a degree, wherever a road was measured."""

    name = "dem-hgt"
    consumer = "Valhalla, GraphHopper, BRouter (HGT tiles)"
    suffixes = (".hgt.zip",)
    media_type = "application/zip"
    description = (
        f"Elevation model with the measured heights of roads along them, and what changed ({consumer})"
    )
    options = HgtOptions
    holds = "tiles"
    filters = ALL_FILTERS
    companions = nothing_beside

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """Write the archive; its tiles. ``RoadsError`` where no height of a road is known."""
        from fusion.terrain.corrected.blocks import Blocks  # noqa: PLC0415 - with it compilers and scipy are loaded
        from fusion.terrain.corrected.files import Layout, degrees_with, write_hgt  # noqa: PLC0415
        from fusion.terrain.corrected.grids import ArcSeconds  # noqa: PLC0415

        with relief_of(source, options, whole=True, one_post=options.router is Router.GRAPHHOPPER) as relief:
            tiles = degrees_with(relief.roads, options.blend_m)
            shares = [0.0]

            def progress(stage: str, share: float) -> None:
                shares[0] = share
                source.on_progress(share)

            blocks = Blocks(
                relief.terrain, ArcSeconds(options.arc_seconds), lambda: source.on_progress(shares[0])
            )
            text = about(stated, relief, options)
            void = write_hgt(path, blocks, tiles, Layout(options.router.value), text, progress)
            if void:
                source.note(say("export.void_tiles", n=len(void), all=len(tiles), name=str(void[0])))
            return len(tiles)
