"""Files that other programs take, each in the form that its consumer reads. One file here is one consumer's form.

A new one is a class that follows ``Handover`` (``base``), and one line below. ``.docs/handover.md`` lists them.
"""

from __future__ import annotations

from app.map.handover.base import Handover
from app.map.handover.osrm import OsrmSpeeds
from fusion.registry import Registry

HANDOVERS: Registry[Handover] = Registry("handover")
for _handover in (OsrmSpeeds(),):
    HANDOVERS.add(_handover.name, _handover)
