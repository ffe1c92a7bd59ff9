"""Sections of a linear reference system with their lines, out of a file of a road authority."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from app.core.messages import say
from app.core.text import rounded
from app.map.heights.classes import CLASSES, ByClass
from fusion.errors import BadOptionsError
from fusion.types import Floats

NAMES = ("route_id", "begin_point", "end_point")
LINE = "wkt"
_LONGEST_CELL = 2**27  # characters: a line of millions of places


@dataclass(frozen=True, eq=False)
class Section:
    """A section of a route. ``line_deg``: longitude and latitude, shape (n, 2), from begin_point to end_point."""

    given: tuple[str, str, str]
    """Route and points as the file has them."""
    miles: float
    line_deg: Floats

    @property
    def name(self) -> str:
        """For messages."""
        return "{} {}-{}".format(*self.given)


def read_sections(path: Path) -> list[Section]:
    """All sections of a file; ``BadOptionsError`` says of the first that is wrong what is."""
    try:
        found = _from_csv(path) if path.suffix.lower() == ".csv" else _from_geojson(path)
        sections = [_section(path, number, values, line) for number, values, line in found]
    except (OSError, UnicodeDecodeError, csv.Error, json.JSONDecodeError) as error:
        raise BadOptionsError(say("hpms.unreadable", file=path, error=error), where="sections") from error
    if not sections:
        raise BadOptionsError(say("hpms.none", file=path), where="sections")
    return sections


def _from_csv(path: Path) -> Iterator[tuple[int, Mapping[str, Any], Any]]:
    csv.field_size_limit(_LONGEST_CELL)
    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = csv.DictReader(file)
        rows.fieldnames = [name.strip().lower() for name in rows.fieldnames or ()]
        if missing := [name for name in (*NAMES, LINE) if name not in rows.fieldnames]:
            names = ", ".join(missing)
            raise BadOptionsError(say("hpms.lacks", file=path, names=names), where="sections")
        for number, row in enumerate(rows, 1):
            yield number, row, row[LINE]


def _from_geojson(path: Path) -> Iterator[tuple[int, Mapping[str, Any], Any]]:
    document = json.loads(path.read_text(encoding="utf-8"))
    features = document.get("features") if isinstance(document, dict) else None
    for number, one in enumerate(features if isinstance(features, list) else (), 1):
        properties = one.get("properties") if isinstance(one, dict) else None
        values = {str(name).lower(): value for name, value in (properties or {}).items()}
        if missing := [name for name in NAMES if values.get(name) is None]:
            names = ", ".join(missing)
            raise BadOptionsError(
                say("hpms.wrong", file=path, n=number, error=say("hpms.no_property", names=names)),
                where="sections",
            )
        yield number, values, json.dumps(one.get("geometry"))


def _section(path: Path, number: int, values: Mapping[str, Any], line: Any) -> Section:
    route, begin, end = (str(values[name]).strip() for name in NAMES)

    def wrong(reason: str) -> BadOptionsError:
        return BadOptionsError(say("hpms.wrong", file=path, n=number, error=reason), where="sections")

    try:
        miles = float(end) - float(begin)
    except ValueError:
        raise wrong(say("hpms.no_number", begin=begin, end=end)) from None
    if not (math.isfinite(miles) and miles > 0):
        raise wrong(say("hpms.no_length", begin=begin, end=end))
    try:
        shape = shapely.from_geojson(line) if str(line).startswith("{") else shapely.from_wkt(line)
    except (shapely.errors.ShapelyError, TypeError) as error:
        raise wrong(say("hpms.no_line", error=str(error)[:120])) from None
    if shape is not None and shape.geom_type == "MultiLineString":
        shape = shapely.line_merge(shape, directed=True)
    if shape is None or shape.geom_type != "LineString" or shape.is_empty:
        raise wrong(say("hpms.no_line", error="" if shape is None else shape.geom_type))
    places = np.asarray(shapely.get_coordinates(shape), float)
    if not (np.isfinite(places).all() and (np.abs(places) <= (180, 90)).all() and shape.length > 0):
        raise wrong(say("hpms.no_degrees"))
    return Section((route, begin, end), miles, places)


METRES_PER_MILE = 1609.344
DIGITS = 3
"""Of miles, as HPMS has them, and of shares."""


def row_of(section: Section, found: ByClass) -> dict[str, Any]:
    """Miles in each class, scaled to the section; a probability that is not known is None."""
    shares = np.append(found.length_m, found.whole_m - found.length_m.sum()) / found.whole_m
    # Rounded as sums, so that they add up to the section.
    sums = np.round(np.cumsum(shares) * section.miles, DIGITS)
    miles = [rounded(one, DIGITS) for one in np.diff(sums, prepend=0.0).tolist()]
    return {
        **dict(zip(NAMES, section.given, strict=True)),
        "section_miles": rounded(section.miles, DIGITS),
        "line_miles": rounded(found.whole_m / METRES_PER_MILE, DIGITS),
        **dict(zip([*(f"grades_{name}" for name in CLASSES), "unmeasured_miles"], miles, strict=True)),
        "measured_share": rounded(1 - float(shares[-1]), DIGITS),
        "class_probability": rounded(found.sure, DIGITS),
    }
