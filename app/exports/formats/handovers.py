"""Files that other programs take, each in the form that its consumer reads. One file here is one consumer's form.

A new one is a class that follows ``Handover`` (``base``), and one line below. ``.docs/handover.md`` lists them.
"""

from __future__ import annotations

from app.exports.formats.base import Handover
from app.exports.formats.josm import Josm
from app.exports.formats.maproulette import MapRoulette
from app.exports.formats.opensidewalks import OpenSidewalks
from app.exports.formats.osm_ele import OsmEle
from app.exports.formats.osrm import OsrmSpeeds
from app.exports.formats.routee import RouteeGrades
from fusion.registry import Registry

HANDOVERS: Registry[Handover] = Registry("handover")
for _handover in (OsmEle(), OsrmSpeeds(), RouteeGrades(), OpenSidewalks(), MapRoulette(), Josm()):
    HANDOVERS.add(_handover.name, _handover)
