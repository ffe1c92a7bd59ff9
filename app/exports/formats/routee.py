"""Grades for RouteE Compass: ``edges-grade-enumerated.txt.gz``, alone or with a road network of our own.

Consumer: RouteE Compass (``grade_table_input_file``; the files are those that its ``generate_compass_dataset`` writes).
Grammar: gzip of one number a line, without a header, of which line n is the grade of edge n; the unit is what
``grade_table_grade_unit`` of its configuration says: ``decimal``, ``percent`` or ``millis``. Edges are directed.

As ``.txt.gz``: the grades of the consumer's own edges, by its ``edges-compass.csv.gz`` (``edge_id, src_vertex_id,
dst_vertex_id, distance``; the distance in metres) and ``vertices-mapping.csv.gz`` (``vertex_id, vertex_uuid``, which is
OpenStreetMap's node). Its edges run over several of our segments, so a grade is the difference of the heights of the
ends (as ``osm-ele`` gives them) over the distance. As ``.zip``: a network of our segments, each direction an edge, with
all files that belong together.
"""

from __future__ import annotations

import csv
import gzip
import io
import shutil
import zipfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from enum import StrEnum
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydantic import Field

from app.core.messages import say
from app.exports.format import Format, NoOptions, Stated
from app.exports.formats.osm_ele import heights_of
from app.exports.formats.osrm import Unmeasured, directions, slope_of
from app.exports.writing.osm_files import read_nodes
from fusion.errors import BadOptionsError
from fusion.messages import joined
from fusion.types import Floats

if TYPE_CHECKING:
    from app.exports.source import Source

GRADES = "edges-grade-enumerated.txt.gz"
_FILES = {
    "edges-compass.csv.gz": "edge_id,src_vertex_id,dst_vertex_id,distance",
    "edges-mapping.csv.gz": "edge_id,edge_uuid",
    GRADES: None,
    "edges-road-class-enumerated.txt.gz": None,
    "vertices-compass.csv.gz": "vertex_id,x,y",
    "vertices-mapping.csv.gz": "vertex_id,vertex_uuid",
}
"""The files of a network and their headers."""
_DATE = (1980, 1, 1, 0, 0, 0)  # of every member of an archive, so that equal maps give equal bytes


class GradeUnit(StrEnum):
    """As the consumer's configuration names them."""

    DECIMAL = "decimal"
    PERCENT = "percent"
    MILLIS = "millis"


_PER_RATIO = {GradeUnit.DECIMAL: 1.0, GradeUnit.PERCENT: 100.0, GradeUnit.MILLIS: 1000.0}
_DIGITS = {GradeUnit.DECIMAL: 5, GradeUnit.PERCENT: 3, GradeUnit.MILLIS: 2}


class GradeOptions(NoOptions):
    """The unit, and whose edges."""

    local_files: ClassVar[frozenset[str]] = frozenset({"edges", "vertices"})

    unit: GradeUnit = Field(GradeUnit.DECIMAL, description="decimal, percent or millis.")
    edges: Path | None = Field(None, description="Your edges-compass.csv.gz, for a .txt.gz alone.")
    vertices: Path | None = Field(None, description="Your vertices-mapping.csv.gz, which goes with it.")


class RouteeGrades(Format):
    """The grades of edges, one a line."""

    name = "routee-grades"
    consumer = "RouteE Compass (grade_table_input_file)"
    suffixes = (".zip", ".txt.gz")
    media_type = "application/zip"
    description = (
        f"Grade of each edge in the order of the edges: of a network of its own, or of yours ({consumer})"
    )
    options = GradeOptions

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """Write grades; the number of edges. ``BadOptionsError`` where the edges of a lone list are not named."""
        if path.suffix.lower() == ".zip":
            return _write_network(source, path, stated, options.unit)
        if options.edges is None or options.vertices is None:
            raise BadOptionsError(
                say("export.grades_alone", format=self.name),
                where="edges",
            )
        grades = _grades_of(source, options.edges, options.vertices)
        with _gzip_text(path) as file:
            file.writelines(_line(grade, options.unit) for grade in grades.tolist())
        return len(grades)


def _line(grade: float, unit: GradeUnit) -> str:
    return f"{round(grade * _PER_RATIO[unit], _DIGITS[unit]) + 0.0:.{_DIGITS[unit]}f}\n"


@contextmanager
def _gzip_text(path: Path) -> Iterator[Any]:
    """A gzipped text without its name and moment."""
    with (
        path.open("wb") as raw,
        gzip.GzipFile(filename="", mode="wb", fileobj=raw, mtime=0) as packed,
        io.TextIOWrapper(packed, encoding="utf-8", newline="") as text,
    ):
        yield text


def _write_network(source: Source, path: Path, stated: Stated, unit: GradeUnit) -> int:
    with TemporaryDirectory(prefix="versant-") as folder:
        edges, unknown = _write_files(source, Path(folder), unit)
        with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
            for name in _FILES:
                with (
                    archive.open(zipfile.ZipInfo(name, _DATE), "w", force_zip64=True) as member,
                    (Path(folder) / name).open("rb") as file,
                ):
                    shutil.copyfileobj(file, member, 1 << 20)
            archive.writestr(zipfile.ZipInfo("README.txt", _DATE), _readme(stated, unit, unknown))
    if unknown:
        source.note(say("export.edges_level", n=unknown))
    return edges


def _write_files(source: Source, folder: Path, unit: GradeUnit) -> tuple[int, int]:
    """The files of a network of segments; how many edges there are, and of how many no slope is known."""
    vertex: dict[int, int] = {}
    edges = unknown = 0
    with ExitStack() as stack:
        files = {name: stack.enter_context(_gzip_text(folder / name)) for name in _FILES}
        for name, header in _FILES.items():
            if header is not None:
                files[name].write(header + "\n")
        for segment in source.segments(gaps=True):
            slope = slope_of(segment, Unmeasured.DEM)
            ends = (segment.from_node, segment.to_node)
            for node, (lon, lat) in zip(ends, segment.rounded_coordinates(), strict=True):
                if node not in vertex:
                    files["vertices-compass.csv.gz"].write(f"{len(vertex)},{lon:.7f},{lat:.7f}\n")
                    files["vertices-mapping.csv.gz"].write(f"{len(vertex)},{node}\n")
                    vertex[node] = len(vertex)
            for a, b, sign in directions(segment):
                files["edges-compass.csv.gz"].write(
                    f"{edges},{vertex[a]},{vertex[b]},{segment.length_m:.3f}\n"
                )
                files["edges-mapping.csv.gz"].write(f"{edges},{segment.osm_way_id}\n")
                files[GRADES].write(_line(sign * (slope or 0.0) / 100, unit))
                files["edges-road-class-enumerated.txt.gz"].write(f"{segment.highway}\n")
                edges += 1
                unknown += slope is None
    return edges, unknown


def _readme(stated: Stated, unit: GradeUnit, unknown: int) -> str:
    statements = "".join(f"{name}: {text}\n" for name, text in sorted(stated.items()))
    return (
        "A road network with grades for RouteE Compass, written by Versant.\n"
        f'Set graph.edge_list_input_file = "edges-compass.csv.gz", graph.vertex_list_input_file = '
        f'"vertices-compass.csv.gz", traversal.grade_table_input_file = "{GRADES}" and '
        f'traversal.grade_table_grade_unit = "{unit}". Distances are metres. vertex_uuid is the node and edge_uuid the '
        "way in OpenStreetMap. Grades are positive uphill from src to dst: measured ones, else the elevation model's, "
        f"drawn towards the level on short edges. Edges of which nothing is known, as level: {unknown}.\n{statements}"
    )


def _grades_of(source: Source, edges: Path, vertices: Path) -> Floats:
    """The grades of a consumer's edges, ratios, in the order of their numbers."""
    vertex, node = _columns(vertices, ("vertex_id", "vertex_uuid"))
    number, src, dst, distance = _columns(edges, ("edge_id", "src_vertex_id", "dst_vertex_id", "distance"))
    order = np.argsort(number)
    if not np.array_equal(number[order], np.arange(len(number))):
        raise BadOptionsError(
            say("export.edges_gaps", file=edges.name),
            where="edges",
        )
    nodes = read_nodes(source.road_files, source.bbox)
    height = np.append(heights_of(source, nodes).height_m, np.nan)  # -1: not among the roads
    by_vertex = dict(zip(vertex.tolist(), height[nodes.rows(node.astype(np.int64))].tolist(), strict=True))
    ends = [
        np.array([by_vertex.get(one, np.nan) for one in side[order].tolist()], float) for side in (src, dst)
    ]
    grade = (ends[1] - ends[0]) / np.maximum(distance[order].astype(float), 0.1)
    unknown = np.isnan(grade)
    if unknown.any():
        source.note(say("export.edges_elsewhere", n=np.count_nonzero(unknown), all=len(grade)))
    return np.where(unknown, 0.0, grade)


def _columns(path: Path, names: tuple[str, ...]) -> tuple[Any, ...]:
    """Columns of a CSV, gzipped or not, by name; ``BadOptionsError`` where one is missing or is no number."""
    kinds = {name: float if name == "distance" else int for name in names}
    values: dict[str, list[float]] = {name: [] for name in names}
    try:
        with path.open("rb") as raw:
            packed = raw.read(2) == b"\x1f\x8b"
        with gzip.open(path, "rt") if packed else path.open() as file:
            rows = csv.DictReader(file)
            if missing := [name for name in names if name not in (rows.fieldnames or ())]:
                raise BadOptionsError(
                    say("export.lacks_columns", file=path.name, names=joined(missing, " and none ")),
                    where=path.name,
                )
            for row in rows:
                for name, kind in kinds.items():
                    values[name].append(kind(row[name]))
    except (OSError, EOFError, UnicodeDecodeError) as error:
        raise BadOptionsError(
            say("export.cannot_be_read", file=path, error=error), where=path.name
        ) from error
    except (ValueError, TypeError) as error:
        raise BadOptionsError(
            say("export.line", file=path.name, line=rows.line_num, error=error), where=path.name
        ) from error
    return tuple(np.array(values[name], kind) for name, kind in kinds.items())
