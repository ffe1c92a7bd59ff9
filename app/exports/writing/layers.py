"""What a table file holds: road segments, or whole ways."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from app.map.segment import Column, Segment, Way


@dataclass(frozen=True)
class Layer:
    """A table of records of one kind."""

    name: str
    title: str
    columns: Mapping[str, Column]


SEGMENTS = Layer("segments", "Slopes of road segments", Segment.columns)
WAYS = Layer("ways", "Slopes of whole ways", Way.columns)
