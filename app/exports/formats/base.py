"""What a handover is: a file in the form that one other program reads. Knows no form and no statement.

The form comes from the consumer's source or documentation; each handover names it. What a handover reads of the map it
asks of a ``Source``, which is bound to one snapshot of the database.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Protocol

from pydantic import BaseModel, ConfigDict, ValidationError
from sqlalchemy.orm import Session

from app.core.db import Bounds
from app.map.segment import Segment
from fusion.errors import BadOptionsError
from fusion.types import Floats

Stated = Mapping[str, str]
"""What is said of all that is handed over: ``attribution``, whose data it is, and ``height_datum``."""


class Source(Protocol):
    """The map as handovers read it."""

    session: Session
    bbox: Bounds | None
    """West, south, east, north, degrees (west > east: across the antimeridian); None: everything."""

    def segments(self, *, gaps: bool = False, driven: bool = False) -> Iterator[Segment]:
        """All segments that meet the box, or the driven ones, by ascending id; ``gaps`` as in ``segment_items``."""
        ...

    def in_way_order(self, *, gaps: bool = False, driven: bool = False) -> Iterator[list[Segment]]:
        """The same as chains of consecutive segments of one OpenStreetMap way, in the order of driving along it.

        By ascending way. A chain ends where the way was not driven (``driven``), leaves the box, or passes its own
        node again.
        """
        ...

    def road_files(self) -> Sequence[Path]:
        """The ways with a ``highway`` and their nodes, with all tags, as each region's last import kept them (PBF).

        Sorted; that of the newest import in front, for a way may be in several. ``RoadsError`` where a file is missing.
        """
        ...

    def ground_heights(self, lon_deg: Floats, lat_deg: Floats) -> Floats:
        """Of the ground by the active elevation rasters, m, above their own datum; NaN unknown; shapes (n,)."""
        ...

    def ground_datum(self) -> str | None:
        """What these refer to, as it was stated when the rasters were imported; None without any."""
        ...

    def note(self, text: str) -> None:
        """Tell a person something about what was written, as one sentence."""
        ...


class NoOptions(BaseModel):
    """Of handovers that take none, and the base of all others: an unknown option is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    local_files: ClassVar[frozenset[str]] = frozenset()
    """Options that name files on this machine: for who works on it, never for requests from elsewhere."""


class Handover(Protocol):
    """One consumer's file."""

    name: str
    consumer: str
    """The program, and from where its form is known."""
    media_type: str
    """Of a file with the first suffix."""
    description: str

    @property
    def suffixes(self) -> tuple[str, ...]:
        """With their dots, lower case; the first is the usual one. Of two parts the last one decides."""
        ...

    @property
    def options(self) -> type[NoOptions]:
        """The model of its options, each with a description."""
        ...

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """Write ``path`` anew, by its suffix; how many of its main things (nodes, lines, proposals) it holds.

        ``options`` is one of ``self.options``. The same map and options give the same bytes.
        """
        ...


def options_of(handover: Handover, given: Mapping[str, Any], *, local: bool) -> NoOptions:
    """The handover's options out of texts or JSON; ``BadOptionsError`` says which one is wrong and what there is.

    Without ``local``, options that name files of this machine are refused.
    """
    refused = frozenset() if local else handover.options.local_files
    takes = [name for name in handover.options.model_fields if name not in refused]
    for name in given:
        if name not in takes:
            raise BadOptionsError(
                f"{handover.name} takes no option {name[:60]!r} here. It takes: {', '.join(takes) or 'none'}.",
                where=name[:60],
            )
    try:
        return handover.options.model_validate(dict(given))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or None
        said = first["msg"].removeprefix("Value error, ").rstrip(".")
        raise BadOptionsError(f"{handover.name}: {where or 'its options'}: {said}.", where=where) from error
