"""How positions are computed from a log, by name. Solvers of raw pseudoranges will stand beside ``receiver``.

A new one is one file with a class that follows ``Positioning``, and one line here.
"""

from fusion.gnss.base import POSITIONINGS, Positioning
from fusion.gnss.receiver import ReceiverPositioning

POSITIONINGS.add(ReceiverPositioning.name, ReceiverPositioning())

__all__ = ["POSITIONINGS", "Positioning"]
