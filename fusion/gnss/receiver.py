"""Positions as the receiver computed and logged them."""

from __future__ import annotations

from fusion.types import DriveLog, GnssFix, Progress


class ReceiverPositioning:
    """Takes the log's own positions."""

    name = "receiver"
    source = "the receiver itself"
    description = "Positions as logged."

    def positions(self, log: DriveLog, progress: Progress) -> GnssFix:
        """``log.fix``, unchanged."""
        progress("positioning", 1.0)
        return log.fix
