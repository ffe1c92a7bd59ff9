"""Editions as documents, and what the service says of who sees what. Knows no SQL."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, Field

from app.core.http import EditionSeen, Link, link
from app.map.segment import OSM_COPYRIGHT_URL, OSM_LICENSE, OSM_LICENSE_URL
from app.releases.store import Edition, identity

MANIFEST = "manifest.json"
"""The file of an edition that names the others."""
LATEST = "latest"
"""What stands for the number of the newest edition."""
_EXAMPLE_FILE = {
    "name": "slopes.pmtiles",
    "media_type": "application/vnd.pmtiles",
    "size_bytes": 8_130_577,
    "sha256": "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08",
}
EXAMPLE_FIGURES: dict[str, Any] = {
    "number": 12,
    "day": "2026-11-20",
    "owners": 3,
    "owners_needed": 5,
    "segments": 61_204,
    "length_m": 3_120_455,
    "withheld_share": 0.31,
    "withheld_length_share": 0.27,
    "licence": {"name": OSM_LICENSE, "url": OSM_LICENSE_URL, "attribution_url": OSM_COPYRIGHT_URL},
}
EXAMPLE: dict[str, Any] = {**EXAMPLE_FIGURES, "files": [_EXAMPLE_FILE], "links": []}


class Licence(BaseModel):
    """Under which conditions an edition may be used."""

    name: str = OSM_LICENSE
    url: str = OSM_LICENSE_URL
    attribution_url: str = Field(OSM_COPYRIGHT_URL, description="How to name the contributors.")


class Figures(EditionSeen, json_schema_extra={"examples": [EXAMPLE_FIGURES]}):
    """What is told of an edition, in answers and in the manifest of its files."""

    segments: int = Field(description="Segments with a slope.")
    length_m: int = Field(description="Their length.")
    withheld_share: float | None = Field(
        description="Of the segments that were driven, the share that is not shown: too few owners drove them. Null "
        "where none was driven."
    )
    withheld_length_share: float | None = Field(description="The same of their length.")
    licence: Licence = Field(default_factory=Licence)

    @classmethod
    def of(cls, edition: Edition) -> Figures:
        """Those of an edition."""
        return cls(
            **identity(edition),
            segments=edition.segments,
            length_m=round(edition.length_m),
            withheld_share=edition.withheld_share,
            withheld_length_share=edition.withheld_length_share,
        )


class EditionFile(BaseModel):
    """A file of an edition."""

    name: str
    media_type: str
    size_bytes: int
    sha256: str = Field(description="Of its bytes, hex; in quotes it is the file's ETag.")


class EditionDocument(Figures, json_schema_extra={"examples": [EXAMPLE]}):
    """An edition of the public map, with its files."""

    files: list[EditionFile] = Field(description="Empty where they are kept no longer.")
    links: list[Link]

    @classmethod
    def linked(cls, base: str, edition: Edition) -> EditionDocument:
        """An edition as the API shows it."""
        here = edition_address(base, edition.number)
        files = [EditionFile.model_validate(file) for file in edition.files]
        links = [link(here, "self", title="This edition")]
        links += [link(f"{here}/{one.name}", "enclosure", one.media_type, "A file of it") for one in files]
        return cls(**Figures.of(edition).model_dump(), files=files, links=links)


class EditionList(BaseModel, json_schema_extra={"examples": [{"editions": [EXAMPLE], "links": []}]}):
    """All editions, the newest first."""

    editions: list[EditionDocument]
    links: list[Link]


def edition_address(base: str, number: int) -> str:
    """Absolute address of an edition."""
    return f"{base}/v1/editions/{number}"
