"""Every kind of file that the map is written to, by name: for ``versant export``, ``/v1/exports`` and ``versant fuse``.

A new one is one file here with a subclass of ``Format``, and one line below. Modules of tables import what
they write with where they write: to list the formats must cost little.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from app.core.messages import say
from app.core.text import whole_file
from app.exports.format import SEGMENTS, Format, TableFormat, statements
from app.exports.formats.csv_table import Csv, WayCsv
from app.exports.formats.dem_geotiff import DemGeoTiff
from app.exports.formats.dem_hgt import DemHgt
from app.exports.formats.dem_terrarium import DemTerrarium
from app.exports.formats.flatgeobuf import FlatGeobuf
from app.exports.formats.geojson import GeoJson
from app.exports.formats.geoparquet import GeoParquet, WayParquet
from app.exports.formats.gpkg import GeoPackage
from app.exports.formats.josm import Josm
from app.exports.formats.maproulette import MapRoulette
from app.exports.formats.opendrive import OpenDrive
from app.exports.formats.opensidewalks import OpenSidewalks
from app.exports.formats.osm_ele import OsmEle
from app.exports.formats.osrm import OsrmSpeeds
from app.exports.formats.overture import Overture
from app.exports.formats.pmtiles import PmTiles
from app.exports.formats.routee import RouteeGrades
from app.exports.formats.sumo import Sumo
from app.map.segment import HEIGHT_DATUM, Segment, attribution
from fusion.errors import UnknownNameError
from fusion.registry import Registry

FORMATS: Registry[Format] = Registry("format of exports")
for _format in (
    GeoJson(),
    GeoParquet(),
    GeoPackage(),
    FlatGeobuf(),
    Csv(),
    WayParquet(),
    WayCsv(),
    PmTiles(),
    OsmEle(),
    OsrmSpeeds(),
    RouteeGrades(),
    Sumo(),
    OpenDrive(),
    OpenSidewalks(),
    MapRoulette(),
    Josm(),
    Overture(),
    DemHgt(),
    DemGeoTiff(),
    DemTerrarium(),
):
    FORMATS.add(_format.name, _format)

SEGMENT_FORMATS: dict[str, TableFormat] = {
    name: one for name, one in FORMATS.items() if isinstance(one, TableFormat) and one.layer is SEGMENTS
}
"""Tables of segments: a file's suffix stands for one of these first, and segments alone make one."""


def format_for(path: Path, name: str | None = None) -> Format:
    """The format of this name, or the one that the file's suffix stands for.

    A suffix stands for a table of segments before all others; where several others have it, one has to be named.
    Raises ``UnknownNameError``.
    """
    if name is not None:
        return FORMATS[name]
    file_name = path.name.lower()
    fitting = [one for one in FORMATS.values() if file_name.endswith(one.suffixes)]
    usual = [one for one in fitting if path.suffix.lower() in one.suffixes and one.name in SEGMENT_FORMATS]
    if usual or len(fitting) == 1:
        return (usual or fitting)[0]
    if fitting:
        names = " or ".join(one.name for one in fitting)
        raise UnknownNameError(say("export.several_formats", suffix=path.suffix.lower(), names=names))
    raise _unknown_suffix(path.suffix.lower(), FORMATS.values())


def segment_format_for(path: Path) -> TableFormat:
    """The table of segments that the file's suffix stands for; ``UnknownNameError`` lists the suffixes there are."""
    for one in SEGMENT_FORMATS.values():
        if path.suffix.lower() in one.suffixes:
            return one
    raise _unknown_suffix(path.suffix, SEGMENT_FORMATS.values())


def _unknown_suffix(suffix: str, formats: Iterable[Format]) -> UnknownNameError:
    known = ", ".join(dict.fromkeys(one_suffix for one in formats for one_suffix in one.suffixes))
    return UnknownNameError(say("export.no_output", suffix=suffix, names=known))


def write_segments(
    segments: Iterable[Segment],
    path: Path,
    *,
    source: str | None = None,
    height_datum: str | None = HEIGHT_DATUM,
) -> int:
    """Write segments to ``path`` in the format of its suffix; returns how many were written.

    The file appears complete or not at all: it is written beside its place and moved there at the end, and so are its
    companions then. ``source`` defaults to the attribution of OpenStreetMap alone; ``height_datum`` is None where there
    are no heights. Raises ``UnknownNameError`` for an unknown suffix and ``OSError`` where the folder cannot be
    written to.
    """
    chosen, stated = segment_format_for(path), statements(source or attribution(), height_datum)
    with whole_file(path) as partial:
        count = chosen.write_records(segments, partial, stated)
    write_companions(chosen.companions(path, stated))
    return count


def write_companions(companions: Mapping[Path, str]) -> None:
    """Write small files, each complete or not at all."""
    for path, text in companions.items():
        with whole_file(path) as partial:
            partial.write_text(text, encoding="utf-8")
