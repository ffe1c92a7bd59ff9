"""Which extract of OpenStreetMap holds the roads of a place: names of regions by which extracts are usually offered.

Names are those of https://download.geofabrik.de, which several mirrors share. The boxes are coarse, and written down
from general knowledge: they say what to look for, not where a border is. A region may have several.
"""

from __future__ import annotations

import csv
from functools import cache
from importlib.resources import files

from app.core.db import Bounds
from app.core.messages import say
from fusion.messages import Message

NO_ROADS = ("no-match", "no-roads")
"""What a drive fails of where roads are missing."""
MOST_NAMED = 3
"""Extracts that are named for one place: near a border several may be meant."""
_EDGE = 4.0
_MUCH_LARGER = 12.0


@cache
def _table() -> tuple[tuple[str, Bounds], ...]:
    text = files("app.roads").joinpath("named_extracts.csv").read_text("utf-8")
    rows = list(csv.reader(text.splitlines()))[1:]
    return tuple((name, (float(w), float(s), float(e), float(n))) for name, w, s, e, n in rows)


@cache
def extracts_over(box: Bounds) -> tuple[str, ...]:
    """Names of extracts that hold a box (west, south, east, north; degrees), the likeliest first; none is there.

    That is the smallest one, but one at whose edge the box lies comes later: regions are no boxes, and what is at the
    edge of one is the neighbour's as a rule. A continent is named only where nothing smaller is.
    """
    held = [(name, region) for name, region in _table() if _holds(region, box)]
    held = [one for one in held if "/" in one[0]] or held
    found = sorted((_rank(box, region), name) for name, region in held)
    likely = dict.fromkeys(name for rank, name in found if rank <= _MUCH_LARGER * found[0][0])
    return tuple(likely)[:MOST_NAMED]


def _holds(region: Bounds, box: Bounds) -> bool:
    return region[0] <= box[0] and region[1] <= box[1] and region[2] >= box[2] and region[3] >= box[3]


def _rank(box: Bounds, region: Bounds) -> float:
    west, south, east, north = region
    across = abs(box[0] + box[2] - west - east) / (east - west)
    along = abs(box[1] + box[3] - south - north) / (north - south)
    return (east - west) * (north - south) * (1 + _EDGE * (across**4 + along**4))


def extract_words(box: Bounds) -> Message:
    """What to import of the roads in a box, as part of a sentence."""
    west, south, east, north = box
    names = extracts_over(box)
    if not names:
        return say("roads.extract_over", south=south, north=north, west=west, east=east)
    if len(names) == 1:
        return say("roads.extract", name=names[0])
    return say("roads.extract_or", name=names[0], others=", ".join(names[1:]))
