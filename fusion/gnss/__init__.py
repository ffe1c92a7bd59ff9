"""How positions are computed from a log, by name. Solvers of raw pseudoranges will stand beside ``receiver``.

A new one is one file with a class that follows ``Positioning``, and one line here. Knows no road and no elevation.
"""

from __future__ import annotations

from typing import Protocol

from fusion.gnss.receiver import ReceiverPositioning
from fusion.registry import Registry
from fusion.types import DriveLog, GnssFix, Progress


class Positioning(Protocol):
    """A named way from what a receiver logged to positions."""

    name: str
    source: str
    """Where it comes from: author, year, chapter."""
    description: str
    """One sentence for a person who chooses."""

    def positions(self, log: DriveLog, progress: Progress) -> GnssFix:
        """The positions of the log, with their accuracies where known.

        Raises ``MissingSensorError`` where the log lacks what it takes.
        """
        ...


POSITIONINGS: Registry[Positioning] = Registry("positioning")
POSITIONINGS.add(ReceiverPositioning.name, ReceiverPositioning())
