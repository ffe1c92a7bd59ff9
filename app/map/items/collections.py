"""What is served as features: segments and ways, each property with how it is read, its type, and what it means.

Queryables, schemas, filters, sorting and the text of features follow from here. Properties of segments are those of
``app.map.segment``, in its order; how they are read, their types and digits are said there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from app.map.segment import HEIGHT_DATUM, Column, Record, Segment, Way

GEOMETRY = "geometry"
"""By this name filters know the line."""


@dataclass(frozen=True, kw_only=True)
class Property(Column):
    """One property of a collection's features: its ``sql`` is over the tables of ``Collection.source``."""

    name: str
    title: str
    description: str
    unit: str | None = None
    """UCUM: %, m, 1 (a share)."""
    nullable: bool = False
    values: tuple[str | int, ...] = ()
    """All that there are, where they are few and known."""


@dataclass(frozen=True, eq=False)
class Collection:
    """Features that are served together. Each is equal to itself only."""

    id: str
    title: str
    description: str
    properties: Mapping[str, Property]
    source: str
    """The tables, as they stand after FROM."""
    table: str
    """The first of them, which has a row of each feature."""
    keys: Mapping[str, str]
    """The feature's id as each of the tables has it, the first's first."""
    line: str
    """The LineString, longitude and latitude."""
    line_3857: str
    driven: Mapping[bool, str]
    """The conditions of features that were driven, and that were not."""
    quick: tuple[str, ...]
    """The properties by which an index finds and sorts features, however many there are."""
    source_with_gaps: str | None = None
    """With what is known of undriven roads between driven ones; None: there is no such difference."""
    beside: Mapping[bool, str] | None = None
    """The second table looked up row by row, without gaps (False) and with them; None where there is none.

    So a page costs what its own features cost: the planner would rather read the whole table for a thousand of them.
    """
    follows_changes: bool = False
    """Whether what changed since a version is known of each feature."""

    @property
    def key(self) -> str:
        """The expression of the feature's id."""
        return next(iter(self.keys.values()))


# Title, description, unit. The order and everything else come from the table that is described.
_TEXTS: Mapping[str, tuple[str, str, str | None]] = {
    "id": ("Number", "The service's number, which it keeps over imports of the same road.", None),
    "osm_way_id": ("OpenStreetMap way", "The number of the way in OpenStreetMap.", None),
    "from_node": ("First node", "The OpenStreetMap node in which the line begins.", None),
    "to_node": ("Last node", "The OpenStreetMap node in which the line ends.", None),
    "segments": ("Segments", "How many segments the way consists of.", None),
    "length_m": ("Length", "Metres along the ground.", "m"),
    "highway": ("Class of road", "OpenStreetMap's highway=*.", None),
    "name": ("Name", "Of the road; null where it has none.", None),
    "oneway": ("One-way", "1 along the line, -1 against it, 0 both.", None),
    "bridge": ("Bridge", "Whether it is, or in part is, a bridge.", None),
    "tunnel": ("Tunnel", "Whether it is, or in part is, a tunnel.", None),
    "slope_percent": (
        "Slope",
        "100 * rise / run, positive uphill from from_node to to_node; of a way the mean over what was measured of "
        "it, by length. Null where it is not known.",
        "%",
    ),
    "slope_sigma_percent": ("Sigma of the slope", "One standard deviation.", "%"),
    "drives": ("Drives", "How many drives are behind the slope; 0: none.", None),
    "observations": ("Observations", "How many epochs of these drives.", None),
    "dem_slope_percent": ("Slope of the elevation model", "What the elevation model alone says.", "%"),
    "updated_at": ("Changed", "When what is published of it changed last; null where nothing is.", None),
    "height_from_m": ("Height of the first node", f"Above {HEIGHT_DATUM}.", "m"),
    "height_to_m": ("Height of the last node", f"Above {HEIGHT_DATUM}.", "m"),
    "height_sigma_m": ("Sigma of the heights", "One standard deviation, of the less sure end.", "m"),
    "steepest_percent": (
        "Steepest",
        "Mean grade over the steepest 20 m inside, signed; over all of it where it is shorter.",
        "%",
    ),
    "steepest_from_m": ("Where the steepest begins", "Metres from from_node.", "m"),
    "steepest_to_m": ("Where the steepest ends", "Metres from from_node.", "m"),
    "driven_share": ("Share that was driven", "Of the length, 0 to 1.", "1"),
    "steepness_percent": (
        "Steepness",
        "The slope without its sign: what roads are sorted by, where the way up and the way down are alike.",
        "%",
    ),
    "measured_share": ("Share that was measured", "Of the length, 0 to 1, in segments with a slope.", "1"),
}


def _properties(record: type[Record]) -> dict[str, Property]:
    properties: dict[str, Property] = {}
    for name, column in record.columns.items():
        title, description, unit = _TEXTS[name]
        nullable = name in record.optional and name != "id"
        values = (-1, 0, 1) if name == "oneway" else ()
        about: dict[str, Any] = {"title": title, "description": description, "unit": unit}
        properties[name] = Property(**vars(column), **about, name=name, nullable=nullable, values=values)
    return properties


_JOINED = "segments AS s LEFT JOIN segment_slopes AS a ON a.segment_id = s.id"
# Without the offset the planner would make a join of it.
_LOOKED_UP = (
    "LEFT JOIN LATERAL (SELECT * FROM segment_slopes WHERE segment_id = s.id{} OFFSET 0) AS a ON true"
)

SEGMENTS = Collection(
    id="segments",
    title="Slopes of road segments",
    description=(
        "Inclinations of road segments, measured by vehicles. A segment is a pair of consecutive nodes of a drivable "
        "OpenStreetMap way. slope_percent is positive uphill from from_node to to_node, the direction in which the way "
        "is drawn; slope_sigma_percent is one standard deviation; unknown is null. dem_slope_percent is what the "
        "elevation model alone says. height_from_m and height_to_m are heights of the nodes, with one standard "
        f"deviation height_sigma_m, above {HEIGHT_DATUM}; steepest_percent is the mean grade over the steepest 20 m "
        "inside, from steepest_from_m to steepest_to_m; driven_share is how much of the segment was driven, 0 to 1."
    ),
    properties=_properties(Segment),
    source=f"{_JOINED} AND a.drives > 0",
    source_with_gaps=_JOINED,
    table="segments AS s",
    beside={False: _LOOKED_UP.format(" AND drives > 0"), True: _LOOKED_UP.format("")},
    keys={"s": "s.id", "a": "a.segment_id"},
    line="s.geom",
    line_3857="s.geom_3857",
    driven={True: "a.drives > 0", False: "coalesce(a.drives, 0) = 0"},
    quick=(
        *("id", "osm_way_id", "highway", "name"),
        *("slope_percent", "steepness_percent", "steepest_percent", "updated_at"),
    ),
    follows_changes=True,
)
WAYS = Collection(
    id="ways",
    title="Slopes of ways",
    description=(
        "Consecutive segments of one OpenStreetMap way, merged. slope_percent is the mean over what was measured of "
        "it, by length, positive uphill along the line; measured_share is how much that is, 0 to 1; steepest_percent "
        "is the mean grade over the steepest 20 m, from steepest_from_m to steepest_to_m. A way is derived from its "
        "segments and follows them after a moment. Unknown is null."
    ),
    properties=_properties(Way),
    source="ways AS w",
    table="ways AS w",
    keys={"w": "w.id"},
    line="w.geom",
    line_3857="w.geom_3857",
    driven={True: "w.drives > 0", False: "w.drives = 0"},
    quick=("id", "osm_way_id", "steepness_percent"),
)
COLLECTIONS: Mapping[str, Collection] = {one.id: one for one in (SEGMENTS, WAYS)}
