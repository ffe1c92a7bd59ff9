"""Files that other programs take, each in the form that its consumer reads. One file here is one consumer's form.

A new one is a class that follows ``Handover`` (``base``), and one line below.
``docs/how-to/feed-routers-and-editors.md`` lists them.
"""

from __future__ import annotations

from app.map.handover.base import Handover
from app.map.handover.josm import Josm
from app.map.handover.maproulette import MapRoulette
from app.map.handover.opensidewalks import OpenSidewalks
from app.map.handover.osm_ele import OsmEle
from app.map.handover.osrm import OsrmSpeeds
from app.map.handover.routee import RouteeGrades
from fusion.registry import Registry

HANDOVERS: Registry[Handover] = Registry("handover")
for _handover in (OsmEle(), OsrmSpeeds(), RouteeGrades(), OpenSidewalks(), MapRoulette(), Josm()):
    HANDOVERS.add(_handover.name, _handover)
