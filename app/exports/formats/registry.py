"""Every kind of file that the stored map is exported as, by name: outputs, tables of ways, tiles, handovers.

``versant export`` and ``/v1/exports`` take the same ones. A new kind of file is an output (``outputs``) or a
handover (``handovers``), and is here by itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, cast

from pydantic import Field, model_validator

from app.exports.formats.base import Handover, NoOptions, options_of
from app.exports.formats.handovers import HANDOVERS
from app.exports.formats.outputs import OUTPUTS, WAY_OUTPUTS, Output, Stated
from app.exports.source import Source
from app.exports.writing.pmtiles_archive import write_pmtiles
from app.map.attribution import OSM_LICENSE
from app.network.cells import ZOOM
from fusion.errors import BadOptionsError, UnknownNameError
from fusion.registry import Registry


class Format(Protocol):
    """A kind of file."""

    name: str
    suffixes: tuple[str, ...]
    """The first is the usual one."""
    media_type: str
    description: str
    options: type[NoOptions]
    holds: str
    """What there are many of in it."""
    filters: frozenset[str]
    """Which of ``driven``, ``gaps`` and ``region`` it can be narrowed by; the box is for all."""

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """Write ``path`` anew; how many things it holds. The same data and options give the same bytes."""
        ...

    def companions(self, path: Path, stated: Stated) -> Mapping[Path, str]:
        """The small files that stand beside ``path``, with their text."""
        ...


ALL_FILTERS = frozenset({"driven", "gaps", "region"})


class _OfSegments:
    """An output of segments."""

    options: type[NoOptions] = NoOptions
    holds = "segments"
    filters = ALL_FILTERS

    def __init__(self, output: Output) -> None:
        self.name, self.media_type, self.description = output.name, output.media_type, output.description
        self.suffixes: tuple[str, ...] = (output.suffix,)
        self._output = output

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """As ``Format``."""
        return self._output.write(source.asked_segments(), path, stated)

    def companions(self, path: Path, stated: Stated) -> Mapping[Path, str]:
        """As ``Format``."""
        return self._output.companions(path, stated)


class _OfWays(_OfSegments):
    """A table of whole ways."""

    holds = "ways"
    filters = frozenset({"driven", "region"})

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """As ``Format``."""
        return self._output.write(source.ways(), path, stated)  # type: ignore[arg-type]  # its records are ways


class TileOptions(NoOptions):
    """Which tiles."""

    min_zoom: int = Field(6, ge=0, le=ZOOM, description="The lowest zoom.")
    max_zoom: int = Field(ZOOM, ge=0, le=ZOOM, description="The highest zoom; clients enlarge its tiles.")

    @model_validator(mode="after")
    def _in_order(self) -> TileOptions:
        if self.min_zoom > self.max_zoom:
            raise ValueError("min_zoom must not exceed max_zoom")
        return self


class PmTiles:
    """The vector tiles as the service shows them."""

    name = "pmtiles"
    suffixes: tuple[str, ...] = (".pmtiles",)
    media_type = "application/vnd.pmtiles"
    description = "PMTiles 3: the vector tiles in one file, which maps read without any service"
    options: type[NoOptions] = TileOptions
    holds = "tiles"
    filters: frozenset[str] = frozenset()

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """As ``Format``; counts tiles."""
        # A module of routes: who exports no tiles need not load it.
        from app.map.tiles.routes import SEGMENT_FIELDS, kinds  # noqa: PLC0415
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


class _OfHandover:
    """What a consumer reads. Few of their forms have a place for what is stated: it stands beside each."""

    holds = "entries"
    filters: frozenset[str] = frozenset()

    def __init__(self, handover: Handover) -> None:
        self.name, self.media_type = handover.name, handover.media_type
        self.description = f"{handover.description} ({handover.consumer})"
        self.suffixes, self.options = handover.suffixes, handover.options
        self.handover = handover

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """As ``Format``."""
        return self.handover.write(source, path, stated, options)

    def companions(self, path: Path, stated: Stated) -> Mapping[Path, str]:
        """The origin of the data, as JSON."""
        said = stated.get("provenance")
        return {} if said is None else {path.with_name(f"{path.name}.provenance.json"): said + "\n"}


_FORMATS: tuple[Format, ...] = (
    *(_OfSegments(output) for _, output in OUTPUTS.items()),
    *(_OfWays(output) for output in WAY_OUTPUTS),
    PmTiles(),
    *(_OfHandover(handover) for _, handover in HANDOVERS.items()),
)
FORMATS: Registry[Format] = Registry("format of exports")
for _format in _FORMATS:
    FORMATS.add(_format.name, _format)


def format_for(path: Path, name: str | None = None) -> Format:
    """The format of this name, or the one that the file's suffix stands for.

    A suffix stands for an output of segments before all others; where several others have it, one has to be named.
    Raises ``UnknownNameError``.
    """
    if name is not None:
        return FORMATS[name]
    suffix = path.suffix.lower()
    fitting = [one for _, one in FORMATS.items() if any(path.name.lower().endswith(s) for s in one.suffixes)]
    usual = [one for one in fitting if suffix in one.suffixes and one.name in OUTPUTS]
    if usual or len(fitting) == 1:
        return (usual or fitting)[0]
    if fitting:
        names = " or ".join(one.name for one in fitting)
        raise UnknownNameError(f"A file {path.suffix!r} may be of several formats. Name one: {names}.")
    known = ", ".join(dict.fromkeys(s for _, one in FORMATS.items() for s in one.suffixes))
    raise UnknownNameError(f"No output is called {path.suffix!r}. Choose one of: {known}.")


def checked_options(chosen: Format, given: Mapping[str, Any], *, local: bool) -> NoOptions:
    """The format's options; ``BadOptionsError`` says which one is wrong and what there is.

    Without ``local``, options that name files of this machine are refused.
    """
    return options_of(cast("Handover", chosen), given, local=local)  # whose name and options it reads


def check_filters(chosen: Format, **asked: bool) -> None:
    """``BadOptionsError`` that names the filter, for one that the format cannot be narrowed by."""
    for name, wanted in asked.items():
        if wanted and name not in chosen.filters:
            raise BadOptionsError(
                f"{name}: the format {chosen.name} has no such filter; bbox is for all formats.", where=name
            )
