"""The files that segments are written to. A new kind of file is one new module and one line here.

Modules import what they write with where they write: to list the outputs must cost nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Protocol

from app.core.text import whole_file
from app.exports.formats.csv_table import CsvOutput, WayCsvOutput
from app.exports.formats.flatgeobuf import FlatGeobufOutput
from app.exports.formats.geojson import GeoJsonOutput
from app.exports.formats.geoparquet import GeoParquetOutput, WayParquetOutput
from app.exports.formats.gpkg import GeoPackageOutput
from app.map.attribution import attribution
from app.map.segment import HEIGHT_DATUM, Segment
from fusion.errors import UnknownNameError
from fusion.registry import Registry

Stated = Mapping[str, str]
"""What a file says of all its segments: ``attribution``, whose data it is, and ``height_datum``, where known; from a
database ``changed_at`` as well, when its data last changed, and ``provenance``, a JSON text (``app.exports``)."""


def stated(source: str, height_datum: str | None) -> dict[str, str]:
    """The statements that every output makes, by name."""
    return {"attribution": source} | ({} if height_datum is None else {"height_datum": height_datum})


class Output(Protocol):
    """A kind of file."""

    name: str
    suffix: str
    """With its dot, lower case; a file's suffix chooses the output."""
    media_type: str
    description: str

    def write(self, segments: Iterable[Segment], path: Path, stated: Stated) -> int:
        """Write all segments, replacing ``path``; returns their number. ``stated`` goes where the format has a place.

        The iterable is consumed once and never held whole.
        """
        ...

    def companions(self, path: Path, stated: Stated) -> Mapping[Path, str]:
        """The small files that stand beside ``path``, with their text: how it is drawn, what it has no place for."""
        ...


OUTPUTS: Registry[Output] = Registry("output")
for _output in (GeoJsonOutput(), GeoParquetOutput(), GeoPackageOutput(), FlatGeobufOutput(), CsvOutput()):
    OUTPUTS.add(_output.name, _output)

WAY_OUTPUTS: tuple[Output, ...] = (WayParquetOutput(), WayCsvOutput())
"""Tables of whole ways, which only a database has (``app.exports.formats.registry``)."""


def output_for(path: Path) -> Output:
    """The output that the file's suffix stands for; ``UnknownNameError`` lists the suffixes there are."""
    for _, output in OUTPUTS.items():
        if path.suffix.lower() == output.suffix:
            return output
    known = ", ".join(output.suffix for _, output in OUTPUTS.items())
    raise UnknownNameError(f"No output is called {path.suffix!r}. Choose one of: {known}.")


def write(
    segments: Iterable[Segment],
    path: Path,
    *,
    source: str | None = None,
    height_datum: str | None = HEIGHT_DATUM,
) -> int:
    """Write segments to ``path`` in the format of its suffix; returns how many were written.

    The file appears complete or not at all: it is written beside its place and moved there at the end, and so are its
    companions then.
    ``source`` defaults to the attribution of OpenStreetMap alone; ``height_datum`` is None where there are no heights.
    Raises ``UnknownNameError`` for an unknown
    suffix and ``OSError`` where the folder cannot be written to.
    """
    output, said = output_for(path), stated(source or attribution(), height_datum)
    with whole_file(path) as partial:
        count = output.write(segments, partial, said)
    write_beside(output.companions(path, said))
    return count


def write_beside(companions: Mapping[Path, str]) -> None:
    """Write small files, each complete or not at all."""
    for place, text in companions.items():
        with whole_file(place) as partial:
            partial.write_text(text, encoding="utf-8")
