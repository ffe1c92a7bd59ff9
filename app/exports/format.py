"""What a format is: one kind of file that the stored map is written to.

A format for another program takes its grammar from that program's source or documentation, and its docstring names it.
What a format reads of the map it asks of a ``Source``, which is bound to one snapshot of the database.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import BaseModel, ValidationError

from app.core.messages import say
from app.exports.writing.qgis_style import style_beside
from app.map.segment import Column, Record, Segment, Way
from fusion.errors import BadOptionsError

if TYPE_CHECKING:
    from app.exports.source import Source

Stated = Mapping[str, str]
"""What a file states of all that it holds: ``attribution``, whose data it is, and ``height_datum``, where known; from a
database ``changed_at`` as well, when its data last changed, and ``provenance``, a JSON text (``app.exports``)."""


def statements(source: str, height_datum: str | None) -> dict[str, str]:
    """What every file states, by name."""
    return {"attribution": source} | ({} if height_datum is None else {"height_datum": height_datum})


WAY_FILTERS = frozenset({"driven", "least_drives", "most_sigma_percent", "region"})
ALL_FILTERS = WAY_FILTERS | {"gaps"}


@dataclass(frozen=True)
class Layer:
    """A table of records of one kind."""

    name: str
    title: str
    columns: Mapping[str, Column]


SEGMENTS = Layer("segments", "Slopes of road segments", Segment.columns)
WAYS = Layer("ways", "Slopes of whole ways", Way.columns)


class NoOptions(BaseModel, extra="forbid", frozen=True):
    """The options of formats that take none, and the base of all others: an unknown option is refused."""

    local_files: ClassVar[frozenset[str]] = frozenset()
    """Options that name files on this machine: for who works on it, never for requests from elsewhere."""


def nothing_beside(self: Format, path: Path, stated: Stated) -> Mapping[Path, str]:
    """The ``companions`` of a format whose file holds everything."""
    return {}


class Format(ABC):
    """A kind of file. A new one is one file with a subclass and one line in ``app.exports.formats``."""

    name: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]
    """With their dots, lower case; the first is the usual one. Of two parts the last one decides."""
    media_type: ClassVar[str]
    """Of a file with the first suffix."""
    description: ClassVar[str]
    consumer: ClassVar[str] = ""
    """The program that reads the file, and from where its grammar is known; empty for formats that many read."""
    options: ClassVar[type[NoOptions]] = NoOptions
    """The model of its options, each with a description and a default."""
    holds: ClassVar[str] = "entries"
    """What there are many of in it."""
    filters: ClassVar[frozenset[str]] = frozenset()
    """Which of ``ALL_FILTERS`` it can be narrowed by; the box is for all."""

    @abstractmethod
    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """Write ``path`` anew, by its suffix; how many of its main things it holds.

        ``options`` is one of ``self.options``. The same data and options give the same bytes.
        """

    def companions(self, path: Path, stated: Stated) -> Mapping[Path, str]:
        """The small files that stand beside ``path``, with their text: how it is drawn, what it has no place for.

        Here: the origin of the data as JSON, for few programs' files have a place for it.
        """
        if "provenance" not in stated:
            return {}
        return {path.with_name(f"{path.name}.provenance.json"): stated["provenance"] + "\n"}

    def parse_options(self, given: Mapping[str, Any], *, local: bool) -> NoOptions:
        """Its options out of texts or JSON; ``BadOptionsError`` says which one is wrong and what there is.

        Without ``local``, options that name files of this machine are refused.
        """
        refused = frozenset() if local else self.options.local_files
        names = [name for name in self.options.model_fields if name not in refused]
        for name in given:
            if name not in names:
                raise BadOptionsError(
                    say(
                        "export.no_option",
                        format=self.name,
                        name=name[:60],
                        names=", ".join(names) or say("export.none"),
                    ),
                    where=name[:60],
                )
        try:
            return self.options.model_validate(dict(given))
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"]) or None
            reason = first["msg"].removeprefix("Value error, ").rstrip(".")
            raise BadOptionsError(
                say(
                    "export.wrong_option",
                    format=self.name,
                    name=where or say("export.its_options"),
                    reason=reason,
                ),
                where=where,
            ) from error

    def check_filters(self, **filters: bool) -> None:
        """``BadOptionsError`` that names the filter, for one that the format cannot be narrowed by."""
        for name, is_set in filters.items():
            if is_set and name not in self.filters:
                raise BadOptionsError(say("export.no_filter", name=name, format=self.name), where=name)


class TableFormat(Format):
    """A table of the records of one layer. One of segments is written without a database as well (``versant fuse``)."""

    layer: ClassVar[Layer] = SEGMENTS
    holds = SEGMENTS.name
    filters = ALL_FILTERS

    def write(self, source: Source, path: Path, stated: Stated, options: Any) -> int:
        """Write the records of its layer that are asked for."""
        records: Iterable[Record] = source.asked_segments() if self.layer is SEGMENTS else source.asked_ways()
        return self.write_records(records, path, stated)

    @abstractmethod
    def write_records(self, records: Iterable[Record], path: Path, stated: Stated) -> int:
        """Write all records, replacing ``path``; returns their number. ``stated`` goes where the format has a place.

        The iterable is consumed once and never held as a whole.
        """

    def companions(self, path: Path, stated: Stated) -> Mapping[Path, str]:
        """The style for QGIS."""
        return style_beside(path)
